//! Volumes that do not fit into memory: generated in slabs, within what the system allows, as if they were read whole.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use lamina_tests::processes::{binary, figure, is_refused, stdout_of};
use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, Output};

/// Points on a side: 131 MB of single precision.
const SIDE: usize = 320;
/// What the process may map, kB: no room for all values beside the program.
const ADDRESS_SPACE: usize = 150_000;

/// Waves that fade from the middle on, written row by row.
fn write_raw(path: &Path) {
    let place = |n: usize| n as f32 / (SIDE - 1) as f32 * 2.0 - 1.0;
    let mut bytes = Vec::with_capacity(4 * SIDE * SIDE * SIDE);
    for (z, y) in (0..SIDE).flat_map(|z| (0..SIDE).map(move |y| (z, y))) {
        for x in 0..SIDE {
            let [x, y, z] = [x, y, z].map(place);
            let value =
                (-3.0 * (x * x + y * y + z * z)).exp() * (1.0 + 0.5 * (9.0 * x).sin() * (7.0 * z + 4.0 * y).cos());
            bytes.extend(value.to_le_bytes());
        }
    }
    std::fs::write(path, bytes).unwrap();
}

/// `lamina` with `arguments`, that may map no more than [`ADDRESS_SPACE`].
fn limited(arguments: &[&str]) -> Output {
    let mut line = format!("ulimit -v {ADDRESS_SPACE}; exec {}", binary("lamina").display());
    arguments.iter().for_each(|argument| write!(line, " '{argument}'").unwrap());
    // Each thread's heap reserves addresses that it does not use.
    let mut command = Command::new("sh");
    command.args(["-c", &line]).env("MALLOC_ARENA_MAX", "1").env("RAYON_NUM_THREADS", "2").output().unwrap()
}

#[test]
fn a_volume_larger_than_memory_is_generated_as_if_it_fitted() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let input = at(&format!("waves_{SIDE}x{SIDE}x{SIDE}_float32.raw"));
    write_raw(Path::new(&input));
    let scene = at("scene.toml");
    let points = "[[transfer.points]]\nat = 0.0\ncolor = [0.0, 0.2, 0.8]\nopacity = 0.0\n\
        [[transfer.points]]\nat = 1.0\ncolor = [1.0, 0.9, 0.3]\nopacity = 0.6\n";
    let stated =
        format!("[transfer]\nrange = {{ lo = 0.05, hi = 1.2, scale = \"linear\" }}\nunit_length = 16.0\n{points}");
    std::fs::write(&scene, stated).unwrap();
    for (representation, resolution) in [("vdi", "128"), ("volume", "96")] {
        let stated = ["generate", &input, "--scene", &scene, "--backend", "cpu"];
        let params = ["--representation", representation, "--resolution", resolution, "--gamma", "0.01"];
        let with = |more: &[&str]| [&stated[..], &params, more].concat().join("\n");
        let (whole, slabs) = (at("whole"), at("slabs"));
        let arguments = with(&["--out", &whole]);
        let arguments: Vec<&str> = arguments.lines().collect();
        assert!(!limited(&arguments).status.success(), "{representation}: it would fit");
        stdout_of("lamina", &arguments);
        let arguments = with(&["--memory", "100MB", "--out", &slabs]);
        let done = limited(&arguments.lines().collect::<Vec<_>>());
        assert!(done.status.success(), "{representation}: {}", String::from_utf8_lossy(&done.stderr));
        let [from_whole, from_slabs] = ["whole.png", "slabs.png"].map(at);
        for (step, picture) in [(&whole, &from_whole), (&slabs, &from_slabs)] {
            stdout_of(
                "lamina",
                &["render", step, "--view", "20", "--backend", "cpu", "--size", "256", "--out", picture],
            );
        }
        let decibels = figure(&stdout_of("lamina", &["compare", &from_whole, &from_slabs]), "psnr_db ");
        assert!(decibels > 50.0, "{representation}: {decibels} dB");
        let bytes = |path: &str| std::fs::metadata(path).unwrap().len() as f64;
        assert!((bytes(&slabs) / bytes(&whole) - 1.0).abs() < 0.03, "{representation}");
    }
    is_refused("lamina", &["generate", &input, "--memory", "65MB", "--out", &at("none")], &["--memory", "a plane of"]);
}

#[test]
fn files_that_are_read_from_their_beginning_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let packed = at("packed_2x2x2_uint8.raw.gz");
    std::fs::write(&packed, [0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 0, 3]).unwrap();
    is_refused(
        "lamina",
        &["generate", &packed, "--memory", "1GB", "--out", &at("none")],
        &["planes of a gzipped file"],
    );
}
