//! VTK image data: which array is the scalar, where its samples lie, and its voxels.

use crate::ReadError;
use crate::base64_text::Base64Text;
use crate::scalars::ScalarType;
use crate::vti_blocks::Framing;
use crate::vti_header::{Array, Header};
use glam::DVec3;
use lamina_model::{Grid, Volume, Voxels};
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

/// The name of a scalar whose file gives it none.
pub(crate) const UNNAMED_FIELD: &str = "scalar";

/// The name of the array that [`read`] takes.
pub(crate) fn field_name(path: &Path, wanted: Option<&str>) -> Result<String, ReadError> {
    let header = Header::read(path)?;
    let choice = choose(path, &header, wanted)?;
    Ok(match choice.component {
        Some(component) => format!("{}.{}", choice.name(), AXES[component]),
        None => choice.name().to_owned(),
    })
}

/// Reads the scalar `wanted`, or the one that the file holds for its main one.
pub(crate) fn read(path: &Path, wanted: Option<&str>) -> Result<Volume, ReadError> {
    let header = Header::read(path)?;
    let choice = choose(path, &header, wanted)?;
    let grid = grid(path, &header, choice.of_cells)?;
    let scalar = choice.array.scalar().ok_or_else(|| {
        let what = format!("array {} of type {}", choice.name(), choice.array.type_name);
        ReadError::unsupported(path, what, "integers of 8 to 64 bits, Float32 and Float64 are understood")
    })?;
    let components = if choice.component.is_some() { 3 } else { 1 };
    let too_many = || ReadError::damaged(path, format!("{} points are more than can be counted", grid.voxels()));
    let count = grid.voxels().checked_mul(components).ok_or_else(too_many)?;
    let mut voxels = voxels(path, &header, &choice, scalar, count)?;
    if let Some(component) = choice.component {
        voxels = every_third(&voxels, component);
    }
    Volume::new(grid, voxels).map_err(|e| ReadError::grid(path, e))
}

/// The names of all scalars: arrays of one component, and the components `NAME.x`, `NAME.y`, `NAME.z` of those of three.
pub(crate) fn field_names(path: &Path) -> Result<Vec<String>, ReadError> {
    let header = Header::read(path)?;
    let names = header.arrays().flat_map(|choice| match choice.components() {
        Some(1) => vec![choice.name().to_owned()],
        Some(3) => AXES.map(|axis| format!("{}.{axis}", choice.name())).to_vec(),
        _ => Vec::new(),
    });
    Ok(names.collect())
}

/// Names of a vector's components.
pub(crate) const AXES: [&str; 3] = ["x", "y", "z"];

struct ArrayChoice<'a> {
    array: &'a Array,
    of_cells: bool,
    /// Of an array of three components the one that is meant.
    component: Option<usize>,
}

impl ArrayChoice<'_> {
    fn name(&self) -> &str {
        self.array.name.as_deref().unwrap_or(UNNAMED_FIELD)
    }
    /// Its number of components, if its type is understood.
    fn components(&self) -> Option<usize> {
        self.array.scalar().and_then(|_| self.array.components.trim().parse().ok())
    }
    fn is_scalar(&self) -> bool {
        self.components() == Some(1)
    }
}

impl Header {
    fn arrays(&self) -> impl Iterator<Item = ArrayChoice<'_>> {
        let of_points = self.points.arrays.iter().map(|array| (array, false));
        let all = of_points.chain(self.cells.arrays.iter().map(|array| (array, true)));
        all.map(|(array, of_cells)| ArrayChoice { array, of_cells, component: None })
    }
}

fn choose<'a>(path: &Path, header: &'a Header, wanted: Option<&str>) -> Result<ArrayChoice<'a>, ReadError> {
    let all = || header.arrays();
    let refuse = |reason: String| {
        let scalars = all().filter(ArrayChoice::is_scalar).map(|c| c.name().to_owned());
        let vectors = all().filter(|c| c.components() == Some(3)).map(|c| format!("{}.x, .y, .z", c.name()));
        let present: Vec<_> = scalars.chain(vectors).collect();
        let present = if present.is_empty() { "none".to_owned() } else { present.join(", ") };
        Err(ReadError::Field { path: path.into(), reason, present })
    };
    let main = if header.points.arrays.is_empty() { &header.cells } else { &header.points };
    let named = |name: &str| all().find(|c| c.name() == name);
    let component = |name: &str| {
        let (vector, axis) = name.rsplit_once('.')?;
        let component = Some(AXES.iter().position(|known| *known == axis)?);
        let array = all().find(|c| c.name() == vector && c.components() == Some(3))?;
        Some(ArrayChoice { component, ..array })
    };
    let found = match (wanted, &main.scalars) {
        (Some(name), _) => match named(name).or_else(|| component(name)) {
            None => return refuse(format!("there is no array \"{name}\"")),
            found => found,
        },
        (None, Some(name)) => named(name).or_else(|| all().find(ArrayChoice::is_scalar)),
        (None, None) => all().find(ArrayChoice::is_scalar),
    };
    match found {
        Some(choice) if choice.component.is_some() || choice.array.components.trim() == "1" => Ok(choice),
        Some(choice) => {
            refuse(format!("array \"{}\" has {} components per sample", choice.name(), choice.array.components))
        }
        None => refuse("there is no scalar array".into()),
    }
}

/// One component of an array of three.
fn every_third(voxels: &Voxels, component: usize) -> Voxels {
    fn pick<T: Copy>(v: &[T], component: usize) -> Vec<T> {
        v.iter().skip(component).step_by(3).copied().collect()
    }
    match voxels {
        Voxels::U8(v) => Voxels::U8(pick(v, component)),
        Voxels::U16(v) => Voxels::U16(pick(v, component)),
        Voxels::I16(v) => Voxels::I16(pick(v, component)),
        Voxels::F16(v) => Voxels::F16(pick(v, component)),
        Voxels::F32(v) => Voxels::F32(pick(v, component)),
        Voxels::F64(v) => Voxels::F64(pick(v, component)),
    }
}

/// The sample points; those of cells are the cells' centers.
fn grid(path: &Path, header: &Header, of_cells: bool) -> Result<Grid, ReadError> {
    let (spacing, mut origin) = (DVec3::from(header.spacing), DVec3::from(header.origin));
    let mut dims = [0; 3];
    for axis in 0..3 {
        let (first, last) = (header.extent[2 * axis], header.extent[2 * axis + 1]);
        let cells = last.checked_sub(first).and_then(|n| usize::try_from(n).ok());
        let cells = cells
            .filter(|&n| n < usize::MAX)
            .ok_or_else(|| ReadError::damaged(path, format!("the extent {:?} holds no points", header.extent)))?;
        origin[axis] += first as f64 * spacing[axis];
        dims[axis] = cells + 1;
        // An axis with one point only is flat: it has no cells to halve, and its one layer of cells lies in it.
        if of_cells && cells > 0 {
            origin[axis] += 0.5 * spacing[axis];
            dims[axis] = cells;
        }
    }
    Grid::new(dims, spacing, origin).map_err(|e| ReadError::grid(path, e))
}

fn voxels(
    path: &Path,
    header: &Header,
    choice: &ArrayChoice,
    scalar: ScalarType,
    count: usize,
) -> Result<Voxels, ReadError> {
    let missing = |what: &str| ReadError::damaged(path, format!("{what} of array \"{}\" is missing", choice.name()));
    let system = |e| ReadError::while_reading(path, e);
    let mut file = File::open(path).map_err(system)?;
    let end = file.metadata().map_err(system)?.len();
    let (range, base64) = match choice.array.format.as_str() {
        "appended" => {
            let appended = header.appended.as_ref().ok_or_else(|| missing("the appended data"))?;
            let offset = choice.array.offset.ok_or_else(|| missing("the offset"))?;
            let start = appended.start.checked_add(offset).filter(|&start| start < end);
            (start.ok_or_else(|| missing("the appended data"))?..end, appended.base64)
        }
        "binary" | "ascii" => (choice.array.text.clone().ok_or_else(|| missing("the text"))?, true),
        other => {
            let what = format!("format {other} of array \"{}\"", choice.name());
            return Err(ReadError::unsupported(path, what, "ascii, binary and appended are understood"));
        }
    };
    file.seek(SeekFrom::Start(range.start)).map_err(system)?;
    let length = range.end - range.start;
    let mut source = BufReader::with_capacity(1 << 16, file.take(length));
    if choice.array.format == "ascii" {
        // A value takes a character and the blank before the next.
        if count as u64 > length.div_ceil(2) {
            return Err(ReadError::damaged(path, format!("{length} characters cannot hold {count} values")));
        }
        return scalar.parse(&mut source, count).map_err(system);
    }
    let framing = Framing { wide: header.wide, order: header.order, zlib: is_zlib(path, header)? };
    let want = count as u64 * scalar.size_bytes();
    let mut bytes = if base64 {
        framing.open(Base64Text::new(source), length / 4 * 3, want)
    } else {
        framing.open(source, length, want)
    }
    .map_err(system)?;
    scalar.decode(&mut bytes, header.order, count).map_err(system)
}

fn is_zlib(path: &Path, header: &Header) -> Result<bool, ReadError> {
    match header.compressor.as_deref() {
        None => Ok(false),
        Some("vtkZLibDataCompressor") => Ok(true),
        Some(other) => {
            let what = format!("data packed by {other}");
            Err(ReadError::unsupported(path, what, "write it with vtkZLibDataCompressor or without a compressor"))
        }
    }
}
