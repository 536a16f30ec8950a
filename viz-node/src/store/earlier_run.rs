//! Runs recorded before the current one, to be compared with it. They are read and never written.

use super::decoding::{chain, in_one_piece};
use super::folder::{recorded_bytes, recorded_rows, recorded_runs};
use super::{Run, StepRow, Store, StoreError};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

/// The most runs that are listed, the youngest.
const MOST_RUNS: usize = 100;

/// A run that is recorded and not the current one.
#[derive(Debug)]
pub struct EarlierRun {
    run: Run,
    folder: PathBuf,
    rows: BTreeMap<u64, StepRow>,
}

impl Store {
    /// The other runs recorded beside the current one, the youngest first.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub fn earlier_runs(&self) -> Result<Vec<Run>, StoreError> {
        let Some(root) = &self.root else { return Ok(Vec::new()) };
        let current = self.run().map(|run| run.id);
        let others = recorded_runs(root)?.into_iter().filter(|run| Some(&run.id) != current.as_ref());
        Ok(others.take(MOST_RUNS).collect())
    }

    /// One of them.
    ///
    /// # Errors
    /// If it is none of them, or its folder cannot be read.
    pub fn earlier_run(&self, id: &str) -> Result<EarlierRun, StoreError> {
        let (Some(root), Some(run)) = (&self.root, self.earlier_runs()?.into_iter().find(|run| run.id == id)) else {
            return Err(StoreError::NoRun(id.to_owned()));
        };
        let folder = root.join(id);
        let rows = recorded_rows(&folder)?.into_iter().map(|row| (row.step, row)).collect();
        Ok(EarlierRun { run, folder, rows })
    }
}

impl EarlierRun {
    /// What it is.
    pub fn run(&self) -> &Run {
        &self.run
    }

    /// Its steps, by number.
    pub fn rows(&self) -> impl Iterator<Item = &StepRow> {
        self.rows.values()
    }

    /// As [`Store::self_contained`].
    ///
    /// # Errors
    /// As there.
    pub fn self_contained(&self, step: u64) -> Result<Arc<Vec<u8>>, StoreError> {
        let steps = chain(&self.rows, step, |_| false)?;
        in_one_piece(steps, |step| recorded_bytes(&self.folder, step).map(Arc::new))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamina_codec::DecodeLimits;
    use lamina_model::Frame;

    #[test]
    fn other_runs_are_listed_and_read_and_nothing_else_in_the_folder_is() {
        let root = tempfile::tempdir().unwrap();
        let store = Store::open(Some(root.path()), 0, DecodeLimits::default()).unwrap();
        let run = |id: &str| Run { id: id.into(), name: "r".into(), field: "f".into(), dims: [1; 3] };
        let row = |step| StepRow::live(&Frame { step, time: step as f64 / 2.0, ..Frame::default() }, false);
        for id in ["first", "second"] {
            store.begin(run(id)).unwrap();
            (0..3).for_each(|step| store.record(row(step), format!("{id} {step}").into_bytes()).unwrap());
        }
        assert_eq!(store.earlier_runs().unwrap(), [run("first")]);
        let earlier = store.earlier_run("first").unwrap();
        let times: Vec<(u64, f64)> = earlier.rows().map(|row| (row.step, row.time)).collect();
        assert_eq!(times, [(0, 0.0), (1, 0.5), (2, 1.0)]);
        assert_eq!(**earlier.self_contained(1).unwrap(), *b"first 1");
        assert!(matches!(earlier.self_contained(9), Err(StoreError::NoStep(9))));
        for id in ["second", "third", "", ".", "..", "first/", "../first"] {
            assert!(matches!(store.earlier_run(id), Err(StoreError::NoRun(_))), "{id}");
        }
        // A description that names another folder is left alone.
        std::fs::create_dir(root.path().join("copy")).unwrap();
        std::fs::copy(root.path().join("first/run.json"), root.path().join("copy/run.json")).unwrap();
        assert_eq!(store.earlier_runs().unwrap(), [run("first")]);
        let in_memory = Store::open(None, 0, DecodeLimits::default()).unwrap();
        assert_eq!(in_memory.earlier_runs().unwrap(), []);
    }
}
