//! Groups of generator-nodes under a real MPI: what they publish is what one node publishes, and their end is not the simulation's.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::DVec3;
use lamina_client::{Brick, Client, FullPolicy, RunOptions};
use lamina_codec::{DecodeLimits, decode, decode_any, sequence, volume};
use lamina_model::{
    Coordinates, Grid, Intermediate, ReducedVolume, Scene, Vdi, Volume, VoxelType, Voxels, psnr::psnr, suggest::suggest,
};
use lamina_tests::languages::source;
use lamina_tests::processes::{Daemon, binary, free_port, wait_for};
use lamina_vdi_render::{Backend, Detail, Drawable};
use lamina_viz_node::store::StepRow;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

const SIDE: usize = 40;
const STEPS: u64 = 3;
const RANKS: u32 = 4;

/// `mpiexec` of `tests/mpi`, and its libraries.
fn mpiexec(members: u32, listen: u16, config: &Path) -> Command {
    let mpi = source("out/mpi");
    assert!(mpi.join("bin/mpiexec").exists(), "run tests/mpi first, as tests/run does");
    let mut command = Command::new(mpi.join("bin/mpiexec"));
    command.env("LD_LIBRARY_PATH", mpi.join("lib")).args(["-n", &members.to_string()]).arg(binary("generator-node"));
    command.args(["--group", "--listen", &format!("127.0.0.1:{listen}"), "--config"]).arg(config);
    command.stdin(Stdio::null()).stdout(Stdio::null());
    command
}

fn value(x: usize, y: usize, z: usize, step: u64) -> f32 {
    let p = DVec3::new(x as f64, y as f64, z as f64) / SIDE as f64;
    let blob = |c: DVec3, w: f64| (-(p - c).length_squared() / (w * w)).exp();
    (blob(DVec3::splat(0.4 + 0.05 * step as f64), 0.25) + 0.7 * blob(DVec3::new(0.7, 0.6, 0.8), 0.2)) as f32
}

fn grid() -> Grid {
    Grid::new([SIDE; 3], DVec3::splat(0.1), DVec3::new(-2.0, 1.0, 0.0)).unwrap()
}

/// Denser towards the middle of x, as long as the even grid.
fn uneven() -> Coordinates {
    let mut axes = grid().coordinates();
    let (first, length, parts) = (axes[0][0], axes[0][SIDE - 1] - axes[0][0], (SIDE - 1) as f64);
    let place = |t: f64| 0.5 + (t - 0.5) * (0.4 + 2.4 * (t - 0.5) * (t - 0.5));
    axes[0] = (0..SIDE).map(|n| first + length * place(n as f64 / parts)).collect();
    Coordinates::new(axes).unwrap()
}

fn scene() -> Scene {
    let values = (0..SIDE.pow(3)).map(|n| value(n % SIDE, n / SIDE % SIDE, n / SIDE / SIDE, 0)).collect();
    suggest(&[&Volume::new(grid(), Voxels::F32(values)).unwrap()]).unwrap()
}

/// Boxes of each rank: uneven, one rank with two in an L, one with none.
fn boxes(rank: u32) -> Vec<([usize; 3], [usize; 3])> {
    match rank {
        0 => vec![([0, 0, 0], [SIDE, 11, SIDE]), ([0, 11, 0], [13, 29, SIDE])],
        1 => vec![([13, 11, 0], [27, 29, 6])],
        2 => vec![],
        _ => vec![([13, 11, 6], [27, 29, 34])],
    }
}

/// Pushes step after step by all ranks at once.
fn simulate(url: &str, steps: std::ops::Range<u64>) {
    simulate_by(url, None, |_| (steps.clone(), true));
}

/// The same of points at `coordinates`, each rank of the steps that `of_rank` gives, and whether it ends as it should then, or falls silent.
fn simulate_by(url: &str, coordinates: Option<&Coordinates>, of_rank: impl Fn(u32) -> (std::ops::Range<u64>, bool)) {
    let even = coordinates.map_or_else(grid, |coordinates| coordinates.grid().unwrap());
    let rank = |rank: u32| {
        let (steps, ends) = of_rank(rank);
        let options = RunOptions::new(url, "group", "density", even, VoxelType::F32);
        let (scene, full_policy) = (Some(scene()), FullPolicy::Block);
        let (deadline, coordinates) = (Duration::from_secs(60), coordinates.cloned());
        let options = RunOptions { rank, ranks: RANKS, scene, full_policy, deadline, coordinates, ..options };
        move || {
            let mut client = Client::connect(options).unwrap();
            for step in steps {
                let voxels = |([x0, y0, z0], [nx, ny, nz]): &([usize; 3], [usize; 3])| -> Vec<f32> {
                    let rows = (*z0..z0 + nz).flat_map(|z| (*y0..y0 + ny).map(move |y| (y, z)));
                    rows.flat_map(|(y, z)| (*x0..x0 + nx).map(move |x| value(x, y, z, step))).collect()
                };
                let boxes = boxes(rank);
                let data: Vec<Vec<f32>> = boxes.iter().map(voxels).collect();
                let bricks: Vec<Brick> = boxes.iter().zip(&data).map(|((s, d), v)| Brick::new(*s, *d, v)).collect();
                client.diagnostic(&format!("of_rank_{rank}"), step as f64).unwrap();
                client.push_bricks(step, step as f64, &bricks).unwrap();
            }
            if ends {
                client.close();
            } else {
                std::mem::forget(client);
            }
        }
    };
    let ranks: Vec<_> = (0..RANKS).map(|r| std::thread::spawn(rank(r))).collect();
    ranks.into_iter().for_each(|rank| rank.join().unwrap());
}

/// The steps that a viz-node records of the nodes at `url`.
fn record(url: &str, folder: &Path, coordinates: Option<&Coordinates>) -> Vec<Vec<u8>> {
    let (config, store) = (folder.join("viz-node.toml"), folder.join("runs"));
    std::fs::write(&config, format!("store = \"{}\"\n", store.display())).unwrap();
    let _viz = Daemon::start("viz-node", free_port(), &["--config", config.to_str().unwrap(), "--generator", url]);
    simulate_by(url, coordinates, |_| (0..STEPS, true));
    let files = || -> Vec<_> {
        let runs = std::fs::read_dir(&store).into_iter().flatten().flatten();
        let mut files: Vec<_> =
            runs.flat_map(|run| std::fs::read_dir(run.path()).into_iter().flatten().flatten()).collect();
        files.retain(|f| f.path().extension().is_some_and(|e| e == "vdi"));
        files.sort_by_key(std::fs::DirEntry::path);
        files.iter().map(|f| std::fs::read(f.path()).unwrap()).collect()
    };
    assert!(wait_for(Duration::from_secs(60), || rows(&store).len() as u64 == STEPS), "{} steps", files().len());
    files()
}

/// What `steps.csv` of the run recorded in `store` says.
fn rows(store: &Path) -> Vec<StepRow> {
    let runs = std::fs::read_dir(store).into_iter().flatten().flatten();
    let tables = runs.filter_map(|run| std::fs::read_to_string(run.path().join("steps.csv")).ok());
    tables.flat_map(|table| table.lines().skip(1).filter_map(StepRow::from_csv).collect::<Vec<_>>()).collect()
}

fn config(folder: &Path, gamma: f64) -> std::path::PathBuf {
    let file = folder.join("generator-node.toml");
    let params = format!(
        "representation = \"vdi\"\nresolution = 96\ngamma = {gamma}\nopacity_cutoff = 1.0\nstep_voxels = 0.5\n"
    );
    std::fs::write(&file, format!("[params]\n{params}")).unwrap();
    file
}

/// What one node with `config` publishes.
fn alone(config: &Path, coordinates: Option<&Coordinates>) -> Vec<Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    let node = Daemon::start("generator-node", free_port(), &["--config", config.to_str().unwrap()]);
    record(&node.url(), folder.path(), coordinates)
}

/// What a group does, whose bytes are nearly as many as those of one node, `alone`.
fn together(members: u32, config: &Path, alone: &[Vec<u8>], coordinates: Option<&Coordinates>) -> Vec<Vec<u8>> {
    let (folder, port) = (tempfile::tempdir().unwrap(), free_port());
    let group = Daemon::spawn(mpiexec(members, port, config), port);
    let together = record(&group.url(), folder.path(), coordinates);
    for (a, b) in alone.iter().zip(&together) {
        let change = b.len() as f64 / a.len() as f64 - 1.0;
        assert!(change.abs() < 0.03, "{members} members: {} and {} bytes", a.len(), b.len());
    }
    together
}

/// The last of some consecutive steps, which may be coded after those before it.
fn decoded(steps: &[Vec<u8>]) -> ReducedVolume {
    let key = steps.iter().rposition(|step| volume::coded_after(step).is_none()).unwrap();
    match decode_any(&sequence(&steps[key..]), &DecodeLimits::default()).unwrap() {
        Intermediate::Volume(volume) => *volume,
        Intermediate::Vdi(_) => unreachable!("a reduced volume was asked for"),
    }
}

fn vdi(bytes: &[u8]) -> Vdi {
    decode(bytes, &DecodeLimits::default()).unwrap()
}

#[test]
fn a_group_publishes_the_reduced_volume_of_one_node() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("generator-node.toml");
    let params =
        "representation = \"volume\"\nresolution = 24\ngamma = 0.01\nopacity_cutoff = 1.0\nstep_voxels = 0.5\n";
    std::fs::write(&config, format!("[params]\n{params}")).unwrap();
    let alone = alone(&config, None);
    for members in [2, 3] {
        let together = together(members, &config, &alone, None);
        for n in 0..alone.len() {
            let [one, other] = [&alone, &together].map(|steps| decoded(&steps[..=n]));
            assert_eq!((one.grid(), one.scene()), (other.grid(), other.scene()));
            let [one, other] = [one, other].map(|volume| {
                let shown = Drawable::new(Intermediate::Volume(Box::new(volume)));
                let camera = shown.camera().rotated_about_y(25.0).unwrap();
                Backend::default().render(&shown, &camera, 256, 256, Detail::Cubic).unwrap()
            });
            let db = psnr(&one, &other).unwrap();
            assert!(db > 60.0, "{members} members: {db} dB");
        }
    }
}

#[test]
fn uneven_points_are_resampled_by_a_group_as_by_one_node() {
    let folder = tempfile::tempdir().unwrap();
    let (config, uneven) = (config(folder.path(), 0.0), uneven());
    let alone = alone(&config, Some(&uneven));
    assert!(together(3, &config, &alone, Some(&uneven)) == alone, "other samples");
}

#[test]
fn a_group_publishes_what_one_node_does_however_many_members_it_has() {
    for gamma in [0.0, 0.02] {
        let folder = tempfile::tempdir().unwrap();
        let config = config(folder.path(), gamma);
        let alone = alone(&config, None);
        for members in [1, 2, 3] {
            for (a, b) in alone.iter().zip(&together(members, &config, &alone, None)) {
                // At gamma 0 supersegments are single samples: all are there, and nothing else.
                assert!(gamma > 0.0 || a == b, "{members} members: other samples");
                let [one, other] = [vdi(a), vdi(b)];
                assert_eq!(one.header(), other.header());
                for angle in [0.0, 40.0] {
                    let camera = one.header().camera.rotated_about_y(angle).unwrap();
                    let picture = |vdi: &Vdi| {
                        let drawable = Drawable::new(Intermediate::Vdi(Box::new(vdi.clone())));
                        Backend::default().render(&drawable, &camera, 256, 256, Detail::Cubic).unwrap()
                    };
                    let db = psnr(&picture(&one), &picture(&other)).unwrap();
                    // Seen from where it was made hardly anything differs; from elsewhere both are as near to the truth, each
                    // by other cuts of the rays that a face divides.
                    let least = if angle == 0.0 { 60.0 } else { 50.0 };
                    assert!(db > least, "{members} members, {angle} degrees: {db} dB");
                }
            }
        }
    }
}

#[test]
fn a_trigger_of_a_group_looks_at_the_whole_step() {
    let folder = tempfile::tempdir().unwrap();
    let config = config(folder.path(), 0.02);
    // The whole has 64,000 points, and no member's part of them all: its greatest value is in the middle, its least in a corner.
    let trigger = "[[trigger]]\nname = \"late\"\nwhen = \"step > 0 && missing == 0 && max > 0.9 && min < 0.01 && diagnostic(of_rank_3) == 1\"\ndo = [\"picture\"]\n";
    let kept = std::fs::read_to_string(&config).unwrap();
    std::fs::write(&config, format!("trigger_folder = \"{}\"\n{kept}{trigger}", folder.path().display())).unwrap();
    let port = free_port();
    let group = Daemon::spawn(mpiexec(2, port, &config), port);
    record(&group.url(), folder.path(), None);
    let rows = rows(&folder.path().join("runs"));
    let fired: Vec<u64> = rows.iter().filter(|row| row.triggers == ["late"]).map(|row| row.step).collect();
    assert_eq!(fired, [1]);
    // What each rank tells comes together, whichever member its bricks go to.
    let told =
        |row: &StepRow| (0..RANKS).all(|rank| row.diagnostics.get(&format!("of_rank_{rank}")) == Some(row.step as f64));
    assert!(rows.iter().all(told), "{rows:?}");
    let pictures = || -> usize {
        let files = std::fs::read_dir(folder.path()).unwrap().flatten();
        files.filter(|file| file.path().extension().is_some_and(|e| e == "png")).count()
    };
    assert!(wait_for(Duration::from_secs(10), || pictures() == 1));
}

#[test]
fn a_group_that_is_killed_costs_steps_and_the_next_one_takes_over() {
    let (folder, port) = (tempfile::tempdir().unwrap(), free_port());
    let config = config(folder.path(), 0.1);
    for victim in 0..4 {
        let group = Daemon::spawn(mpiexec(2, port, &config), port);
        let url = group.url();
        simulate(&url, 0..2);
        // A member or the root, as a crash would: the launcher ends the others.
        let members = group.children("generator-node");
        assert_eq!(members.len(), 2);
        let pid = members[victim % 2].to_string();
        assert!(Command::new("kill").args(["-KILL", &pid]).status().unwrap().success());
        assert!(wait_for(Duration::from_secs(20), || group.children("generator-node").is_empty()), "members stay");
        drop(group);
        // The simulation goes on: a push without a node is an error and nothing else.
        let options = RunOptions::new(&url, "group", "density", grid(), VoxelType::F32);
        let mut client = Client::connect(options).unwrap();
        let zeros = vec![0.0_f32; SIDE.pow(3)];
        assert!(client.push(0, 0.0, &Brick::new([0; 3], [SIDE; 3], &zeros)).is_err());
    }
    let group = Daemon::spawn(mpiexec(2, port, &config), port);
    assert_eq!(record(&group.url(), folder.path(), None).len() as u64, STEPS);
}

#[test]
fn a_simulation_that_was_killed_is_served_at_once_when_it_starts_again() {
    let (folder, port) = (tempfile::tempdir().unwrap(), free_port());
    let (config, store) = (config(folder.path(), 0.1), folder.path().join("runs"));
    let group = Daemon::spawn(mpiexec(2, port, &config), port);
    let arguments = ["--generator", &group.url(), "--store", &store.display().to_string()];
    let _viz = Daemon::start("viz-node", free_port(), &arguments);
    // One rank is ahead of the others by more steps than a member holds, and none of them leaves.
    simulate_by(&group.url(), None, |rank| (0..if rank == 1 { 7 } else { 2 }, false));
    simulate(&group.url(), 0..STEPS);
    let newest = || -> Option<usize> {
        let runs = std::fs::read_dir(&store).ok()?.flatten().map(|run| run.path());
        let files = std::fs::read_dir(runs.max()?).ok()?.flatten();
        Some(files.filter(|file| file.path().extension().is_some_and(|e| e == "vdi")).count())
    };
    assert!(wait_for(Duration::from_secs(20), || newest() == Some(STEPS as usize)), "{:?} steps", newest());
    assert_eq!(std::fs::read_dir(&store).unwrap().count(), 2, "a run each");
}

#[test]
fn bricks_of_two_members_that_overlap_or_leave_a_hole_are_refused_by_name() {
    let (folder, port) = (tempfile::tempdir().unwrap(), free_port());
    let group = Daemon::spawn(mpiexec(2, port, &config(folder.path(), 0.1)), port);
    for (name, start, planes, says) in [
        ("overlap", 18, 22, "the bricks [0..40, 0..40, 0..20] and [0..40, 0..40, 18..40] overlap"),
        ("hole", 22, 18, "the bricks of all 2 ranks cover 60800 of 64000 voxels"),
    ] {
        let open = |rank| {
            let options = RunOptions::new(&group.url(), name, "density", grid(), VoxelType::F32);
            let deadline = Duration::from_secs(60);
            Client::connect(RunOptions { rank, ranks: 2, full_policy: FullPolicy::Block, deadline, ..options }).unwrap()
        };
        let mut clients = [open(0), open(1)];
        let zeros = vec![0.0_f32; SIDE.pow(3)];
        let bricks = [(0, 20), (start, planes)];
        let mut push = |rank: usize, step| {
            let (z0, nz) = bricks[rank];
            let brick = Brick::new([0, 0, z0], [SIDE, SIDE, nz], &zeros[..SIDE * SIDE * nz]);
            clients[rank].push(step, 0.0, &brick).map_err(|e| e.to_string())
        };
        assert!(push(0, 0).is_ok() && push(1, 0).is_ok(), "each by itself is right");
        // More of them than a member holds: no step that was refused is in the way of the next.
        let mut refusals: Vec<String> = Vec::new();
        let mut step = 0;
        assert!(wait_for(Duration::from_secs(20), || {
            step += 1;
            refusals.extend([push(0, step), push(1, step)].into_iter().filter_map(Result::err));
            refusals.len() >= 12
        }));
        assert!(refusals.iter().all(|refusal| refusal.contains(says)), "{refusals:?}");
        for client in clients {
            client.close();
        }
    }
}

#[test]
fn without_mpi_a_group_is_refused_with_the_remedy() {
    let start = |library: &str| {
        let mut command = Command::new(binary("generator-node"));
        command.args(["--group", "--listen", &format!("127.0.0.1:{}", free_port())]).env("LAMINA_MPI_LIBRARY", library);
        let ended = command.output().unwrap();
        assert!(!ended.status.success());
        String::from_utf8_lossy(&ended.stderr).into_owned()
    };
    let missing = start("/nonexistent/libmpi.so");
    assert!(missing.contains("no MPI library") && missing.contains("LAMINA_MPI_LIBRARY"), "{missing}");
    // A library, but not an MPI one.
    let other = start("libc.so.6");
    assert!(other.contains("MPI_") && other.contains("LAMINA_MPI_LIBRARY"), "{other}");
}

#[test]
fn what_a_group_cannot_do_is_refused_before_it_joins() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("generator-node.toml");
    let trigger = "[[trigger]]\nname = \"keep\"\nwhen = \"max >= min\"\ndo = [\"raw\"]\n";
    for (text, key) in [("codec = \"bzip2\"\n", "codec"), (trigger, "trigger")] {
        std::fs::write(&file, text).unwrap();
        let mut command = Command::new(binary("generator-node"));
        command.args(["--group", "--config"]).arg(&file).env("LAMINA_MPI_LIBRARY", "/nonexistent/libmpi.so");
        let ended = command.output().unwrap();
        let said = String::from_utf8_lossy(&ended.stderr);
        assert!(!ended.status.success() && said.contains(key) && said.contains("use one node"), "{said}");
    }
}

#[test]
fn a_rank_that_falls_silent_leaves_a_hole_and_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let (config, port, store) = (config(folder.path(), 0.02), free_port(), folder.path().join("runs"));
    let group = Daemon::spawn(mpiexec(2, port, &config), port);
    let arguments = ["--generator", &group.url(), "--store", &store.display().to_string()];
    let _viz = Daemon::start("viz-node", free_port(), &arguments);
    // The last rank, whose boxes are most of the grid, is gone after two steps.
    simulate_by(&group.url(), None, |rank| if rank + 1 == RANKS { (0..2, false) } else { (0..6, true) });
    let rows = || {
        let run = std::fs::read_dir(&store).ok().and_then(|mut runs| runs.next()?.ok());
        run.and_then(|run| std::fs::read_to_string(run.path().join("steps.csv")).ok()).unwrap_or_default()
    };
    let lost_of = |text: &str| -> Vec<(u64, String)> {
        let mut lines = text.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
        let Some(head) = lines.next() else { return Vec::new() };
        let column = |name: &str| head.iter().position(|of| of == name).unwrap();
        let (step, lost) = (column("step"), column("lost_ranks"));
        lines.map(|row| (row[step].parse().unwrap(), row[lost].clone())).collect()
    };
    // All ranks but the last push their steps 2 to 4 without it; the newest is not past.
    let named = |(step, lost): &(u64, String)| (*step >= 2) == (lost == &(RANKS - 1).to_string());
    let shown = wait_for(Duration::from_secs(60), || {
        let lost = lost_of(&rows());
        lost.iter().any(|(step, _)| *step >= 4) && lost.iter().all(named)
    });
    assert!(shown, "{}", rows());
}
