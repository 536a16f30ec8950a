//! What triggers keep of a step, in files that are whole once they are there.

use lamina_model::{Image, RunInfo, Voxels};
use lamina_rpc::daemon::png;
use std::path::{Path, PathBuf};

/// Writes `voxels` of a step of `run` into `folder`.
pub(crate) fn write_raw(folder: PathBuf, run: &RunInfo, step: u64, voxels: Voxels) {
    let [nx, ny, nz] = run.grid.dims();
    let ending = format!("_{nx}x{ny}x{nz}_{}.raw", voxels.voxel_type());
    keep(folder, run, step, &ending, move || Ok(voxels.to_le_bytes(0..voxels.len())));
}

/// Writes a picture of a step of `run` from `angle_deg` into `folder`.
pub(crate) fn write_picture(folder: PathBuf, run: &RunInfo, step: u64, angle_deg: f64, image: Image) {
    let ending =
        if angle_deg == 0.0 { ".png".to_owned() } else { format!("_{}deg.png", (1000.0 * angle_deg).round() / 1000.0) };
    keep(folder, run, step, &ending, move || png(&image).map_err(std::io::Error::other));
}

/// Writes the bytes of a step of `run` into `folder`.
pub(crate) fn write_copy(folder: PathBuf, run: &RunInfo, step: u64, encoded: Vec<u8>) {
    keep(folder, run, step, ".vdi", || Ok(encoded));
}

/// Writes what `bytes` gives into the step's file with this ending, on a thread of its own.
fn keep(
    folder: PathBuf,
    run: &RunInfo,
    step: u64,
    ending: &str,
    bytes: impl FnOnce() -> std::io::Result<Vec<u8>> + Send + 'static,
) {
    let name = format!("{}_{step:06}{ending}", run.id);
    std::thread::spawn(move || write(&folder, &name, step, bytes));
}

fn write(folder: &Path, name: &str, step: u64, bytes: impl FnOnce() -> std::io::Result<Vec<u8>>) {
    let file = folder.join(name).display().to_string();
    match bytes().and_then(|bytes| write_whole(folder, name, &bytes)) {
        Ok(()) => tracing::info!(step, file, "written for a trigger"),
        Err(error) => tracing::error!(step, file, %error, "not written for a trigger"),
    }
}

fn write_whole(folder: &Path, name: &str, bytes: &[u8]) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    let unfinished = folder.join(format!(".{name}.part"));
    let written = std::fs::write(&unfinished, bytes);
    let written = written.and_then(|()| std::fs::rename(&unfinished, folder.join(name)));
    if written.is_err() {
        let _ = std::fs::remove_file(&unfinished);
    }
    written
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_written_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        write_whole(&folder.path().join("deep/er"), "x.raw", &[1, 2, 3]).unwrap();
        assert_eq!(std::fs::read(folder.path().join("deep/er/x.raw")).unwrap(), [1, 2, 3]);
        assert_eq!(std::fs::read_dir(folder.path().join("deep/er")).unwrap().count(), 1, "nothing unfinished stays");
        assert!(write_whole(Path::new("/dev/null/x"), "y", &[]).is_err());
    }
}
