//! The binary `lamina-lab` as its user runs it.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use lamina_tests::processes::{is_refused, recorded_series, run, stdout_of};
use std::path::Path;

fn lab(arguments: &[&str]) -> String {
    stdout_of("lamina-lab", arguments)
}

fn refused(arguments: &[&str], words: &[&str]) {
    is_refused("lamina-lab", arguments, words);
}

fn text(path: &Path) -> String {
    path.display().to_string()
}

#[test]
fn bench_measures_a_volume_and_a_vdi() {
    let folder = tempfile::tempdir().unwrap();
    let (series, vdi) = (text(&recorded_series()), text(&folder.path().join("x.vdi")));
    let few = ["--size", "24,16", "--rounds", "2", "--json"];
    let measured = |input: &str, options: &[&str]| -> Vec<serde_json::Value> {
        let printed = lab(&[&["bench", input][..], &few, options].concat());
        printed.lines().map(|l| serde_json::from_str(l).unwrap()).collect()
    };
    let names = |lines: &[serde_json::Value]| -> Vec<String> {
        assert!(lines.iter().all(|l| l["wall_ms"].as_f64() > Some(0.0) && l["rounds"] == 2), "{lines:?}");
        lines.iter().map(|l| l["name"].as_str().unwrap().to_owned()).collect()
    };
    let lines = measured(&series, &["--resolution", "16", "--gammas"]);
    let drawn = ["render 16 at 24", "blend 16 at 24", "render 16 at 16", "blend 16 at 16"];
    let viewer = [&["decode 16", "prepare VDI 16"][..], &drawn].concat();
    let generator = ["prepare volume", "raycast 24", "raycast 16", "raycast 24 from aside", "raycast 24 to the end"];
    let generated = ["generate 24", "generate 16", "generate 16, 65 gammas", "encode 16"];
    assert_eq!(names(&lines), [&generator[..], &generated, &viewer].concat());
    let made = run("lamina", &["generate", &series, "--resolution", "16", "--out", &vdi]);
    assert!(made.status.success());
    assert_eq!(names(&measured(&vdi, &[])), viewer);
    if cfg!(target_os = "linux") {
        for input in [&series, &vdi] {
            let memory = measured(input, &["--memory", "--resolution", "16"]);
            assert!(memory[0]["vdi_bytes"].as_u64() > Some(0) && memory[0]["peak_bytes"].is_u64(), "{memory:?}");
        }
    }
    refused(&["bench", &series, "--rounds", "0"], &["--rounds"]);
    refused(&["bench"], &["<INPUT>"]);
    let out = text(&folder.path().join("study"));
    refused(&["study", &series, "--steps", "99", "--out", &out], &["--steps 99", "0 to 7"]);
}

#[test]
fn bench_live_measures_a_simulation_alone_and_beside_the_nodes() {
    let run = ["bench-live", "--cells", "16", "--pace", "20", "--seconds", "2", "--busy", "1"];
    let printed = lab(&run);
    let row = |name: &str| -> Vec<f64> {
        let line = printed.lines().find(|l| l.starts_with(name)).unwrap_or_else(|| panic!("no {name} in {printed}"));
        line[name.len()..].split_whitespace().filter_map(|word| word.parse().ok()).collect()
    };
    assert_eq!(row("studies lost"), [0.0, 0.0]);
    assert_eq!(row("steps above the limit"), [0.0, 0.0]);
    assert!(row("steps made").iter().all(|&made| (20.0..=41.0).contains(&made)), "{printed}");
    for name in ["simulate, cores", "generate, cores", "draw, cores", "pictures a second", "picture p95, ms"] {
        let row = row(name);
        assert!(row.len() == 2 && row.iter().all(|&value| value > 0.0), "{name}: {printed}");
    }
    refused(&["bench-live", "--seconds", "0"], &["--seconds"]);
    refused(&["bench-live", "--pace", "-2"], &["--pace"]);
}
