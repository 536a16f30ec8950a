//! The table: case, stage, backend, error, tolerance.

use std::collections::BTreeSet;
use std::io::Write;

/// What has been measured so far.
pub(crate) struct Table {
    /// Backends that must have run something.
    backends: Vec<String>,
    ran: BTreeSet<String>,
    rows: usize,
    failed: Vec<String>,
}

impl Table {
    /// Nothing yet; `backends` are there.
    pub(crate) fn new(backends: Vec<String>) -> Self {
        let table = Self { backends, ran: BTreeSet::new(), rows: 0, failed: Vec::new() };
        table.print(&row(["case", "stage", "backend", "error", "tolerance"]));
        table
    }

    /// Past the test harness, which keeps back what a test prints until it fails.
    fn print(&self, line: &str) {
        writeln!(std::io::stdout().lock(), "{line}").unwrap();
    }

    /// An error that was measured; NaN fails.
    pub(crate) fn add(&mut self, case: &str, stage: &str, backend: &str, error: f64, tolerance: f64) {
        let kept = error <= tolerance;
        let mut line = row([case, stage, backend, &format!("{error:.1e}"), &format!("{tolerance:.1e}")]);
        if !kept {
            line.push_str("  FAILED");
            self.failed.push(line.clone());
        }
        self.print(&line);
        self.rows += 1;
        self.ran.insert(backend.to_owned());
    }

    /// A stage that a backend cannot run, and why.
    pub(crate) fn pass_over(&self, case: &str, stage: &str, backend: &str, reason: &str) {
        self.print(&format!("{}  not run: {reason}", row([case, stage, backend, "-", "-"])));
    }

    /// Fails with all rows that failed, or if a backend ran nothing.
    pub(crate) fn finish(self) {
        self.print(&format!("{} rows, {} failed", self.rows, self.failed.len()));
        let idle: Vec<&String> = self.backends.iter().filter(|b| !self.ran.contains(*b)).collect();
        assert!(idle.is_empty(), "these backends ran no case: {idle:?}");
        assert!(self.failed.is_empty(), "{} rows failed:\n{}", self.failed.len(), self.failed.join("\n"));
    }
}

fn row([case, stage, backend, error, tolerance]: [&str; 5]) -> String {
    format!("{case:<52} {stage:<10} {backend:<26} {error:>9} {tolerance:>9}")
}
