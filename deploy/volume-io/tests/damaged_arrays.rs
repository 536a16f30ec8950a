//! Damaged files and stores of arrays end in a volume or an error: no panic.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod damage;

use damage::damage;
use fastrand::Rng;
use lamina_volume_io::{Options, Series};
use std::fs;
use std::path::{Path, PathBuf};

/// Cases per file.
const CASES: u64 = 20;

/// All files of a folder, also of those within.
fn files_in(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<_> = entries.flat_map(|path| if path.is_dir() { files_in(&path) } else { vec![path] }).collect();
    files.sort();
    files
}

#[test]
fn damaged_arrays_do_not_panic() {
    let folder = tempfile::tempdir().unwrap();
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/arrays");
    let (mut random, mut read_anyway, mut refused) = (Rng::with_seed(2), 0, 0);
    for file in files_in(&fixtures) {
        let within = file.strip_prefix(&fixtures).unwrap();
        fs::create_dir_all(folder.path().join(within).parent().unwrap()).unwrap();
        fs::copy(&file, folder.path().join(within)).unwrap();
    }
    for target in files_in(folder.path()) {
        // The store or plotfile that it belongs to.
        let opened = folder.path().join(target.strip_prefix(folder.path()).unwrap().iter().next().unwrap());
        let whole = fs::read(&target).unwrap();
        for _ in 0..CASES {
            let damaged = damage(&whole, &mut random);
            // Text may state a shape that is large and fits into memory: nothing is wrong with that, but it takes time.
            let digits = damaged.split(|byte| !byte.is_ascii_digit()).map(<[u8]>::len).max();
            if target.extension().is_none_or(|e| e == "json") && digits > Some(4) {
                continue;
            }
            fs::write(&target, damaged).unwrap();
            let series = Series::open(&opened, &Options::default());
            if series.is_ok_and(|series| series.read(0).is_ok()) { read_anyway += 1 } else { refused += 1 }
        }
        fs::write(&target, whole).unwrap();
    }
    assert!(read_anyway > 500 && refused > 500, "{read_anyway} read, {refused} refused");
}
