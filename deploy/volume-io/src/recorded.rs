//! Recorded steps: VDIs and reduced volumes in files, those that were coded after others with the files beside them.

use crate::ReadError;
use lamina_codec::volume::{ReferenceVolume, coded_after, decode_after};
use lamina_codec::{CodecError, DecodeLimits, decode_any, decode_any_after, sequence};
use lamina_model::Intermediate;
use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// The step recorded in `path`. A volume that was coded after others is read with these, which lie in the same folder.
///
/// # Errors
/// If a file cannot be read or is no recorded step, or the one that a step was coded after is not in its folder.
pub fn read_recorded(path: &Path) -> Result<Intermediate, ReadError> {
    decoded(&chain(path)?)
}

/// The step as [`read_recorded`] gives it, and its bytes with those of the ones that it was coded after: they decode without any other file.
///
/// # Errors
/// As [`read_recorded`].
pub fn read_with_bytes(path: &Path) -> Result<(Intermediate, Vec<u8>), ReadError> {
    let chain = chain(path)?;
    let step = decoded(&chain)?;
    let mut files: Vec<Vec<u8>> = chain.into_iter().rev().map(|(_, bytes)| bytes).collect();
    Ok((step, if files.len() == 1 { files.remove(0) } else { sequence(&files) }))
}

/// The first step of a chain.
fn decoded(chain: &[(PathBuf, Vec<u8>)]) -> Result<Intermediate, ReadError> {
    let limits = DecodeLimits::default();
    let failed = |path: &Path| {
        let path = path.to_owned();
        move |source| ReadError::Recorded { path, source }
    };
    let mut reference = None;
    for (file, bytes) in chain.iter().skip(1).rev() {
        let volume = decode_after(bytes, &limits, reference.as_ref()).map_err(failed(file))?;
        reference = Some(ReferenceVolume::new(bytes, &volume));
    }
    let (file, bytes) = &chain[0];
    decode_any_after(bytes, &limits, |_| reference).map_err(failed(file))
}

/// The file `path` and its bytes, then what it was coded after, back to a key frame.
fn chain(path: &Path) -> Result<Vec<(PathBuf, Vec<u8>)>, ReadError> {
    let mut chain = vec![(path.to_owned(), read(path)?)];
    while let Some((file, bytes)) = chain.last() {
        let Some(checksum) = coded_after(bytes) else { break };
        let before = beside(file, checksum, &chain)?;
        let bytes = read(&before)?;
        chain.push((before, bytes));
    }
    Ok(chain)
}

/// All of a file, unless its first bytes are of no recorded step: something else may be large.
fn read(path: &Path) -> Result<Vec<u8>, ReadError> {
    let unreadable = |source| ReadError::Io { path: path.to_owned(), source };
    let (mut file, mut bytes) = (File::open(path).map_err(unreadable)?, Vec::new());
    file.by_ref().take(4).read_to_end(&mut bytes).map_err(unreadable)?;
    if let Err(source @ CodecError::NotAVdi) = decode_any(&bytes, &DecodeLimits::default()) {
        return Err(ReadError::Recorded { path: path.to_owned(), source });
    }
    file.read_to_end(&mut bytes).map_err(unreadable)?;
    Ok(bytes)
}

/// The file with this checksum in the folder of `path`, but none of `chain`.
fn beside(path: &Path, checksum: u32, chain: &[(PathBuf, Vec<u8>)]) -> Result<PathBuf, ReadError> {
    let folder = path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
    let unreadable = |source| ReadError::Io { path: folder.to_owned(), source };
    let is_step = |file: &PathBuf| file.extension().and_then(OsStr::to_str).is_some_and(|e| e == "vdi" || e == "lvol");
    let files = fs::read_dir(folder).map_err(unreadable)?.flatten().map(|entry| entry.path());
    let mut files: Vec<PathBuf> = files.filter(is_step).collect();
    // The one before comes first, by its name.
    files.sort_by(|a, b| (a.as_path() >= path, b).cmp(&(b.as_path() >= path, a)));
    let is_it = |file: &PathBuf| {
        chain.iter().all(|(known, _)| known.file_name() != file.file_name()) && last_four(file).ok() == Some(checksum)
    };
    let missing = || ReadError::Predecessor { path: path.to_owned(), checksum };
    files.into_iter().find(is_it).ok_or_else(missing)
}

/// The checksum that a recorded step ends with.
fn last_four(path: &Path) -> io::Result<u32> {
    let (mut file, mut four) = (File::open(path)?, [0; 4]);
    file.seek(SeekFrom::End(-4))?;
    file.read_exact(&mut four)?;
    Ok(u32::from_le_bytes(four))
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamina_codec::ErrorMeasure;
    use lamina_codec::volume::encode_after;
    use lamina_model::{Grid, ReducedVolume, Volume, VolumeParams, Voxels, suggest::suggest};

    fn volume(at: f32) -> ReducedVolume {
        let grid = Grid::new([16; 3], glam::DVec3::ONE, glam::DVec3::ZERO).unwrap();
        let unit = |n: usize| {
            let [x, y, z] = [n % 16, n / 16 % 16, n / 256].map(|i| i as f32 - 8.0);
            0.9 * (-0.08 * ((x - at).powi(2) + y * y + z * z)).exp()
        };
        let units: Vec<f32> = (0..grid.voxels()).map(unit).collect();
        let mut scene = suggest(&[&Volume::new(grid, Voxels::F32(units.clone())).unwrap()]).unwrap();
        scene.transfer = scene.transfer.with_unit_length(1.0);
        ReducedVolume::new(grid, scene, VolumeParams::new(16, 0.01).unwrap(), units).unwrap()
    }

    #[test]
    fn a_step_is_read_with_those_it_was_coded_after_and_a_missing_one_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = |step: usize| folder.path().join(format!("step_{step:06}.vdi"));
        let mut before: Option<ReferenceVolume> = None;
        for step in 0..4 {
            let volume = volume(0.5 * step as f32);
            let (bytes, next) = encode_after(&volume, ErrorMeasure::Maximum, before.as_ref());
            before = Some(next);
            fs::write(file(step), bytes).unwrap();
        }
        fs::write(folder.path().join("step_000001.row"), "1,2").unwrap();
        for step in 0..4 {
            let Intermediate::Volume(read) = read_recorded(&file(step)).unwrap() else { unreachable!() };
            let wanted = volume(0.5 * step as f32);
            let off = read.units().iter().zip(wanted.units()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(off <= 0.01001, "step {step}: {off}");
        }
        // By another name it is found as well.
        fs::rename(file(1), folder.path().join("a.lvol")).unwrap();
        assert!(read_recorded(&file(3)).is_ok());
        fs::remove_file(folder.path().join("a.lvol")).unwrap();
        let error = read_recorded(&file(3)).unwrap_err();
        assert!(matches!(&error, ReadError::Predecessor { path, .. } if *path == file(2)), "{error}");
        // A circle of files that claim each other ends.
        let mut bytes = fs::read(file(2)).unwrap();
        let own = bytes.last_chunk::<4>().copied().unwrap();
        let at = bytes.windows(4).position(|w| w == last_four_of_missing(&error)).unwrap();
        bytes[at..at + 4].copy_from_slice(&own);
        fs::write(file(2), &bytes).unwrap();
        assert!(read_recorded(&file(2)).is_err());
        let other = folder.path().join("other.vdi");
        fs::write(&other, "a picture").unwrap();
        let error = read_recorded(&other).unwrap_err().to_string();
        assert!(error.contains("other.vdi") && error.contains("not a VDI"), "{error}");
    }

    fn last_four_of_missing(error: &ReadError) -> [u8; 4] {
        let ReadError::Predecessor { checksum, .. } = error else { unreachable!() };
        checksum.to_le_bytes()
    }
}
