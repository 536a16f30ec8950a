//! AMReX plotfiles: folders with a text header and boxes of raw numbers. Read are values of cells, on the finest level or one that is
//! stated: where a level has no box, the next coarser one's values are repeated.
//!
//! The format: <https://amrex-codes.github.io/amrex/docs_html/IO.html> and the headers themselves, version HyperCLaw-V1.1.

use super::axes::AxisRole;
use super::coordinates::Placement;
use super::file::{ArrayFile, ArrayOptions, ArrayStore, FieldArray};
use crate::ReadError;
use crate::missing::Meaning;
use crate::scalars::{ByteOrder, ScalarType};
use lamina_model::Voxels;
use std::fs::{self, File};
use std::io::Read;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// The longest line of numbers before a box, bytes.
const LONGEST_LINE: u64 = 4096;

/// How the header begins; those of AMReX's checkpoints do otherwise.
const BEGINNING: &str = "HyperCLaw";

/// Whether the folder is one.
pub(crate) fn is_plotfile(path: &Path) -> bool {
    let mut start = [0; BEGINNING.len()];
    let read = File::open(path.join("Header")).and_then(|mut header| header.read_exact(&mut start));
    read.is_ok() && start == *BEGINNING.as_bytes() && path.join("Level_0").is_dir()
}

/// Whole numbers in a text, whatever is between them.
fn integers(text: &str) -> Vec<i64> {
    text.split(|c: char| !c.is_ascii_digit() && c != '-').filter_map(|word| word.parse().ok()).collect()
}

/// The first and the last cell of a box, of `((x,y,z) (x,y,z) (type))`.
fn cells(numbers: &[i64]) -> Option<[Range<i64>; 3]> {
    let of = |a: usize| Some(*numbers.get(a)?..numbers.get(a + 3)?.checked_add(1)?);
    let cells = [of(0)?, of(1)?, of(2)?];
    let farthest = 1 << 31;
    cells
        .iter()
        .all(|range| -farthest < range.start && range.start < range.end && range.end < farthest)
        .then_some(cells)
}

/// A level as the header names it.
#[derive(Debug)]
struct MeshLevel {
    domain: [Range<i64>; 3],
    /// Start of the names of its files.
    files: PathBuf,
}

impl MeshLevel {
    /// Cells of the finer level `shown` along one of its own, on each axis.
    fn ratios(&self, shown: &Self) -> Option<[i64; 3]> {
        let of = |a: usize| {
            let [own, finer] = [&self.domain[a], &shown.domain[a]].map(|range| range.end - range.start);
            (finer % own == 0).then_some(finer / own)
        };
        Some([of(0)?, of(1)?, of(2)?])
    }
}

/// Opens the folder.
pub(super) fn open(path: &Path, options: ArrayOptions) -> Result<ArrayFile, ReadError> {
    let file = path.join("Header");
    let text = fs::read_to_string(&file).map_err(|e| ReadError::while_reading(&file, e))?;
    let mut lines = text.lines();
    if !lines.next().is_some_and(|first| first.starts_with(BEGINNING)) {
        return Err(ReadError::damaged(&file, "it does not begin as the header of a plotfile does"));
    }
    let short = |what: &str| ReadError::damaged(&file, format!("its {what} is missing or not a number"));
    let mut next = |what: &str| lines.next().map(str::trim).ok_or_else(|| short(what));
    let count: usize = next("number of components")?.parse().map_err(|_| short("number of components"))?;
    let names: Vec<String> =
        (0..count.min(text.len())).map(|_| next("component").map(str::to_owned)).collect::<Result<_, _>>()?;
    if next("dimension")? != "3" {
        return Err(ReadError::unsupported(&file, "a plotfile that is not of three dimensions", "write one of three"));
    }
    let time: f64 = next("time")?.parse().map_err(|_| short("time"))?;
    let finest: usize = next("finest level")?.parse().map_err(|_| short("finest level"))?;
    let three = |line: &str| -> Result<[f64; 3], ReadError> {
        let numbers: Vec<f64> = line.split_whitespace().filter_map(|word| word.parse().ok()).collect();
        numbers.try_into().map_err(|_| short("extent"))
    };
    let (low, high) = (three(next("lower corner")?)?, three(next("upper corner")?)?);
    next("refinement ratios")?;
    let domains = integers(next("domains")?);
    let files: Vec<PathBuf> = lines
        .map(str::trim)
        .filter(|line| line.starts_with("Level_") && line.contains('/'))
        .map(PathBuf::from)
        .collect();
    let mut levels = Vec::new();
    for (n, files) in files.into_iter().enumerate().take(finest.saturating_add(1)) {
        let domain = domains.get(9 * n..).and_then(cells).ok_or_else(|| short("domain"))?;
        if files.components().any(|part| !matches!(part, std::path::Component::Normal(_))) {
            return Err(ReadError::damaged(&file, format!("{} lies outside of it", files.display())));
        }
        levels.push(MeshLevel { domain, files });
    }
    let shown = options.level.unwrap_or(finest).min(finest);
    if levels.len() <= shown {
        return Err(short("list of levels"));
    }
    levels.truncate(shown + 1);
    if levels.iter().any(|level| level.ratios(&levels[shown]).is_none()) {
        return Err(ReadError::damaged(&file, "a level's domain is no multiple of a coarser one's"));
    }
    let dims = levels[shown].domain.each_ref().map(|range| (range.end - range.start) as usize);
    let place = |a: usize| {
        let spacing = (high[a] - low[a]) / dims[a] as f64;
        Placement::even_from(low[a] + 0.5 * spacing, spacing)
    };
    let field = |(key, name): (usize, String)| FieldArray {
        name,
        key,
        shape: vec![dims[2], dims[1], dims[0]],
        roles: vec![AxisRole::Z, AxisRole::Y, AxisRole::X],
        placement: [0, 1, 2].map(place),
        meaning: Meaning::default(),
    };
    let fields = names.into_iter().enumerate().map(field).collect();
    ArrayFile::new(path, Some(vec![time]), fields, Plotfile { path: path.into(), levels })
}

#[derive(Debug)]
struct Plotfile {
    path: PathBuf,
    /// Up to the one that is read.
    levels: Vec<MeshLevel>,
}

impl ArrayStore for Plotfile {
    fn read(&self, key: usize, region: &[Range<usize>]) -> Result<Voxels, ReadError> {
        let [zs, ys, xs] = [0, 1, 2].map(|axis| region[axis].clone());
        let mut values = Vec::new();
        let count = xs.len() * ys.len() * zs.len();
        let system =
            |e: std::collections::TryReserveError| ReadError::while_reading(&self.path, std::io::Error::other(e));
        values.try_reserve_exact(count).map_err(system)?;
        values.resize(count, f32::NAN);
        let shown = self.levels.len() - 1;
        for n in 0..=shown {
            let Some(ratios) = self.levels[n].ratios(&self.levels[shown]) else { continue };
            let origin = &self.levels[n].domain;
            self.boxes(&self.levels[n], key, |cells, data| {
                // The box as it lies in the region.
                let inside = [(0, &xs), (1, &ys), (2, &zs)].map(|(a, range)| {
                    let at = |cell: i64| ratios[a] * (cell - origin[a].start);
                    let (start, end) = (range.start as i64, range.end as i64);
                    at(cells[a].start).max(start)..at(cells[a].end).min(end)
                });
                let dims = cells.each_ref().map(|range| (range.end - range.start) as usize);
                let cell = |a: usize, at: i64| (at / ratios[a] + origin[a].start - cells[a].start) as usize;
                for z in inside[2].clone() {
                    for y in inside[1].clone() {
                        let row = (cell(2, z) * dims[1] + cell(1, y)) * dims[0];
                        let to = ((z as usize - zs.start) * ys.len() + (y as usize - ys.start)) * xs.len();
                        for x in inside[0].clone() {
                            values[to + x as usize - xs.start] = data.get(row + cell(0, x)) as f32;
                        }
                    }
                }
            })?;
        }
        Ok(Voxels::F32(values))
    }
}

impl Plotfile {
    /// Hands over each box of a level: its cells, and the component's values in them, x fastest.
    fn boxes(
        &self,
        level: &MeshLevel,
        component: usize,
        mut each: impl FnMut([Range<i64>; 3], &Voxels),
    ) -> Result<(), ReadError> {
        let mut name = level.files.clone().into_os_string();
        name.push("_H");
        let header = self.path.join(name);
        let text = fs::read_to_string(&header).map_err(|e| ReadError::while_reading(&header, e))?;
        let folder = level.files.parent().unwrap_or(Path::new(""));
        for line in text.lines().filter_map(|line| line.trim().strip_prefix("FabOnDisk:")) {
            let mut words = line.split_whitespace();
            let (name, at) = (words.next().unwrap_or_default(), words.next().and_then(|word| word.parse().ok()));
            let (Some(at), false) = (at, name.contains(['/', '\\']) || name.is_empty()) else {
                return Err(ReadError::damaged(&header, format!("\"{}\" names no box", line.trim())));
            };
            let (cells, data) = read_box(&self.path.join(folder).join(name), at, component)?;
            each(cells, &data);
        }
        Ok(())
    }
}

/// The box at `at` of a file: a line that says what it holds, then all values of the first component, of the second and so on.
fn read_box(path: &Path, at: u64, component: usize) -> Result<([Range<i64>; 3], Voxels), ReadError> {
    let system = |e| ReadError::while_reading(path, e);
    let file = File::open(path).map_err(system)?;
    let size = file.metadata().map_err(system)?.len();
    let mut start = vec![0; LONGEST_LINE.min(size.saturating_sub(at)) as usize];
    file.read_exact_at(&mut start, at).map_err(system)?;
    let wrong = |what: String| ReadError::damaged(path, format!("no box at {at}: {what}"));
    let end = start.iter().position(|&byte| byte == b'\n').ok_or_else(|| wrong("its line does not end".into()))?;
    let line = String::from_utf8_lossy(&start[..end]).into_owned();
    // FAB ((8, (BITS ..)),(8, (BYTE ORDER ..)))((low) (high) (type)) COMPONENTS
    let about = line.strip_prefix("FAB ").and_then(|line| line.split_once(")))"));
    let (format, of_box) = about.ok_or_else(|| wrong(format!("\"{line}\"")))?;
    let order = integers(format.split_once("),").map_or("", |(_, order)| order));
    let (scalar, order) = match order.split_first() {
        Some((8, bytes)) if bytes == [8, 7, 6, 5, 4, 3, 2, 1] => (ScalarType::F64, ByteOrder::Little),
        Some((8, bytes)) if bytes == [1, 2, 3, 4, 5, 6, 7, 8] => (ScalarType::F64, ByteOrder::Big),
        Some((4, bytes)) if bytes == [4, 3, 2, 1] => (ScalarType::F32, ByteOrder::Little),
        Some((4, bytes)) if bytes == [1, 2, 3, 4] => (ScalarType::F32, ByteOrder::Big),
        _ => return Err(wrong(format!("numbers of the form {format}"))),
    };
    let numbers = integers(of_box);
    let cells = cells(&numbers).ok_or_else(|| wrong(format!("cells {of_box}")))?;
    let components = numbers.get(9).copied().unwrap_or(0);
    if component as i64 >= components {
        return Err(wrong(format!("{components} components")));
    }
    let lengths = cells.iter().map(|range| (range.end - range.start) as u64);
    let count = lengths.fold(1, u64::saturating_mul);
    let size_of_component = count.saturating_mul(scalar.size_bytes());
    let from = (at + end as u64 + 1).saturating_add((component as u64).saturating_mul(size_of_component));
    if from.saturating_add(size_of_component) > size {
        return Err(wrong("the file ends before it does".into()));
    }
    let mut bytes = vec![0; size_of_component as usize];
    file.read_exact_at(&mut bytes, from).map_err(system)?;
    let mut voxels = scalar.filled(count as usize, 0.0).map_err(system)?;
    scalar.decode_at(&mut voxels, 0, &bytes, order).map_err(system)?;
    Ok((cells, voxels))
}
