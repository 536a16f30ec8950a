//! `lamina-lab accuracy` as a user runs it, on the recorded blast.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use lamina_tests::processes::{recorded_series, run};
use std::collections::HashMap;
use std::fs;
use std::path::Path;

/// Lines as fields by the header's names.
fn table(path: &Path) -> Vec<HashMap<String, String>> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let head: Vec<String> = lines.next().unwrap().split(',').map(str::to_owned).collect();
    lines
        .map(|line| {
            let fields: Vec<String> = line.split(',').map(str::to_owned).collect();
            assert_eq!(fields.len(), head.len(), "{line}");
            head.iter().cloned().zip(fields).collect()
        })
        .collect()
}

fn number(row: &HashMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap_or_else(|_| panic!("{column} of {row:?}"))
}

#[test]
fn every_knob_is_measured_and_errors_fall_with_the_step() {
    let folder = tempfile::tempdir().unwrap();
    let (series, out) = (recorded_series(), folder.path().join("accuracy"));
    let arguments = [
        "accuracy",
        series.to_str().unwrap(),
        "--time-step",
        "6",
        "--size",
        "48",
        "--resolution",
        "24",
        "--psnr",
        "30",
        "--tricubic",
        "--out",
        out.to_str().unwrap(),
    ];
    let output = run("lamina-lab", &arguments);
    let [said, error] = [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned());
    assert!(output.status.success(), "{error}");
    assert!(error.contains("meets 3 closed forms") && error.contains("reference converged"), "{error}");
    assert!(said.contains("30 dB, least time: r ") && said.contains("30 dB, ray casting: step "), "{said}");

    let rows = table(&out.join("accuracy.csv"));
    let of = |knob: &str| -> Vec<&HashMap<String, String>> { rows.iter().filter(|r| r["knob"] == knob).collect() };
    for knob in ["raycast_step", "raycast_step_integrated", "midpoint_f64", "midpoint_f32", "preintegrated"] {
        let db: Vec<f64> = of(knob).iter().map(|r| number(r, "psnr_db")).collect();
        assert_eq!(db.len(), 6, "{knob}");
        assert!(db.windows(2).all(|w| w[1] > w[0] + 5.0), "{knob}: {db:?} as the step falls");
        let order = number(of(knob)[0], "order");
        assert!((1.5..2.4).contains(&order), "{knob}: order {order}");
    }
    for (knob, count) in [
        ("step", 6),
        ("step_integrated", 6),
        ("opacity_cutoff", 9),
        ("gamma", 8),
        ("resolution", 8),
        ("color_bits", 8),
        ("blended", 2),
    ] {
        let rows = of(knob);
        assert_eq!(rows.len(), count, "{knob}");
        assert!(number(rows[count - 1], "psnr_db") > number(rows[0], "psnr_db") + 0.5, "{knob}: the finest is better");
        assert!(rows.iter().all(|r| number(r, "time_ms") > 0.0 && number(r, "max_error") >= number(r, "rms_error")));
    }
    // The product integrates in single precision, the plain integrator in double: the same method, the same curve.
    for (product, plain) in of("raycast_step_integrated").iter().zip(of("preintegrated")).take(4) {
        let apart = number(product, "psnr_db") - number(plain, "psnr_db");
        assert!(product["pre_integrated"] == "true" && apart.abs() < 1.0, "{apart} dB at {}", product["value"]);
    }
    let resolution = of("resolution");
    assert!(resolution.windows(2).all(|w| number(w[1], "size_bytes") > number(w[0], "size_bytes")));
    assert!(resolution.iter().skip(1).any(|r| number(r, "kb_per_db") > 0.0), "decibels have a price");
    let [depth, color] = ["depth_bits", "color_bits"].map(of);
    assert!(number(depth[0], "size_bytes") < number(depth[depth.len() - 1], "size_bytes"));
    assert!(color[7]["size_bytes"].is_empty(), "the codec cannot store twelve bits");
    assert!(!of("combined").is_empty() && !of("sample_px").is_empty());
    for knob in ["nearest", "trilinear", "tricubic"] {
        assert!(of(knob).len() >= 3, "{knob}");
    }

    let report = fs::read_to_string(out.join("report.html")).unwrap();
    for part in
        ["Across knobs", "Sampling step", "Opacity cut-off", "Gamma", "Stored bits of color", "Interpolation", "order "]
    {
        assert!(report.contains(part), "{part}");
    }
    assert!(report.matches("<svg").count() >= 20, "{} plots", report.matches("<svg").count());
    for leak in ["src=\"http", "<script", "<link", "NaN"] {
        assert!(!report.contains(leak), "{leak}");
    }
    assert!(fs::read_to_string(out.join("accuracy.svg")).unwrap().starts_with("<svg xmlns="));
}

#[test]
fn what_cannot_be_measured_is_refused_before_work_starts() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out").display().to_string();
    let series = recorded_series().display().to_string();
    let refused = |input: &str, options: &[&str], words: &str| {
        let output = run("lamina-lab", &[&["accuracy", input, "--out", &out][..], options].concat());
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && error.contains(words) && !error.contains("panicked"), "{words}: {error}");
        assert!(!Path::new(&out).exists(), "nothing is written: {words}");
    };
    refused(&series, &["--psnr", "0"], "--psnr 0");
    refused(&series, &["--psnr", "NaN"], "--psnr NaN");
    refused(&series, &["--size", "8"], "--size 8");
    refused(&series, &["--size", "99999"], "image size");
    refused(&series, &["--resolution", "0"], "resolution");
    refused(&series, &["--gamma", "-1"], "gamma");
    refused(&series, &["--step", "0"], "step_voxels");
    refused(&series, &["--time-step", "99"], "--time-step 99");

    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        path.display().to_string()
    };
    let nan: Vec<u8> = std::iter::repeat_n(f32::NAN.to_le_bytes(), 512).flatten().collect();
    refused(&write("nan_8x8x8_float32.raw", &nan), &[], "no voxel is a finite number");
    let clear = write(
        "clear.toml",
        b"[transfer]\nrange = { lo = 0.0, hi = 1.0, scale = \"linear\" }\n\
          points = [{ at = 0.0, color = [1.0, 1.0, 1.0], opacity = 0.0 }]\n",
    );
    refused(&series, &["--scene", &clear], "transparent");
    let shaded = write("shaded.toml", b"[effects]\nambient_occlusion = 0.5\n");
    refused(&series, &["--scene", &shaded], "effects");
}
