//! Simulations in C, Fortran and Python hand over what one in Rust does, and are told what they do wrong.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::DVec3;
use lamina_client::{Brick, Client, RunOptions, VoxelSlice};
use lamina_model::{Grid, VoxelType};
use lamina_tests::http::curl;
use lamina_tests::languages::{compile, library, python_with, source};
use lamina_tests::processes::{Daemon, binary, free_port, wait_for};
use std::collections::BTreeSet;
use std::io::Read;
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

const STEPS: u64 = 3;

/// A generator-node, and a viz-node that records its runs.
struct Recorder {
    store: tempfile::TempDir,
    generator: Daemon,
    viz: Daemon,
}

impl Recorder {
    /// The simulations hand their bricks over in shared memory, or send them.
    fn start(shared_memory: bool) -> Self {
        let store = tempfile::tempdir().unwrap();
        let config = store.path().join("generator-node.toml");
        std::fs::write(&config, format!("shared_memory = {shared_memory}\n")).unwrap();
        let generator = Daemon::start("generator-node", free_port(), &["--config", &config.display().to_string()]);
        let config = store.path().join("viz-node.toml");
        std::fs::write(&config, format!("store = \"{}\"\n", store.path().join("runs").display())).unwrap();
        let (config, url) = (config.display().to_string(), generator.url());
        let viz = Daemon::start("viz-node", free_port(), &["--config", &config, "--generator", &url]);
        Self { store, generator, viz }
    }

    fn runs(&self) -> BTreeSet<PathBuf> {
        let folder = std::fs::read_dir(self.store.path().join("runs"));
        folder.into_iter().flatten().flatten().map(|e| e.path()).collect()
    }

    /// The recorded steps of the run that `push` pushes: simulation times with what was told beside the field, and bytes.
    fn record(&self, push: impl FnOnce(&str)) -> Vec<(String, Vec<u8>)> {
        let before = self.runs();
        push(&self.generator.url());
        let rows = || {
            let new = self.runs().into_iter().find(|run| !before.contains(run))?;
            let table = std::fs::read_to_string(new.join("steps.csv")).ok()?;
            let told = |line: &str| Some(format!("{} {}", line.split(',').nth(1)?, line.rsplit(',').next()?));
            let times: Vec<String> = table.lines().skip(1).filter_map(told).collect();
            (times.len() as u64 == STEPS).then_some((new, times))
        };
        assert!(wait_for(Duration::from_secs(60), || rows().is_some()), "steps are missing");
        let (run, times) = rows().unwrap();
        let bytes = |n| std::fs::read(run.join(format!("step_{n:06}.vdi"))).unwrap();
        times.into_iter().zip((0..STEPS).map(bytes)).collect()
    }
}

/// As `blob` in the other languages says, its fields of `voxel_type`, which `of` makes of doubles.
fn push_blob<T>(url: &str, voxel_type: VoxelType, of: impl Fn(f64) -> T)
where
    for<'a> &'a Vec<T>: Into<VoxelSlice<'a>>,
{
    let (dims, origin) = ([24, 20, 16], DVec3::new(-1.2, -1.0, -0.8));
    let grid = Grid::new(dims, DVec3::splat(0.1), origin).unwrap();
    let options = RunOptions::new(url, "blob", "density", grid, voxel_type);
    let options = RunOptions { color_field: Some(("heat".into(), voxel_type)), ..options };
    let mut client = Client::connect(options).unwrap();
    for step in 0..STEPS {
        let (mut density, mut heat) = (Vec::new(), Vec::new());
        for (k, j, i) in (0..16).flat_map(|k| (0..20).flat_map(move |j| (0..24).map(move |i| (k, j, i)))) {
            let x = 0.1 * f64::from(i) - 0.8 - 0.2 * step as f64;
            let (y, z) = (0.1 * f64::from(j) - 1.0, 0.1 * f64::from(k) - 0.8);
            density.push(of(1.0 / (1.0 + 9.0 * (x * x + y * y + z * z))));
            heat.push(of(x + step as f64));
        }
        client.push(step, 0.1 * step as f64, &Brick::new([0; 3], dims, &density).with_colors(&heat)).unwrap();
    }
    assert_eq!(client.close().pushed, STEPS);
}

/// As `fields` in the other languages says: what is shown is computed here.
fn push_fields(url: &str) {
    let dims = [24, 20, 16];
    let grid = Grid::new(dims, DVec3::ONE, DVec3::ZERO).unwrap();
    let mut client = Client::connect(RunOptions::new(url, "fields", "magnitude(v)", grid, VoxelType::F32)).unwrap();
    for step in 0..STEPS {
        let speed = |n: usize| {
            let [i, j, k] = [n % 24, n / 24 % 20, n / 480].map(|i| i as f64);
            let (x, y, z) = (0.25 * i + step as f64, 0.5 * j, 0.125 * k * i);
            (x * x + y * y + z * z).sqrt() as f32
        };
        let voxels: Vec<f32> = (0..24 * 20 * 16).map(speed).collect();
        client.diagnostic("residual", 0.5 * step as f64).unwrap();
        client.push(step, 0.1 * step as f64, &Brick::new([0; 3], dims, &voxels)).unwrap();
    }
    assert_eq!(client.close().pushed, STEPS);
}

/// As `uneven` in the other languages says, on the even grid that is shown: its function is linear along each axis, so that the values
/// there are known. All are multiples of 1/8 or less: no sum is rounded.
fn push_resampled(url: &str) {
    let dims = [24, 20, 16];
    // x ends at 0.125 * 23^2, z begins at -0.25 * 15^2.
    let spacing = DVec3::new(0.125 * 23.0, 2.0, 0.25 * 15.0);
    let grid = Grid::new(dims, spacing, DVec3::new(0.0, 0.0, -0.25 * 225.0)).unwrap();
    let mut client = Client::connect(RunOptions::new(url, "uneven", "u", grid, VoxelType::F64)).unwrap();
    for step in 0..STEPS {
        let value = |n: usize| {
            let [i, j, k] = [n % 24, n / 24 % 20, n / 480].map(|i| i as f64);
            spacing.x * i + 0.5 * j * (step + 1) as f64 - spacing.z * (k - 15.0)
        };
        let voxels: Vec<f64> = (0..24 * 20 * 16).map(value).collect();
        client.push(step, 0.1 * step as f64, &Brick::new([0; 3], dims, &voxels)).unwrap();
    }
    assert_eq!(client.close().pushed, STEPS);
}

/// Runs `program URL RANK 2` for both ranks at once.
fn run_ranks(program: &[&Path], url: &str) {
    run_each(program, url, 2);
}

/// Runs `program URL RANK RANKS` for all ranks at once.
fn run_each(program: &[&Path], url: &str, ranks: u32) {
    let start = |rank: u32| {
        let mut command = Command::new(program[0]);
        command.args(&program[1..]).args([url, &rank.to_string(), &ranks.to_string()]);
        command.env("PMI_RANK", rank.to_string()).env("PMI_SIZE", ranks.to_string());
        command.env("LAMINA_LIBRARY", library()).env("PYTHONPATH", source("deploy/python"));
        command.env("PYTHONDONTWRITEBYTECODE", "1");
        command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    };
    for rank in (0..ranks).map(start).collect::<Vec<_>>() {
        let ended = rank.wait_with_output().unwrap();
        let [said, complained] = [&ended.stdout, &ended.stderr].map(|s| String::from_utf8_lossy(s).into_owned());
        assert_eq!(complained.trim(), "");
        assert!(said.trim().ends_with("dropped 0 lost 0"), "{said}");
        assert!(ended.status.success());
    }
}

#[test]
fn two_ranks_in_each_language_show_what_one_in_rust_does() {
    let (recorder, folder) = (Recorder::start(true), tempfile::tempdir().unwrap());
    let expected = Recorder::start(false).record(|url| push_blob(url, VoxelType::F64, |x| x));
    assert!(expected.iter().all(|(_, bytes)| bytes.len() > 1000), "nothing to compare");

    let c = compile(&["cc", "-std=c11"], &["proto/client/c/blob.c"], folder.path());
    let fortran = ["proto/client/fortran/lamina.f90", "proto/client/fortran/blob.f90"];
    let fortran = compile(&["gfortran"], &fortran, folder.path());
    let python = source("deploy/python/examples/blob.py");
    let rust = binary(&format!("examples/blob{}", std::env::consts::EXE_SUFFIX));
    for program in [&[c.as_path()][..], &[&fortran], &[&rust], &[Path::new("python3"), &python]] {
        let recorded = recorder.record(|url| run_ranks(program, url));
        assert!(recorded == expected, "{program:?} pushed something else");
    }

    // Computed into the node's memory.
    let c = compile(&["cc", "-std=c11"], &["tests/languages/buffers.c"], folder.path());
    let fortran = ["proto/client/fortran/lamina.f90", "tests/languages/buffers.f90"];
    let fortran = compile(&["gfortran"], &fortran, folder.path());
    let (script, python) = (source("tests/languages/buffers.py"), python_with("numpy"));
    for program in [&[c.as_path()][..], &[&fortran], &[Path::new(python), &script]] {
        let recorded = recorder.record(|url| run_each(program, url, 1));
        assert!(recorded == expected, "{program:?} pushed something else");
    }

    // In several bricks of one rank, and none of the other.
    let c = compile(&["cc", "-std=c11"], &["tests/languages/bricks.c"], folder.path());
    let script = source("tests/languages/bricks.py");
    for program in [&[c.as_path()][..], &[Path::new(python), &script]] {
        let recorded = recorder.record(|url| run_each(program, url, 2));
        assert!(recorded == expected, "{program:?} pushed something else");
    }

    // Several fields, of which an expression is shown.
    let expected = recorder.record(push_fields);
    let told: Vec<&str> = expected.iter().map(|(told, _)| told.as_str()).collect();
    assert_eq!(told, ["0.0 residual=0", "0.1 residual=0.5", "0.2 residual=1"]);
    let c = compile(&["cc", "-std=c11"], &["tests/languages/fields.c"], folder.path());
    let fortran = ["proto/client/fortran/lamina.f90", "tests/languages/fields.f90"];
    let fortran = compile(&["gfortran"], &fortran, folder.path());
    let script = source("tests/languages/fields.py");
    for program in [&[c.as_path()][..], &[&fortran], &[Path::new(python), &script]] {
        let recorded = recorder.record(|url| run_each(program, url, 1));
        assert!(recorded == expected, "{program:?} pushed something else");
    }

    // On a rectilinear grid.
    let expected = recorder.record(push_resampled);
    let c = compile(&["cc", "-std=c11"], &["tests/languages/uneven.c"], folder.path());
    let fortran = ["proto/client/fortran/lamina.f90", "tests/languages/uneven.f90"];
    let fortran = compile(&["gfortran"], &fortran, folder.path());
    for program in [&[c.as_path()][..], &[&fortran]] {
        let recorded = recorder.record(|url| run_each(program, url, 1));
        assert!(recorded == expected, "{program:?} pushed something else");
    }

    // The same simulation in single precision, for which the Fortran module has code of its own.
    let text = std::fs::read_to_string(source("proto/client/fortran/blob.f90")).unwrap();
    let single = folder.path().join("single.f90");
    let fields = "real(real64), allocatable :: density(:, :, :), heat(:, :, :)";
    assert!(text.contains(fields));
    let text = text.replace(fields, &fields.replace("real64", "real32")).replace("lamina_f64", "lamina_f32");
    let text = text
        .replace("only: real64,", "only: real32, real64,")
        .replace("= 1 / (1 + 9 * (x * x + y * y + z * z))", "= real(1 / (1 + 9 * (x * x + y * y + z * z)), real32)")
        .replace("= x + step", "= real(x + step, real32)");
    std::fs::write(&single, text).unwrap();
    let fortran = compile(&["gfortran"], &["proto/client/fortran/lamina.f90", single.to_str().unwrap()], folder.path());
    let expected = recorder.record(|url| push_blob(url, VoxelType::F32, |x| x as f32));
    let recorded = recorder.record(|url| run_ranks(&[&fortran], url));
    assert!(recorded == expected, "single precision");
}

/// A node that reads a little of what is sent and leaves, again and again.
fn leaver() -> SocketAddr {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            stream.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
            while stream.read(&mut [0; 4096]).is_ok_and(|n| n > 0) {}
        }
    });
    address
}

#[test]
fn a_node_that_leaves_or_does_not_answer_ends_no_simulation() {
    let folder = tempfile::tempdir().unwrap();
    let program = compile(&["cc", "-std=c11"], &["tests/languages/left.c"], folder.path());
    // Listens, and never says a word.
    let mute = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let urls = [leaver(), mute.local_addr().unwrap()].map(|address| format!("http://{address}"));
    let ended = Command::new(program).args(urls).output().unwrap();
    assert!(ended.status.success(), "{:?} {}", ended.status, String::from_utf8_lossy(&ended.stdout));
}

#[test]
fn the_header_is_one_of_cpp_too() {
    let header = source("proto/client/c/lamina.h");
    let strict = ["-x", "c++", "-std=c++11", "-fsyntax-only", "-Wall", "-Wextra", "-pedantic", "-Werror"];
    assert!(Command::new("c++").args(strict).arg(header).status().expect("a C++ compiler").success());
}

#[test]
fn what_a_simulation_in_c_gets_wrong_costs_it_a_code_and_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let program = compile(&["cc", "-std=c11"], &["tests/languages/misuse.c"], folder.path());
    let ended = Command::new(program).arg(format!("http://127.0.0.1:{}", free_port())).output().unwrap();
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stdout));
}

#[test]
fn python_raises_what_its_users_catch() {
    let script = "
import array, ctypes, lamina, os, sys
def raises(kind, words, call):
    try:
        call()
    except kind as error:
        assert words in str(error), error
    else:
        sys.exit(f'nothing raised that says {words}')
client = lambda **k: lamina.Client('run', 'f', **{'dims': (4, 3, 2), 'type': 'float32', 'generator': sys.argv[1], **k})
raises(ValueError, 'float31 is none of', lambda: client(type='float31'))
raises(ValueError, 'grid', lambda: client(dims=(4, 0, 2)))
run = client()
values = memoryview(array.array('f', bytes(96))).cast('B')
raises(ValueError, '1 axes', lambda: run.push(0, 0.0, values))
raises(ValueError, 'float64 voxels of f; the run has float32', lambda: run.push(0, 0.0, values.cast('d', (2, 3, 2))))
raises(TypeError, '', lambda: run.push(0, 0.0, [[[0.0]]]))
raises(ConnectionError, 'not reachable', lambda: run.push(0, 0.0, values.cast('f', (4, 3, 2))))
raises(ValueError, '-1 is negative', lambda: run.push(-1, 0.0, values.cast('f', (4, 3, 2))))
raises(ValueError, 'negative', lambda: run.push(1, 0.0, values.cast('f', (4, 3, 2)), start=(0, -1, 0)))
raises(ValueError, '2 numbers', lambda: run.push(1, 0.0, values.cast('f', (4, 3, 2)), start=(0, 0)))
scalar, b, three = ctypes.c_float(1), lamina.client._Buffer(), ctypes.c_ssize_t * 3
shape, strides = three(4, 3, 2), three(0, 0, 4)
b.buf, b.len, b.itemsize, b.ndim, b.format = ctypes.addressof(scalar), 96, 4, 3, b'f'
b.shape, b.strides = ctypes.cast(shape, type(b.shape)), ctypes.cast(strides, type(b.strides))
broadcast = ctypes.pythonapi.PyMemoryView_FromBuffer
broadcast.restype = ctypes.py_object
raises(ValueError, 'strides', lambda: run.push(1, 0.0, broadcast(ctypes.byref(b))))
raises(ValueError, 'laid out', lambda: run.push(1, 0.0, values.cast('f', (4, 3, 2)), colors=values.cast('f',
    (2, 3, 4))))
if hasattr(os, 'fork'):
    child = os.fork()
    if child == 0:
        raises(ValueError, 'forked', lambda: run.push(1, 0.0, values.cast('f', (4, 3, 2))))
        run.close()
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
for _ in range(2):
    ended = run.close()
    assert (ended.pushed, ended.lost, ended.run_dropped_steps) == (0, 4, -1), ended.lost
raises(ValueError, 'client', lambda: run.push(9, 0.0, values.cast('f', (4, 3, 2))))
";
    let ended = Command::new("python3")
        .args(["-c", script, &format!("http://127.0.0.1:{}", free_port())])
        .env("PYTHONPATH", source("deploy/python"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env("LAMINA_LIBRARY", library())
        .output()
        .unwrap();
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
}

/// Asks at the viz-node's page for something; the answer's status.
fn steer(viz: &Daemon, request: &str) -> String {
    curl(&format!("{}/api/steer", viz.url()), &["--header", "content-type: application/json", "--data", request]).0
}

#[test]
fn simulations_in_each_language_hear_what_people_at_the_page_ask_for() {
    let folder = tempfile::tempdir().unwrap();
    let c = compile(&["cc", "-std=c11"], &["tests/languages/steered.c"], folder.path());
    let fortran = ["proto/client/fortran/lamina.f90", "tests/languages/steered.f90"];
    let fortran = compile(&["gfortran", "-J", &folder.path().display().to_string()], &fortran, folder.path());
    let (python, script) = (python_with("sys"), source("tests/languages/steered.py"));
    for program in [vec![&*c], vec![&*fortran], vec![Path::new(python), &*script]] {
        let recorder = Recorder::start(true);
        let mut command = Command::new(program[0]);
        command.args(&program[1..]).arg(recorder.generator.url());
        command.env("LAMINA_LIBRARY", library()).env("PYTHONPATH", source("deploy/python"));
        command.env("PYTHONDONTWRITEBYTECODE", "1");
        let simulation = command.stdout(Stdio::piped()).spawn().unwrap();
        // As soon as it listens.
        assert!(wait_for(Duration::from_secs(60), || steer(
            &recorder.viz,
            r#"{"set":{"name":"inflow","value":1.25}}"#
        ) == "204"));
        let more = [r#""pause""#, r#"{"set":{"name":"angle","value":-45.5}}"#, r#""resume""#, r#""stop""#];
        for bad in [r#"{"set":{"name":"inflow","value":2.5}}"#, r#"{"set":{"name":"outflow","value":1}}"#] {
            assert_eq!(steer(&recorder.viz, bad), "400", "{bad}");
        }
        more.iter().for_each(|request| assert_eq!(steer(&recorder.viz, request), "204", "{request}"));
        let ended = simulation.wait_with_output().unwrap();
        assert!(ended.status.success());
        let said = String::from_utf8(ended.stdout).unwrap();
        assert_eq!(said, "inflow = 1.25\npause\nangle = -45.50\nresume\nstop\n");
        // Who asked for what, in the run's folder.
        let record = std::fs::read_to_string(recorder.runs().pop_last().unwrap().join("requests.csv")).unwrap();
        let asked: Vec<&str> = record.lines().skip(1).map(|line| line.rsplit(',').next().unwrap()).collect();
        assert_eq!(asked, ["inflow = 1.25", "pause", "angle = -45.5", "resume", "stop"]);
        assert!(record.contains("browser at 127.0.0.1"));
    }
}
