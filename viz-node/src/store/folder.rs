//! One run's folder: `run.json`, `steps.csv`, and `step_000012.vdi` for every step.

use super::{Run, StepRow, StoreError};
use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

/// An open folder, ready for more steps.
pub struct Folder {
    path: PathBuf,
    csv: File,
}

fn failed(path: &Path) -> impl Fn(std::io::Error) -> StoreError {
    let path = path.display().to_string();
    move |reason| StoreError::Folder { path: path.clone(), reason }
}

impl Folder {
    /// The folder of `run` below `root`, made if there is none, and the steps recorded in it.
    pub fn open(root: &Path, run: &Run) -> Result<(Self, Vec<StepRow>), StoreError> {
        let path = root.join(&run.id);
        fs::create_dir_all(&path).map_err(failed(&path))?;
        let description = path.join("run.json");
        if !description.exists() {
            let json = serde_json::to_vec_pretty(run).map_err(|e| failed(&description)(e.into()))?;
            replace(&description, &json).map_err(failed(&description))?;
        }
        let csv_path = path.join("steps.csv");
        let rows = read_rows(&path);
        // A row cut short by a kill is dropped here: the file is written anew, whole, before more is appended.
        let mut text = String::from(StepRow::CSV_HEADER);
        for row in &rows {
            text += "\n";
            text += &row.to_csv();
        }
        text += "\n";
        replace(&csv_path, text.as_bytes()).map_err(failed(&csv_path))?;
        let csv = OpenOptions::new().append(true).open(&csv_path).map_err(failed(&csv_path))?;
        Ok((Self { path, csv }, rows))
    }

    /// The run in `root` whose description is youngest; `None` if there is none.
    pub fn newest(root: &Path) -> Result<Option<(Run, Self, Vec<StepRow>)>, StoreError> {
        fs::create_dir_all(root).map_err(failed(root))?;
        let mut newest = None;
        for entry in fs::read_dir(root).map_err(failed(root))?.flatten() {
            let description = entry.path().join("run.json");
            let Ok(modified) = fs::metadata(&description).and_then(|m| m.modified()) else { continue };
            let Ok(run) = serde_json::from_slice::<Run>(&fs::read(&description).unwrap_or_default()) else {
                tracing::warn!(file = %description.display(), "not a run's description; left alone");
                continue;
            };
            if newest.as_ref().is_none_or(|(time, _)| modified > *time) {
                newest = Some((modified, run));
            }
        }
        let Some((_, run)) = newest else { return Ok(None) };
        let (folder, rows) = Self::open(root, &run)?;
        Ok(Some((run, folder, rows)))
    }

    fn vdi_path(&self, step: u64) -> PathBuf {
        vdi_path(&self.path, step)
    }

    /// Writes the step's bytes, then its row.
    pub fn record(&mut self, row: &StepRow, bytes: &[u8]) -> Result<(), StoreError> {
        let path = self.vdi_path(row.step);
        replace(&path, bytes).map_err(failed(&path))?;
        self.csv.write_all(format!("{}\n", row.to_csv()).as_bytes()).map_err(failed(&self.path))
    }

    /// The step's bytes.
    pub fn read(&self, step: u64) -> Result<Vec<u8>, StoreError> {
        let path = self.vdi_path(step);
        fs::read(&path).map_err(failed(&path))
    }
}

fn vdi_path(folder: &Path, step: u64) -> PathBuf {
    folder.join(format!("step_{step:06}.vdi"))
}

/// Whole rows whose VDI is there.
fn read_rows(folder: &Path) -> Vec<StepRow> {
    let text = fs::read_to_string(folder.join("steps.csv")).unwrap_or_default();
    text.lines().skip(1).filter_map(StepRow::from_csv).filter(|row| vdi_path(folder, row.step).exists()).collect()
}

/// Writes a file beside its name, then gives it the name: a reader sees all of it or the old one.
fn replace(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let fresh = path.with_extension("new");
    fs::write(&fresh, bytes)?;
    fs::rename(&fresh, path)
}
