//! One run's folder: `run.json`, `steps.csv`, and `step_000012.vdi` for every step; `step_000012.row` while its quality is to be
//! measured.

use super::error::StoreError;
use super::row::{QualityStatus, StepRow};
use super::run::Run;
use std::cmp::Reverse;
use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

/// An open folder, ready for more steps.
#[derive(Debug)]
pub(super) struct Folder {
    path: PathBuf,
    csv: File,
}

fn failed(path: &Path) -> impl Fn(std::io::Error) -> StoreError {
    let path = path.display().to_string();
    move |reason| StoreError::Folder { path: path.clone(), reason }
}

impl Folder {
    /// The folder of `run` below `root`, made if there is none, and the steps recorded in it.
    pub(super) fn open(root: &Path, run: &Run) -> Result<(Self, Vec<StepRow>), StoreError> {
        let path = root.join(&run.id);
        fs::create_dir_all(&path).map_err(failed(&path))?;
        let description = path.join("run.json");
        if !description.exists() {
            let json = serde_json::to_vec_pretty(run).map_err(|e| failed(&description)(e.into()))?;
            replace(&description, &json).map_err(failed(&description))?;
        }
        let (mut rows, csv) = open_rows(&path)?;
        let mut folder = Self { path, csv };
        for row in pending_rows(&folder.path) {
            if rows.iter().all(|known| known.step != row.step) {
                folder.settle(&row)?;
                rows.push(row);
            }
        }
        Ok((folder, rows))
    }

    /// The run in `root` whose description is youngest; `None` if there is none.
    pub(super) fn newest(root: &Path) -> Result<Option<(Run, Self, Vec<StepRow>)>, StoreError> {
        fs::create_dir_all(root).map_err(failed(root))?;
        let Some(run) = recorded_runs(root)?.into_iter().next() else { return Ok(None) };
        let (folder, rows) = Self::open(root, &run)?;
        Ok(Some((run, folder, rows)))
    }

    /// Where it is.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    fn vdi_path(&self, step: u64) -> PathBuf {
        vdi_path(&self.path, step)
    }

    /// Writes the step's bytes, then its row: in a file of its own while more is to come, in `steps.csv` otherwise. A folder that
    /// was removed is made again.
    pub(super) fn record(&mut self, row: &StepRow, bytes: &[u8]) -> Result<(), StoreError> {
        if !self.path.exists() {
            fs::create_dir_all(&self.path).map_err(failed(&self.path))?;
            self.csv = open_rows(&self.path)?.1;
        }
        let path = self.vdi_path(row.step);
        replace(&path, bytes).map_err(failed(&path))?;
        if row.measured == QualityStatus::Pending {
            let path = row_path(&self.path, row.step);
            return replace(&path, row.to_csv().as_bytes()).map_err(failed(&path));
        }
        self.append(row)
    }

    /// Writes the row of a step that was pending to `steps.csv`.
    pub(super) fn settle(&mut self, row: &StepRow) -> Result<(), StoreError> {
        self.append(row)?;
        // Where it stays, it is passed over when the folder is opened again.
        let _ = fs::remove_file(row_path(&self.path, row.step));
        Ok(())
    }

    fn append(&mut self, row: &StepRow) -> Result<(), StoreError> {
        let length = self.csv.metadata().map_err(failed(&self.path))?.len();
        let written = self.csv.write_all(row.to_csv().as_bytes());
        if written.is_err() {
            // Half a row would spoil the next one.
            let _ = self.csv.set_len(length);
        }
        written.map_err(failed(&self.path))
    }

    /// The step's bytes.
    pub(super) fn read(&self, step: u64) -> Result<Vec<u8>, StoreError> {
        recorded_bytes(&self.path, step)
    }
}

/// The runs recorded in `root`, the one whose description is youngest first.
pub(super) fn recorded_runs(root: &Path) -> Result<Vec<Run>, StoreError> {
    let mut runs = Vec::new();
    for entry in fs::read_dir(root).map_err(failed(root))?.flatten() {
        let description = entry.path().join("run.json");
        let Ok(modified) = fs::metadata(&description).and_then(|m| m.modified()) else { continue };
        let run = serde_json::from_slice::<Run>(&fs::read(&description).unwrap_or_default()).ok();
        match run.filter(|run| entry.file_name() == *run.id) {
            Some(run) => runs.push((modified, run)),
            None => {
                tracing::warn!(file = %description.display(), "not the description of this folder's run; left alone")
            }
        }
    }
    runs.sort_by_key(|(modified, _)| Reverse(*modified));
    Ok(runs.into_iter().map(|(_, run)| run).collect())
}

/// The settled rows of the run in `folder`, which stays as it is.
pub(super) fn recorded_rows(folder: &Path) -> Result<Vec<StepRow>, StoreError> {
    Ok(read_rows(folder)?.0)
}

/// The bytes of a step recorded in `folder`.
pub(super) fn recorded_bytes(folder: &Path, step: u64) -> Result<Vec<u8>, StoreError> {
    let path = vdi_path(folder, step);
    fs::read(&path).map_err(failed(&path))
}

fn vdi_path(folder: &Path, step: u64) -> PathBuf {
    folder.join(format!("step_{step:06}.vdi"))
}

/// True if the file of a step has all the bytes that its row states.
fn is_whole(folder: &Path, row: &StepRow) -> bool {
    fs::metadata(vdi_path(folder, row.step)).is_ok_and(|file| file.len() >= row.size_bytes)
}

fn row_path(folder: &Path, step: u64) -> PathBuf {
    folder.join(format!("step_{step:06}.row"))
}

/// Rows that were pending when the run was left: nobody will measure them.
fn pending_rows(folder: &Path) -> Vec<StepRow> {
    let files = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let lines = files.filter(|f| f.extension().is_some_and(|e| e == "row")).filter_map(|f| fs::read_to_string(f).ok());
    let rows = lines.filter_map(|line| StepRow::from_csv(&line)).filter(|row| is_whole(folder, row));
    let mut rows: Vec<StepRow> = rows.map(|row| StepRow { measured: QualityStatus::Skipped, ..row }).collect();
    rows.sort_by_key(|row| row.step);
    rows
}

/// The rows of `folder`, and its `steps.csv` ready for more. What is in the file stays: a last line that a kill cut short is ended.
fn open_rows(folder: &Path) -> Result<(Vec<StepRow>, File), StoreError> {
    let (rows, bytes) = read_rows(folder)?;
    let path = folder.join("steps.csv");
    let mut csv = OpenOptions::new().create(true).append(true).open(&path).map_err(failed(&path))?;
    if bytes.is_empty() {
        csv.write_all(StepRow::csv_header().as_bytes()).map_err(failed(&path))?;
    } else if !bytes.ends_with(b"\n") {
        writeln!(csv).map_err(failed(&path))?;
    }
    Ok((rows, csv))
}

/// The rows of `folder`, and the bytes of its `steps.csv`. A line that is no row is passed over and said. So is a row whose bytes are not there, as
/// after a power cut: the system may write files in another order than they were written in.
fn read_rows(folder: &Path) -> Result<(Vec<StepRow>, Vec<u8>), StoreError> {
    let path = folder.join("steps.csv");
    let bytes = match fs::read(&path) {
        Ok(bytes) => bytes,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Vec::new(),
        Err(e) => return Err(failed(&path)(e)),
    };
    let text = String::from_utf8_lossy(&bytes);
    let (mut rows, mut passed_over, mut lost) = (Vec::new(), 0, Vec::new());
    let columns = |line: &str| line.split(',').count();
    let whole = [text.lines().next().map_or(0, columns), columns(StepRow::csv_header())];
    for line in text.lines().skip(1).filter(|l| !l.is_empty()) {
        // What was cut short may look like a line of an earlier version.
        let row = StepRow::from_csv(line).filter(|_| whole.contains(&columns(line)));
        match row {
            Some(row) if is_whole(folder, &row) => rows.push(row),
            Some(row) => lost.push(row.step),
            None => passed_over += 1,
        }
    }
    if passed_over > 0 {
        tracing::warn!(file = %path.display(), passed_over, "lines that are no row");
    }
    if !lost.is_empty() {
        tracing::warn!(folder = %folder.display(), steps = ?lost, "steps whose files are missing or cut short");
    }
    Ok((rows, bytes))
}

/// Writes a file beside its name, then gives it the name: a reader sees all of it or the old one.
fn replace(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let fresh = path.with_extension("new");
    fs::write(&fresh, bytes)?;
    fs::rename(&fresh, path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamina_model::{Cost, Frame};

    #[test]
    fn damage_to_the_rows_costs_no_other_row_and_a_removed_folder_is_made_again() {
        let root = tempfile::tempdir().unwrap();
        let run = Run { id: "r-1".into(), name: "r".into(), field: "f".into(), dims: [1; 3] };
        let row = |step| StepRow::live(&Frame { step, ..Frame::default() }, false);
        let (mut folder, rows) = Folder::open(root.path(), &run).unwrap();
        assert!(rows.is_empty());
        for step in 0..4 {
            folder.record(&row(step), b"vdi").unwrap();
        }
        // A flipped byte in row 1, and a last row cut short.
        let csv = root.path().join("r-1/steps.csv");
        let mut bytes = fs::read(&csv).unwrap();
        let lines: Vec<usize> = bytes.iter().enumerate().filter(|(_, b)| **b == b'\n').map(|(i, _)| i).collect();
        bytes[lines[1] + 1] = 0xff;
        bytes.truncate(bytes.len() - 9);
        fs::write(&csv, &bytes).unwrap();
        let steps = |rows: &[StepRow]| rows.iter().map(|r| r.step).collect::<Vec<_>>();
        let (mut folder, rows) = Folder::open(root.path(), &run).unwrap();
        assert_eq!(steps(&rows), [0, 2]);
        folder.record(&row(9), b"vdi").unwrap();
        let (_, rows) = Folder::open(root.path(), &run).unwrap();
        assert_eq!(steps(&rows), [0, 2, 9]);
        assert!(fs::read(&csv).unwrap().starts_with(&bytes), "nothing in the file was rewritten");

        // A step that was to be measured when the node was killed.
        folder.record(&StepRow::live(&Frame { step: 8, ..Frame::default() }, true), b"vdi").unwrap();
        let (_, rows) = Folder::open(root.path(), &run).unwrap();
        assert_eq!((steps(&rows), rows[3].measured), (vec![0, 2, 9, 8], QualityStatus::Skipped));
        let (mut folder, rows) = Folder::open(root.path(), &run).unwrap();
        assert_eq!(steps(&rows), [0, 2, 9, 8], "once");

        // After a power cut: a row whose file is gone, and two whose files are empty or short.
        let full = Cost { size_bytes: 3, ..Cost::default() };
        for (step, left) in [(20, None), (21, Some(0)), (22, Some(2)), (23, Some(3))] {
            folder.record(&StepRow::live(&Frame { step, cost: full, ..Frame::default() }, false), b"vdi").unwrap();
            match left {
                Some(bytes) => File::options().write(true).open(folder.vdi_path(step)).unwrap().set_len(bytes).unwrap(),
                None => fs::remove_file(folder.vdi_path(step)).unwrap(),
            }
        }
        let (mut folder, rows) = Folder::open(root.path(), &run).unwrap();
        assert_eq!(steps(&rows), [0, 2, 9, 8, 23]);
        // It comes again from the generator-node.
        folder.record(&StepRow::live(&Frame { step: 20, cost: full, ..Frame::default() }, false), b"vdi").unwrap();
        let (mut folder, rows) = Folder::open(root.path(), &run).unwrap();
        assert!(rows.iter().filter(|row| row.step == 20).count() >= 1);

        fs::remove_dir_all(root.path().join("r-1")).unwrap();
        folder.record(&row(10), b"vdi").unwrap();
        assert_eq!(folder.read(10).unwrap(), b"vdi");
    }
}
