//! The binary `lamina` as its user runs it.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::DVec3;
use lamina_model::{Grid, Representation, Volume, Voxels};
use lamina_tests::processes::{binary, figure, is_refused, recorded_series, run, stdout_of};
use lamina_viz_node::store::StepRow;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

fn lamina(arguments: &[&str]) -> String {
    stdout_of("lamina", arguments)
}

fn refused(arguments: &[&str], words: &[&str]) {
    is_refused("lamina", arguments, words);
}

fn text(path: &Path) -> String {
    path.display().to_string()
}

#[test]
fn a_headless_live_run_leaves_what_it_promises() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let printed = lamina(&[
        "live",
        "--cells",
        "64",
        "--steps",
        "3",
        "--headless",
        "--contract",
        "size <= 20kB",
        "--out",
        &text(&out),
    ]);
    assert!(printed.contains("3 steps, 0 broke the contract"), "{printed}");
    let csv = std::fs::read_to_string(out.join("steps.csv")).unwrap();
    assert!(csv.starts_with("step,time,resolution,gamma,size_bytes,generation_ms,psnr_db,"));
    let rows: Vec<StepRow> = csv.lines().skip(1).map(|l| StepRow::from_csv(l).unwrap()).collect();
    assert_eq!(rows.iter().map(|r| r.step).collect::<Vec<_>>(), [0, 1, 2]);
    // The first one too, before anything is tuned: its first VDI is larger.
    assert!(rows.iter().all(|r| r.size_limit_bytes == Some(20_000) && r.size_bytes <= 20_000), "{rows:?}");
    assert!(rows.iter().all(|r| r.psnr_db.is_some() && r.views.len() == 6));
    // All points of so small a volume, finely coded, fit; no VDI of this size comes near.
    assert!(
        rows[1].representation == Representation::Volume && rows[1].psnr_db.is_some_and(|q| f64::from(q) > 50.0),
        "{:?}",
        rows[1]
    );
    let trials = std::fs::read_to_string(out.join("trials.csv")).unwrap();
    let mut studied: Vec<&str> = trials.lines().skip(1).map(|l| l.split(',').next().unwrap()).collect();
    studied.dedup();
    assert!(studied[0] == "0", "{trials}");
    for step in studied {
        let chosen = trials.lines().filter(|l| l.starts_with(&format!("{step},")) && l.contains(",true,"));
        assert_eq!(chosen.count(), 1, "one choice a study: {trials}");
    }
    let report = std::fs::read_to_string(out.join("report.html")).unwrap();
    assert!(report.contains("<svg") && report.contains("data:image/png;base64,"));
    assert!(!report.contains("src=\"http") && !report.contains("<link"), "self-contained");
    for kind in ["shown", "reference"] {
        let picture = out.join(format!("pictures/step_000002_view_30_{kind}.png"));
        assert!(picture.exists(), "{}", picture.display());
    }
    let again = ["live", "--steps", "1", "--headless", "--out", &text(&out)];
    refused(&again, &[&text(&out), "--out"]);
    assert_eq!(std::fs::read_to_string(out.join("steps.csv")).unwrap(), csv, "what was recorded is untouched");
}

/// Killed in mid-run: what was recorded by then is there.
#[test]
fn a_run_that_is_killed_leaves_its_steps_and_trials() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let arguments = ["live", "--steps", "10000", "--headless", "--cells", "24", "--out", &text(&out)];
    let mut run = Command::new(binary("lamina")).args(arguments).stdout(Stdio::null()).spawn().unwrap();
    let read = |name: &str| std::fs::read_to_string(out.join(name)).unwrap_or_default();
    let deadline = Instant::now() + Duration::from_secs(120);
    while read("trials.csv").is_empty() || read("steps.csv").lines().count() < 3 {
        assert!(Instant::now() < deadline && run.try_wait().unwrap().is_none());
        std::thread::sleep(Duration::from_millis(50));
    }
    run.kill().unwrap();
    run.wait().unwrap();
    let (steps, trials) = (read("steps.csv"), read("trials.csv"));
    assert!(steps.ends_with('\n') && steps.lines().nth(1).unwrap().starts_with("0,"), "{steps}");
    let columns = trials.lines().next().unwrap().split(',').count();
    assert!(trials.lines().count() > 2 && trials.lines().all(|l| l.split(',').count() == columns), "{trials}");
    assert!(trials.lines().any(|l| l.contains(",true,")), "{trials}");
}

#[test]
fn the_parts_agree_at_the_generation_view() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| text(&folder.path().join(name));
    let series = text(&recorded_series());
    let (vdi, a, b) = (file("x.vdi"), file("a.pfm"), file("b.pfm"));
    let made = lamina(&["generate", &series, "--time-step", "5", "--resolution", "160", "--gamma", "0", "--out", &vdi]);
    assert_eq!(figure(&made, "size_bytes "), std::fs::metadata(&vdi).unwrap().len() as f64);
    lamina(&["raycast", &series, "--time-step", "5", "--size", "160", "--out", &a]);
    lamina(&["render", &vdi, "--size", "160", "--out", &b]);
    let printed = lamina(&["compare", &a, &b]);
    let last = printed.lines().last().unwrap();
    assert!(figure(last, "psnr_db ") > 45.0, "8-bit colors at the generation view: {last}");
    assert_eq!(figure(&lamina(&["compare", &a, &a]), "psnr_db "), f64::INFINITY);

    let size = |arguments: &[&str]| {
        let common = ["generate", &series, "--time-step", "5", "--resolution", "128", "--gamma", "0.02", "--out", &vdi];
        figure(&lamina(&[&common[..], arguments].concat()), "size_bytes ")
    };
    assert!(size(&[]) < size(&["--layout", "plain"]), "columns take fewer bytes than plain records");
    assert!(size(&["--codec", "zstd"]) > 0.0);
    lamina(&["render", &vdi, "--view", "-40", "--size", "64", "--out", &file("c.png")]);
}

/// A scene file's effects reach pictures, VDIs and a whole run; unknown and contradictory ones are refused by name.
#[test]
fn effects_of_a_scene_are_seen_everywhere() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| text(&folder.path().join(name));
    let scene = |name: &str, body: &str| {
        let path = file(name);
        std::fs::write(&path, body).unwrap();
        path
    };
    let series = text(&recorded_series());
    let lit = "[effects]\nlight = [0.5, 1.0, 1.0]\nshadows = 0.6\nshading = {}\ndepth_cue = { color = [0.0, 0.0, 0.0], strength = 0.5 }\n";
    let (lit, plain) = (scene("lit.toml", lit), scene("plain.toml", ""));
    let pictures = [&lit, &plain].map(|scene| {
        let (vdi, a, b) = (file("x.vdi"), file(&format!("{}.pfm", scene.len())), file("drawn.pfm"));
        let common = [&series, "--time-step", "5", "--scene", scene.as_str()];
        lamina(&[&["raycast"], &common[..], &["--size", "128", "--out", &a]].concat());
        lamina(&[&["generate"], &common[..], &["--resolution", "128", "--gamma", "0", "--out", &vdi]].concat());
        lamina(&["render", &vdi, "--size", "128", "--out", &b]);
        let compared = lamina(&["compare", &a, &b]);
        assert!(figure(compared.lines().last().unwrap(), "psnr_db ") > 40.0, "{scene}: {compared}");
        a
    });
    let changed = lamina(&["compare", &pictures[0], &pictures[1]]);
    assert!(figure(changed.lines().last().unwrap(), "psnr_db ") < 35.0, "{changed}");

    // Over gRPC: the reference pixels of the run have the same effects, or quality would be poor.
    let out = folder.path().join("run");
    let contract = ["--contract", "psnr >= 34dB", "--grid", "96:160:32,0.002:0.01:0.004"];
    lamina(
        &[&["replay", &series, "--headless", "--steps", "2", "--scene", &lit, "--out", &text(&out)], &contract[..]]
            .concat(),
    );
    let csv = std::fs::read_to_string(out.join("steps.csv")).unwrap();
    let quality = csv.lines().skip(1).map(|l| f64::from(StepRow::from_csv(l).unwrap().psnr_db.unwrap()));
    assert!(quality.fold(f64::INFINITY, f64::min) > 25.0, "{csv}");

    for (body, words) in [
        ("[effects]\nfog = 1.0\n", &["fog", "shading"][..]),
        ("[effects]\nshading = {}\n", &["effects.light"]),
        ("[effects]\nlight = [0.0, 0.0, 1.0]\nshadows = 3.0\n", &["effects.shadows"]),
        (
            "[effects.color_field]\nname = \"temperature\"\nrange = { lo = 0.0, hi = 1.0, scale = \"linear\" }\n",
            &["no field \"temperature\"", "density"],
        ),
    ] {
        let path = scene("bad.toml", body);
        refused(&["raycast", &series, "--scene", &path, "--out", &file("x.png")], words);
    }
}

/// A second array gives the colors of pictures, of VDIs and of a run; a reduced volume is never made of it.
#[test]
fn a_second_field_colors_what_is_shown() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| text(&folder.path().join(name));
    let config = lamina_blast::Config { cells: 32, tracer: true, ..Default::default() };
    let mut simulation = lamina_blast::Simulation::new(config).unwrap();
    (0..6).for_each(|_| simulation.advance());
    let grid = Grid::new([32; 3], DVec3::splat(simulation.spacing()), DVec3::splat(simulation.origin())).unwrap();
    let volume = Volume::new(grid, Voxels::F32(simulation.density())).unwrap();
    let volume = volume.with_color_field("gas", Voxels::F32(simulation.tracer().unwrap().to_vec())).unwrap();
    let data = file("blast.vti");
    lamina_volume_io::write_vti(Path::new(&data), &volume, "density").unwrap();
    let scene = file("scene.toml");
    let body = "[effects.color_field]\nname = \"gas\"\nrange = { lo = 0.0, hi = 1.0, scale = \"linear\" }\n\
                points = [{ at = 0.0, color = [0.0, 1.0, 0.0] }, { at = 1.0, color = [1.0, 0.0, 1.0] }]\n";
    std::fs::write(&scene, body).unwrap();
    let (plain, colored, vdi, drawn) = (file("a.pfm"), file("b.pfm"), file("x.vdi"), file("c.pfm"));
    let common = [data.as_str(), "--scene", &scene];
    lamina(&["raycast", &data, "--size", "96", "--out", &plain]);
    lamina(&[&["raycast"], &common[..], &["--size", "96", "--out", &colored]].concat());
    lamina(&[&["generate"], &common[..], &["--resolution", "96", "--gamma", "0.001", "--out", &vdi]].concat());
    lamina(&["render", &vdi, "--size", "96", "--out", &drawn]);
    let db = |a: &str, b: &str| figure(lamina(&["compare", a, b]).lines().last().unwrap(), "psnr_db ");
    assert!(db(&colored, &drawn) > 40.0, "{}", db(&colored, &drawn));
    assert!(db(&colored, &plain) < 35.0, "{}", db(&colored, &plain));

    // Through client, nodes and tuner: what was recorded is what is cast here from the file.
    let out = folder.path().join("run");
    let run = ["--headless", "--contract", "psnr >= 30dB", "--grid", "96:160:32,0.002:0.01:0.004"];
    lamina(&[&["replay"], &common[..], &run[..], &["--out", &text(&out)]].concat());
    let csv = std::fs::read_to_string(out.join("steps.csv")).unwrap();
    let row = StepRow::from_csv(csv.lines().nth(1).unwrap()).unwrap();
    assert!(row.representation == Representation::Vdi && f64::from(row.psnr_db.unwrap()) > 30.0, "{csv}");
    let report = std::fs::read_dir(out.join("pictures")).unwrap().map(|e| text(&e.unwrap().path()));
    let mut pictures: Vec<String> = report.collect();
    pictures.sort();
    for pair in pictures.chunks(2) {
        assert!(db(&pair[0], &pair[1]) > 25.0, "{pair:?}");
    }

    let volumes = [&["--representation", "volume"], &["--out", "x.lvol"][..]].concat();
    refused(&[&["generate"], &common[..], &volumes[..]].concat(), &["gas", "VDI"]);
    let tune = ["--contract", "size <= 90kB", "--representation", "volume"];
    refused(&[&["tune"], &common[..], &tune[..]].concat(), &["second field", "VDI"]);
    refused(&[&["replay"], &common[..], &["--headless", "--representation", "volume"]].concat(), &["gas", "allow vdi"]);
    // The example's own.
    let live = ["live", "--terms", "tracer", "--cells", "24", "--headless", "--steps", "1"];
    let untuned = ["--resolution", "32", "--gamma", "0.1"];
    refused(&[&live[..], &untuned[..], &["--representation", "volume,vdi"]].concat(), &["blast gas", "allow vdi"]);
    let out = text(&folder.path().join("live"));
    lamina(&[&live[..], &untuned[..], &["--out", &out]].concat());
    let report = std::fs::read_to_string(Path::new(&out).join("report.html")).unwrap();
    assert!(report.contains("density and blast gas of blast"));
}

#[test]
fn wrong_arguments_and_files_are_refused_with_the_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        text(&path)
    };
    let series = text(&recorded_series());
    let vdi = text(&folder.path().join("x.vdi"));
    lamina(&["generate", &series, "--resolution", "32", "--out", &vdi]);
    let mut damaged = std::fs::read(&vdi).unwrap();
    let middle = damaged.len() / 2;
    damaged[middle] ^= 1;
    let png = text(&folder.path().join("x.png"));

    refused(&["render", &file("cut.vdi", &damaged[..middle]), "--out", &png], &["cut.vdi"]);
    refused(&["render", &file("flip.vdi", &damaged), "--out", &png], &["flip.vdi", "checksum"]);
    refused(&["render", &file("not.vdi", b"hello"), "--out", &png], &["not.vdi"]);
    refused(&["render", "/dev/zero", "--out", &png], &["/dev/zero"]);
    refused(&["render", &vdi, "--out", "x.jpg"], &[".png or .pfm"]);
    refused(&["generate", &series, "--dims", "8x8x8", "--out", &vdi], &["--dims"]);
    let volume = ["generate", &series, "--representation", "volume", "--out", &vdi];
    for option in [["--codec", "context-mixing"], ["--layout", "plain"], ["--segmentation", "greedy"]] {
        refused(&[&volume[..], &option].concat(), &[option[0], "volume"]);
    }
    refused(&["render", &vdi, "--size", "0", "--out", &png], &["image size"]);
    refused(&["render", &vdi, "--view", "NaN", "--out", &png], &["camera"]);
    refused(&["generate", &series, "--resolution", "0", "--out", &vdi], &["resolution"]);
    refused(&["generate", &series, "--gamma", "-1", "--out", &vdi], &["gamma"]);
    refused(&["generate", &series, "--gamma", "NaN", "--out", &vdi], &["gamma"]);
    refused(&["generate", &series, "--time-step", "99", "--out", &vdi], &["--time-step 99", "8 steps"]);
    refused(&["generate", &series, "--step", "0", "--out", &vdi], &["step_voxels"]);
    refused(&["raycast", "nowhere.vti", "--out", &png], &["nowhere.vti"]);
    refused(&["raycast", &file("x.txt", b"?"), "--out", &png], &["x.txt"]);
    refused(&["raycast", &file("x.raw", b"123"), "--out", &png], &["--dims", "--dtype"]);
    refused(&["raycast", &file("y.raw", b"123"), "--dims", "2x2x2", "--dtype", "uint8", "--out", &png], &["y.raw"]);
    refused(&["raycast", &series, "--size", "32", "--out", "/proc/nowhere/x.png"], &["/proc/nowhere"]);
    refused(&["replay", &series, "--contract", "size <= 300 parsecs"], &["300 parsecs", "size <= 300kB"]);
    refused(&["tune", &series, "--contract", "size <= 1kB, size <= 2kB"], &["limited twice"]);
    refused(
        &["tune", &series, "--contract", "size <= 40B", "--grid", "coarse"],
        &["nothing tried keeps this contract"],
    );
    refused(&["replay", &series, "--headless", "--out", "/proc/nowhere"], &["/proc/nowhere", "--out"]);
    refused(&["live", "--headless"], &["--steps"]);
    refused(&["live", "--cells", "1", "--steps", "1"], &["cells"]);
    refused(&["compare", &png, &png], &["x.png"]);

    let scene = |body: &str| file("scene.toml", body.as_bytes());
    let scene_refused =
        |body: &str, words: &[&str]| refused(&["raycast", &series, "--scene", &scene(body), "--out", &png], words);
    scene_refused("colour = 3", &["scene.toml", "colour"]);
    let camera =
        |p: &str, u: &str| format!("[camera]\nposition = {p}\ntarget = [0.0, 0.0, 0.0]\nup = {u}\nfov_y_deg = 30.0\n");
    scene_refused(&camera("[0.0, 0.0, 0.0]", "[0.0, 1.0, 0.0]"), &["camera.position"]);
    scene_refused(&camera("[0.0, 3.0, 0.0]", "[0.0, 1.0, 0.0]"), &["camera.up"]);
    let points =
        "points = [{ at = 0.9, color = [1, 1, 1], opacity = 0.1 }, { at = 0.1, color = [1, 1, 1], opacity = 0.1 }]";
    scene_refused(
        &format!("[transfer]\nrange = {{ lo = 0.0, hi = 1.0, scale = \"linear\" }}\n{points}\n"),
        &["not sorted"],
    );
    scene_refused("[transfer]\nrange = { lo = 0.0, hi = 1.0, scale = \"log10\" }\npoints = []\n", &["log10"]);
}

#[test]
fn voxels_that_are_not_finite_are_drawn_as_empty_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let mut values = vec![0.5_f32; 16 * 16 * 16];
    values[1] = f32::NAN;
    values[77] = f32::NEG_INFINITY;
    let write = |name: &str, value: &dyn Fn(f32) -> f32| {
        let path = folder.path().join(name);
        std::fs::write(&path, values.iter().flat_map(|v| value(*v).to_le_bytes()).collect::<Vec<_>>()).unwrap();
        path
    };
    let path = write("holes_16x16x16_float32.raw", &|v| v);
    let out = text(&folder.path().join("x.png"));
    let output = run("lamina", &["raycast", &text(&path), "--size", "32", "--out", &out]);
    assert!(output.status.success());
    assert!(String::from_utf8_lossy(&output.stderr).contains("2 voxels are NaN or infinite"));
    let run_out = text(&folder.path().join("run"));
    lamina(&["replay", &text(&path), "--headless", "--resolution", "32", "--gamma", "0.1", "--out", &run_out]);
    let csv = std::fs::read_to_string(folder.path().join("run/steps.csv")).unwrap();
    assert_eq!(StepRow::from_csv(csv.lines().nth(1).unwrap()).unwrap().empty_voxels, 2);

    // A value of the user's own that stands for them is the same.
    let filled = write("filled_16x16x16_float32.raw", &|v| if v.is_finite() { v } else { -9999.0 });
    let other = text(&folder.path().join("z.png"));
    lamina(&["raycast", &text(&filled), "--missing", "-9999", "--size", "32", "--out", &other]);
    assert_eq!(std::fs::read(&out).unwrap(), std::fs::read(&other).unwrap());

    // Volumes hold them too, asked for and among what is tried.
    let volumes = ["--representation", "volume", "--resolution", "32", "--gamma", "0.1"];
    let out = folder.path().join("volumes");
    lamina(&[&["replay", &text(&path), "--headless", "--out", &text(&out)], &volumes[..]].concat());
    let csv = std::fs::read_to_string(out.join("steps.csv")).unwrap();
    assert_eq!(StepRow::from_csv(csv.lines().nth(1).unwrap()).unwrap().representation.name(), "volume");
    let tuned = lamina(&["tune", &text(&path), "--contract", "size <= 1MB", "--grid", "32:64:32,0.01:0.1:0.05"]);
    assert!(tuned.lines().any(|l| l.starts_with("best") && l.contains("volume")), "{tuned}");
}

#[test]
fn doctor_names_what_the_machine_has() {
    let printed = lamina(&["doctor"]);
    for word in ["cores", "vectors", "memory", "port 7101", "gpu"] {
        assert!(printed.contains(word), "{printed}");
    }
}

#[test]
fn shares_paces_and_overheads_that_cannot_be_are_refused() {
    let series = text(&recorded_series());
    for (share, word) in [("0", "nothing to work with"), ("-1", "nothing"), ("9999", "more than"), ("x", "no number")] {
        refused(&["live", "--cpu-share", share], &["cpu_share", word]);
    }
    for pace in ["-1", "nan", "inf", "fast"] {
        refused(&["live", "--pace", pace], &["--pace", "steps a second"]);
    }
    for overhead in ["0%", "101%", "-3%", "nan%"] {
        refused(&["live", "--contract", &format!("overhead <= {overhead}")], &["overhead"]);
    }
    let limited = ["--contract", "size <= 1MB, overhead <= 5%"];
    refused(&[&["replay", &series, "--headless"][..], &limited].concat(), &["overhead", "--pace"]);
    refused(&[&["replay", &series][..], &limited].concat(), &["overhead", "--pace"]);
    refused(&[&["tune", &series][..], &limited].concat(), &["overhead", "no simulation"]);
    refused(&["replay", &series, "--headless", "--pace", "2"], &["--pace", "--headless"]);
}

#[test]
fn a_reduced_volume_is_made_shown_and_chosen_where_it_serves_better() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    let input = [&text(&recorded_series()), "--time-step", "2"];
    let with = |command: &str, more: &[&str]| lamina(&[&[command], &input[..], more].concat());
    with("raycast", &["--view", "30", "--size", "256", "--out", &at("reference.png")]);
    let volume = with(
        "generate",
        &["--representation", "volume", "--resolution", "99", "--gamma", "0.02", "--out", &at("x.lvol")],
    );
    let vdi = with("generate", &["--resolution", "128", "--gamma", "0.02", "--out", &at("x.vdi")]);
    let seen = |file: &str| {
        lamina(&["render", &at(file), "--view", "30", "--size", "256", "--out", &at("seen.png")]);
        figure(&lamina(&["compare", &at("reference.png"), &at("seen.png")]), "psnr_db")
    };
    let (volume_db, vdi_db) = (seen("x.lvol"), seen("x.vdi"));
    assert!(volume_db > 36.0 && volume_db > vdi_db, "{volume_db} and {vdi_db} dB");
    assert!(figure(&volume, "size_bytes") < 0.5 * figure(&vdi, "size_bytes"), "{volume}{vdi}");

    let tuned = with("tune", &["--contract", "size <= 20kB"]);
    let best = tuned.lines().find(|l| l.starts_with("best")).unwrap_or_else(|| panic!("{tuned}"));
    assert!(best.contains("volume"), "{tuned}");
    let tuned = with("tune", &["--contract", "size <= 60kB", "--representation", "vdi"]);
    assert!(!tuned.contains("volume"), "{tuned}");

    // A live run of volumes through all three nodes.
    let out = folder.path().join("run");
    let fixed = ["--representation", "volume", "--resolution", "99", "--gamma", "0.03", "--headless", "--out"];
    lamina(&[&["replay", &text(&recorded_series()), "--steps", "2"], &fixed[..], &[&text(&out)]].concat());
    let csv = std::fs::read_to_string(out.join("steps.csv")).unwrap();
    for line in csv.lines().skip(1) {
        let row = StepRow::from_csv(line).unwrap();
        assert_eq!((row.representation.name(), row.resolution, row.gamma), ("volume", 99, 0.03));
        assert!(row.psnr_db.is_some_and(|q| f64::from(q) > 30.0), "{line}");
    }
    refused(&[&["generate"], &input[..], &["--representation", "mesh", "--out", &at("y")]].concat(), &["mesh", "vdi"]);
}
