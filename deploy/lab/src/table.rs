//! A CSV file with a header, for other programs.

use anyhow::Context;
use std::fs::File;
use std::path::{Path, PathBuf};

/// An open table; a file that is there is written anew.
pub(crate) struct Table {
    path: PathBuf,
    csv: csv::Writer<File>,
}

impl Table {
    /// `folder/name` with these columns.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn create<T: AsRef<[u8]>>(
        folder: &Path,
        name: &str,
        columns: impl IntoIterator<Item = T>,
    ) -> anyhow::Result<Self> {
        let path = folder.join(name);
        let csv = csv::Writer::from_path(&path).with_context(|| unwritable(&path))?;
        let mut table = Self { path, csv };
        table.row(columns)?;
        Ok(table)
    }

    /// Adds a row, a field for each column.
    ///
    /// # Errors
    /// If it cannot be written, or has another number of fields than the header.
    pub(crate) fn row<T: AsRef<[u8]>>(&mut self, fields: impl IntoIterator<Item = T>) -> anyhow::Result<()> {
        self.csv.write_record(fields).with_context(|| unwritable(&self.path))
    }

    /// Writes what is not written yet.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn finish(mut self) -> anyhow::Result<()> {
        self.csv.flush().with_context(|| unwritable(&self.path))
    }
}

fn unwritable(path: &Path) -> String {
    format!("{}: cannot be written", path.display())
}
