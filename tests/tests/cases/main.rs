//! Hard cases: every file in tests/cases, run by every backend and every stage, held to a closed form or to a plain
//! double-precision reference within the tolerance that the case states. Prints a table of all of it.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod backends;
mod case;
mod closed;
mod expected;
mod fields;
mod refused;
mod stages;
mod table;

use backends::{casters, drawers};
use case::Case;
use lamina_compute::gpu::{Choice, Gpu};
use std::path::{Path, PathBuf};
use table::Table;

/// The files of the corpus, by name.
fn files() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("cases");
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|e| e == "toml"));
    files.sort();
    files
}

#[test]
fn every_case_keeps_its_tolerance_in_every_stage_on_every_backend() {
    let (casters, drawers) = (casters(), drawers());
    let names = casters.iter().map(|c| c.name()).chain(drawers.iter().map(|d| d.name()));
    let mut table = Table::new(names.collect());
    if let Err(reason) = Gpu::open(Choice::Gpu) {
        table.pass_over("all", "all", "R gpu, I gpu", &reason.to_string());
    }
    let only = std::env::var("CASE").unwrap_or_default();
    let cases: Vec<Case> = files().iter().flat_map(|path| case::read(path)).collect();
    for case in cases.iter().filter(|case| case.name.contains(&only)) {
        stages::run(case, &casters, &drawers, &mut table);
    }
    table.finish();
}

#[test]
fn impossible_input_is_refused_by_name_and_with_a_remedy() {
    let refused: Vec<_> = files().iter().flat_map(|path| refused::read(path)).collect();
    assert!(refused.len() > 10, "{} refusals", refused.len());
    let wrong: Vec<String> = refused.iter().filter_map(refused::Refused::fault).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
