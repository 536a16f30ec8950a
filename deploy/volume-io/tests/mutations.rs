//! Damaged files of every kind end in a volume or an error: no panic, no memory beyond what the file could fill.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod damage;

use damage::damage;
use fastrand::Rng;
use lamina_volume_io::{Options, Series};
use std::fs;
use std::path::Path;

/// Cases per fixture; with some forty fixtures this makes thousands.
const CASES: u64 = 120;

/// Address space that the cases together may add; one believed lie about a size would exceed it by far.
const ALLOWANCE_KIB: u64 = 256 << 10;

#[cfg(target_os = "linux")]
fn peak_kib() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    status.lines().find_map(|line| line.strip_prefix("VmPeak:")?.split_whitespace().next()?.parse().ok())
}

#[cfg(not(target_os = "linux"))]
fn peak_kib() -> Option<u64> {
    None
}

fn read(path: &Path) -> bool {
    let series = Series::open(path, &Options::default());
    series.is_ok_and(|series| series.read(0).is_ok())
}

#[test]
fn damaged_files_neither_panic_nor_grow() {
    let folder = tempfile::tempdir().unwrap();
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures");
    let mut files: Vec<_> = fs::read_dir(&fixtures).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|file| file.is_file());
    files.sort();
    for file in &files {
        fs::copy(file, folder.path().join(file.file_name().unwrap())).unwrap();
    }
    let pvd = folder.path().join("a.pvd");
    let entries = [(0.0, "cell_data.vti".to_owned()), (1.0, "extent_start.vti".to_owned())];
    lamina_volume_io::write_pvd(&pvd, &entries).unwrap();
    files.push(pvd);
    let (mut random, mut read_anyway, mut refused) = (Rng::with_seed(1), 0, 0);
    let before = peak_kib();
    for file in &files {
        let name = file.file_name().unwrap();
        // What data files beside a header hold is damaged through the header's eyes.
        let opened = match name.to_str().unwrap() {
            "detached_gzip.raw.gz" => folder.path().join("detached_gzip.nhdr"),
            "detached_raw.raw" => folder.path().join("detached_raw.nhdr"),
            _ => folder.path().join(name),
        };
        if !read(&opened) {
            continue;
        }
        let target = folder.path().join(name);
        let whole = fs::read(&target).unwrap();
        for _ in 0..CASES {
            fs::write(&target, damage(&whole, &mut random)).unwrap();
            if read(&opened) { read_anyway += 1 } else { refused += 1 }
        }
        fs::write(&target, whole).unwrap();
    }
    assert!(read_anyway > 500 && refused > 1500, "{read_anyway} read, {refused} refused");
    if let (Some(before), Some(after)) = (before, peak_kib()) {
        assert!(after < before + ALLOWANCE_KIB, "peak grew from {before} to {after} KiB");
    }
}
