//! A file that was opened: a recorded step, or one step of a volume file.

use glam::DVec3;
use lamina_model::{
    Aabb, Camera, GenerationParams, Grid, Image, Intermediate, ReducedVolume, Scene, Vdi, Volume, VoxelType, suggest,
};
use lamina_raycast::Field;
use lamina_vdi_render::{Backend, Detail, Drawable};
use lamina_volume_io::{Options, RawSpec, Series, read_with_bytes};
use serde::{Deserialize, Serialize};
use std::error::Error;
use std::ffi::CString;
use std::path::{Path, PathBuf};

/// What to open.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Request {
    path: PathBuf,
    /// Step of a series, counted from 0.
    #[serde(default)]
    step: usize,
    /// Array to read, where a file has several.
    field: Option<String>,
    /// Points per side of a raw file, x fastest.
    dims: Option<[usize; 3]>,
    /// Voxel type of a raw file.
    dtype: Option<VoxelType>,
    /// Order of the axes of arrays that do not name them.
    axes: Option<String>,
    /// Of an adaptive mesh.
    level: Option<usize>,
}

/// What is known of it.
#[derive(Serialize)]
struct Description<'a> {
    /// `vdi`, `volume` (reduced) or `file`.
    kind: &'static str,
    /// The recorded camera, or one that suits the data.
    camera: Camera,
    bounds: Aabb,
    /// Arrays that can be copied: name, NumPy's type, shape with the slowest axis first.
    arrays: Vec<(&'static str, &'static str, Vec<usize>)>,
    /// Points per axis.
    dims: Option<[usize; 3]>,
    spacing: Option<DVec3>,
    origin: Option<DVec3>,
    params: Option<GenerationParams>,
    scene: Option<&'a Scene>,
    /// World length of one step of a VDI's depths.
    step_length: Option<f64>,
    background: Option<[f32; 3]>,
    /// Of a volume file.
    field: Option<&'a str>,
    time: Option<f64>,
    /// Number of steps of its series.
    steps: Option<usize>,
}

#[derive(Debug)]
enum Content {
    Vdi(Box<Vdi>),
    Reduced(Box<ReducedVolume>),
    File(Box<Volume>, Box<Scene>),
}

/// The open file; prepared for drawing at its first picture.
#[derive(Debug)]
pub struct OpenedFile {
    content: Content,
    description: CString,
    /// Of a recorded step: its bytes, which decode without any other file.
    encoded: Vec<u8>,
    drawable: Option<Drawable>,
}

impl OpenedFile {
    /// Reads and decodes.
    pub fn open(request: &Request) -> Result<Self, Box<dyn Error>> {
        let name = request.path.extension().map(|e| e.to_string_lossy().to_lowercase());
        match name.as_deref() {
            Some("vdi" | "lvol") => Self::step(&request.path),
            _ => Self::file(request),
        }
    }

    /// A recorded step.
    fn step(path: &Path) -> Result<Self, Box<dyn Error>> {
        let (decoded, encoded) = read_with_bytes(path)?;
        let bytes = ("encoded", "|u1", vec![encoded.len()]);
        let params = Some(decoded.params());
        let (content, description) = match decoded {
            Intermediate::Vdi(vdi) => {
                let header = vdi.header();
                let (side, segments) = (vdi.resolution() as usize, vdi.segments().len());
                let description = Description {
                    step_length: Some(header.step_length),
                    background: Some(header.background),
                    params,
                    arrays: vec![
                        ("offsets", "<u4", vec![side * side + 1]),
                        ("depths", "<u4", vec![segments, 2]),
                        ("colors", "<f4", vec![segments, 4]),
                        ("ends", "<f8", vec![segments, 2, 3]),
                        bytes,
                    ],
                    ..Description::of("vdi", header.camera, header.bounds)
                };
                let description = serde_json::to_vec(&description)?;
                (Content::Vdi(vdi), description)
            }
            Intermediate::Volume(volume) => {
                let scene = volume.scene();
                let mut description = Description {
                    params,
                    scene: Some(scene),
                    ..Description::of("volume", scene.camera, volume.grid().bounds()).on(volume.grid(), VoxelType::F32)
                };
                description.arrays.push(bytes);
                let description = serde_json::to_vec(&description)?;
                (Content::Reduced(volume), description)
            }
        };
        Ok(Self { content, description: CString::new(description)?, encoded, drawable: None })
    }

    /// A step of a volume file.
    fn file(request: &Request) -> Result<Self, Box<dyn Error>> {
        let raw = RawSpec { dims: request.dims, voxel_type: request.dtype, ..RawSpec::default() };
        let axes = request.axes.as_deref().map(str::parse).transpose()?.unwrap_or_default();
        let options = Options { raw, field: request.field.clone(), axes, level: request.level, ..Options::default() };
        let series = Series::open(&request.path, &options)?;
        let volume = series.read(request.step)?;
        let scene = suggest::suggest(&[&volume])?;
        let description = Description {
            scene: Some(&scene),
            field: Some(series.field()),
            time: series.has_times().then(|| series.time(request.step)),
            steps: Some(series.len()),
            ..Description::of("file", scene.camera, volume.grid().bounds())
                .on(volume.grid(), volume.voxels().voxel_type())
        };
        let description = CString::new(serde_json::to_vec(&description)?)?;
        let content = Content::File(Box::new(volume), Box::new(scene));
        Ok(Self { content, description, encoded: Vec::new(), drawable: None })
    }

    /// JSON.
    pub fn description(&self) -> &CString {
        &self.description
    }

    /// Copies one of the arrays.
    pub fn copy(&self, name: &str, to: &mut [u8]) -> Result<(), Box<dyn Error>> {
        match (&self.content, name) {
            (Content::Vdi(_) | Content::Reduced(_), "encoded") => fill(to, self.encoded.iter().map(|&byte| [byte])),
            (Content::Vdi(vdi), "offsets") => fill(to, vdi.offsets().iter().map(|o| o.to_le_bytes())),
            (Content::Vdi(vdi), "depths") => {
                fill(to, vdi.segments().iter().flat_map(|s| [s.start, s.end]).map(u32::to_le_bytes))
            }
            (Content::Vdi(vdi), "colors") => {
                let colors = vdi.segments().iter().flat_map(|s| {
                    let [red, green, blue] = s.color;
                    [red, green, blue, s.opacity() as f32]
                });
                fill(to, colors.map(f32::to_le_bytes))
            }
            (Content::Vdi(vdi), "ends") => fill(
                to,
                ends(vdi).flat_map(|[from, to]| from.to_array().into_iter().chain(to.to_array())).map(f64::to_le_bytes),
            ),
            (Content::Reduced(volume), "values") => fill(to, volume.units().iter().map(|u| u.to_le_bytes())),
            (Content::File(volume, _), "values") => {
                let (voxels, size) = (volume.voxels(), volume.voxels().voxel_type().size_bytes());
                if to.len() != voxels.len() * size {
                    return Err(unfit(to.len(), voxels.len() * size));
                }
                // In pieces: the voxels and two copies need not fit.
                for (n, piece) in to.chunks_mut(size << 20).enumerate() {
                    let first = n << 20;
                    piece.copy_from_slice(&voxels.to_le_bytes(first..first + piece.len() / size));
                }
                Ok(())
            }
            _ => Err(format!("there is no array \"{name}\"").into()),
        }
    }

    /// A picture.
    pub fn draw(&mut self, camera: &Camera, width: u32, height: u32) -> Result<Image, Box<dyn Error>> {
        Ok(Backend::default().render(self.drawable(), camera, width, height, Detail::Cubic)?)
    }

    /// As [`Drawable::half_depths`].
    pub fn half_depths(&mut self, camera: &Camera, width: u32, height: u32) -> Result<Vec<f32>, Box<dyn Error>> {
        Ok(self.drawable().half_depths(camera, width, height)?)
    }

    fn drawable(&mut self) -> &Drawable {
        self.drawable.get_or_insert_with(|| match &self.content {
            Content::Vdi(vdi) => Drawable::new(Intermediate::Vdi(vdi.clone())),
            Content::Reduced(volume) => Drawable::new(Intermediate::Volume(volume.clone())),
            Content::File(volume, scene) => Drawable::Volume(Box::new(Field::new((**volume).clone(), scene))),
        })
    }
}

/// World positions of each supersegment's ends, along the center of its pixel.
fn ends(vdi: &Vdi) -> impl Iterator<Item = [DVec3; 2]> {
    let (header, side) = (vdi.header(), vdi.resolution());
    let pixels = (0..side).flat_map(move |j| (0..side).map(move |i| (i, j)));
    pixels.flat_map(move |(i, j)| {
        let ray = header.camera.pixel_ray(i, j, side, side);
        let (entry, exit) = header.ray_span(i, j).unwrap_or_default();
        // The last step of a ray is cut at the box.
        let at = move |depth: u32| ray.at((entry + f64::from(depth) * header.step_length).min(exit));
        vdi.list(i, j).iter().map(move |s| [at(s.start), at(s.end)])
    })
}

impl Description<'_> {
    fn of(kind: &'static str, camera: Camera, bounds: Aabb) -> Self {
        Self {
            kind,
            camera,
            bounds,
            arrays: Vec::new(),
            dims: None,
            spacing: None,
            origin: None,
            params: None,
            scene: None,
            step_length: None,
            background: None,
            field: None,
            time: None,
            steps: None,
        }
    }

    fn on(self, grid: &Grid, voxels: VoxelType) -> Self {
        let dtype = match voxels {
            VoxelType::U8 => "|u1",
            VoxelType::U16 => "<u2",
            VoxelType::I16 => "<i2",
            VoxelType::F16 => "<f2",
            VoxelType::F32 => "<f4",
            VoxelType::F64 => "<f8",
        };
        let [x, y, z] = grid.dims();
        Self {
            arrays: vec![("values", dtype, vec![z, y, x])],
            dims: Some(grid.dims()),
            spacing: Some(grid.spacing()),
            origin: Some(grid.origin()),
            ..self
        }
    }
}

fn unfit(room: usize, needed: usize) -> Box<dyn Error> {
    format!("room for {room} bytes; the array has {needed}").into()
}

/// Writes all `numbers` of `N` bytes to `to`, which they fill.
fn fill<const N: usize>(to: &mut [u8], numbers: impl Iterator<Item = [u8; N]>) -> Result<(), Box<dyn Error>> {
    let (room, (slots, rest), mut count) = (to.len(), to.as_chunks_mut::<N>(), 0);
    if !rest.is_empty() {
        return Err(unfit(room, room - rest.len()));
    }
    for number in numbers {
        if let Some(slot) = slots.get_mut(count) {
            *slot = number;
        }
        count += 1;
    }
    if count == slots.len() { Ok(()) } else { Err(unfit(room, N * count)) }
}
