//! Triggers of real nodes: the simulation is asked, the step's voxels are kept, and the record says which trigger fired.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use glam::DVec3;
use lamina_client::{Brick, Client, RunOptions};
use lamina_codec::{DecodeLimits, decode_any};
use lamina_model::suggest::suggest;
use lamina_model::{FullPolicy, Grid, Intermediate, Steering, SteeringRequest, Volume, VoxelType, Voxels};
use lamina_raycast::{Backend, Field};
use lamina_rpc::connect::connect;
use lamina_rpc::credentials::Role;
use lamina_rpc::v1;
use lamina_tests::http::{curl, metric};
use lamina_tests::processes::{Daemon, free_port, is_refused, wait_for};
use lamina_viz_node::store::StepRow;
use lamina_volume_io::{Options, Series};
use serde_json::json;
use std::fs::File;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{Ipv4Addr, TcpListener};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

const SIDE: usize = 12;

/// What a step's largest value is.
const PEAKS: [f32; 7] = [1.0, 1.5, 1.4, 9.0, 9.5, 1.0, 1.1];

/// What it tells from the fifth step on.
const RESIDUALS: [f64; 3] = [1e-3, 1e-3, 2.5e-2];

/// Whether the simulation takes requests: it is asked to go on.
fn listens(url: &str, run_id: &str) -> bool {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let channel = connect(url, Role::Generator, None).await.unwrap();
        let steering = Steering { request: SteeringRequest::Resume, asked_by: "a test".to_owned() };
        let request = v1::SteerRequest { run_id: run_id.to_owned(), steering: Some(steering.into()) };
        v1::frames_client::FramesClient::new(channel).steer(request).await.is_ok()
    })
}

#[test]
fn quality_that_a_viz_node_measures_reaches_triggers() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("generator-node.toml");
    let triggers = "[[trigger]]\nname = \"measured\"\nwhen = \"psnr > 0 && kept == 1\"\ndo = []\n\
                    [[trigger]]\nname = \"missed\"\nwhen = \"kept == 0\"\ndo = []\n";
    std::fs::write(&config, triggers).unwrap();
    let node =
        Daemon::start("generator-node", free_port(), &["--backend", "cpu", "--config", config.to_str().unwrap()]);
    let _viz = Daemon::start("viz-node", free_port(), &["--backend", "cpu", "--generator", &node.url()]);
    let grid = Grid::new([SIDE; 3], DVec3::ONE, DVec3::ZERO).unwrap();
    let mut client =
        Client::connect(RunOptions::new(&node.url(), "measured", "density", grid, VoxelType::F32)).unwrap();
    let voxels: Vec<f32> = (0..SIDE.pow(3)).map(|n| (n % 97) as f32).collect();
    let fired = |name: &str| {
        let name = format!("lamina_generator_triggers_fired_total{{trigger=\"{name}\"}}");
        metric(&node.url()["http://".len()..], &name)
    };
    let mut step = 0;
    let has_fired = wait_for(Duration::from_secs(60), || {
        client.push(step, step as f64, &Brick::new([0; 3], [SIDE; 3], &voxels[..])).unwrap();
        step += 1;
        std::thread::sleep(Duration::from_millis(100));
        fired("measured") == Some(1.0)
    });
    assert!(has_fired && step > 1, "{:?} after {step} steps", fired("measured"));
    assert_eq!(fired("missed"), Some(0.0), "there is no limit to miss");
}

#[test]
fn a_step_that_meets_a_condition_pauses_the_simulation_and_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let (store, raw) = (folder.path().join("runs"), folder.path().join("raw"));
    let config = folder.path().join("generator-node.toml");
    let triggers = "[[trigger]]\nname = \"burst\"\nwhen = \"max > 3 * prev(max) && quantile(0.5) < max / 2\"\ndo = [\"pause\", \"raw\", \"picture\", \"copy\", \"webhook\"]\ncopy_kb = 3\nangles = [90, 0]\n\
                    [[trigger]]\nname = \"calm\"\nwhen = \"max < 2\"\ndo = []\n\
                    [[trigger]]\nname = \"diverged\"\nwhen = \"diagnostic(residual) > 10 * prev(diagnostic(residual))\"\ndo = []\n";
    let (webhook, posted) = receive_posts();
    let keys = format!("trigger_folder = \"{}\"\nwebhook = \"{webhook}\"\n", raw.display());
    std::fs::write(&config, format!("{keys}{triggers}")).unwrap();
    let node =
        Daemon::start("generator-node", free_port(), &["--backend", "cpu", "--config", config.to_str().unwrap()]);
    let viewer = folder.path().join("viz-node.toml");
    std::fs::write(&viewer, format!("store = \"{}\"\n", store.display())).unwrap();
    let viz = ["--backend", "cpu", "--config", viewer.to_str().unwrap(), "--generator", &node.url()];
    let _viz = Daemon::start("viz-node", free_port(), &viz);

    let grid = Grid::new([SIDE; 3], DVec3::ONE, DVec3::ZERO).unwrap();
    let options = RunOptions::new(&node.url(), "bursts", "density", grid, VoxelType::F32);
    let voxels = |peak: f32| -> Vec<f32> { (0..SIDE.pow(3)).map(|n| if n % 97 == 0 { peak } else { 0.3 }).collect() };
    let volume = |peak| Volume::new(grid, Voxels::F32(voxels(peak))).unwrap();
    let scene = suggest(&[&volume(PEAKS[3])]).unwrap();
    let (full_policy, steering) = (FullPolicy::Block, Some(Vec::new()));
    let mut client =
        Client::connect(RunOptions { full_policy, steering, scene: Some(scene.clone()), ..options }).unwrap();
    let mut asked = Vec::new();
    for (step, peak) in PEAKS.into_iter().enumerate() {
        if step == 1 {
            // What is asked before the simulation listens does not reach it.
            assert!(wait_for(Duration::from_secs(20), || listens(&node.url(), client.run_id().unwrap())));
        }
        if step > 3 {
            client.diagnostic("residual", RESIDUALS[step - 4]).unwrap();
        }
        client.push(step as u64, step as f64, &Brick::new([0; 3], [SIDE; 3], &voxels(peak)[..])).unwrap();
    }
    wait_for(Duration::from_secs(20), || {
        asked.extend(client.steering());
        asked.iter().any(|s: &Steering| s.request == SteeringRequest::Pause)
    });
    client.close();
    let asked: Vec<_> = asked.into_iter().map(|s| (s.request, s.asked_by)).collect();
    assert_eq!(asked.last(), Some(&(SteeringRequest::Pause, "trigger burst".to_owned())));

    let rows = || -> Vec<StepRow> {
        let runs = std::fs::read_dir(&store).into_iter().flatten().flatten();
        let csv = runs.filter_map(|run| std::fs::read_to_string(run.path().join("steps.csv")).ok());
        csv.flat_map(|csv| csv.lines().skip(1).filter_map(StepRow::from_csv).collect::<Vec<_>>()).collect()
    };
    assert!(wait_for(Duration::from_secs(20), || rows().len() == PEAKS.len()), "{:?}", rows());
    let fired: Vec<_> = rows().into_iter().map(|row| row.triggers).collect();
    let none = Vec::<String>::new();
    let calm = || vec!["calm".to_owned()];
    let [burst, diverged] = ["burst", "diverged"].map(|name| vec![name.to_owned()]);
    assert_eq!(fired, [calm(), none.clone(), none.clone(), burst, none, calm(), diverged]);
    let told: Vec<_> = rows().iter().map(|row| row.diagnostics.get("residual")).collect();
    assert_eq!((&told[..4], &told[4..]), (&[None; 4][..], &RESIDUALS.map(Some)[..]));
    let residual = metric(&node.url()["http://".len()..], "lamina_generator_diagnostic{name=\"residual\"}");
    assert_eq!(residual, Some(RESIDUALS[2]));

    let files = || std::fs::read_dir(&raw).into_iter().flatten().flatten().map(|f| f.path()).collect::<Vec<_>>();
    assert!(wait_for(Duration::from_secs(10), || files().iter().any(|f| f.extension().is_some_and(|e| e == "raw"))));
    let ending = |e: &str| files().into_iter().find(|f| f.extension().is_some_and(|of| of == e));
    let pictures = || files().into_iter().filter(|f| f.extension().is_some_and(|e| e == "png")).collect::<Vec<_>>();
    assert!(wait_for(Duration::from_secs(10), || pictures().len() == 2));
    assert!(wait_for(Duration::from_secs(10), || ending("vdi").is_some()));
    assert_eq!(files().len(), 4, "{:?}", files());
    // The copy has all points, each value within the bound, of all that fits the size; the recorded step is as it was.
    let copy = std::fs::read(ending("vdi").unwrap()).unwrap();
    assert!(copy.len() <= 3000, "{} bytes", copy.len());
    let Intermediate::Volume(copy) = decode_any(&copy, &DecodeLimits::default()).unwrap() else {
        panic!("not a reduced volume")
    };
    assert_eq!((copy.grid().dims(), copy.params().error_bound()), ([SIDE; 3], 0.0005));
    let range = scene.transfer.range();
    for (unit, value) in copy.units().iter().zip(voxels(PEAKS[3])) {
        let error = (f64::from(*unit) - f64::from(range.unit_from_value(f64::from(value)))).abs();
        assert!(error <= 0.0005 + 1e-6, "{value} is off by {error} of the range");
    }
    let file = &ending("raw").unwrap();
    let read = Series::open(file, &Options::default()).unwrap().read(0).unwrap();
    assert_eq!(read.voxels(), &Voxels::F32(voxels(PEAKS[3])), "{}", file.display());
    for file in pictures() {
        let is_turned = file.file_stem().unwrap().to_string_lossy().ends_with("_90deg");
        let camera = scene.camera.rotated_about_y(if is_turned { 90.0 } else { 0.0 }).unwrap();
        let picture = png::Decoder::new(BufReader::new(File::open(file).unwrap()));
        let mut picture = picture.read_info().unwrap();
        let mut pixels = vec![0; picture.output_buffer_size().unwrap()];
        let shape = picture.next_frame(&mut pixels).unwrap();
        let cast = Backend::cpu().raycast(&Field::new(volume(PEAKS[3]), &scene), &camera, shape.width, shape.height);
        assert_eq!((shape.width, &pixels), (768, &cast.unwrap().to_rgb8()), "turned: {is_turned}");
    }
    // It was told again after it had not listened, of the one trigger that asks for it.
    let told: Vec<serde_json::Value> = posted.iter().take(2).collect();
    assert_eq!(told[0], told[1]);
    assert_eq!([&told[0]["trigger"], &told[0]["step"], &told[0]["time"]], [&json!("burst"), &json!(3), &json!(3.0)]);
    assert!(told[0]["text"].as_str().unwrap().contains("burst fired at step 3"), "{}", told[0]);
    assert!(posted.recv_timeout(Duration::from_secs(3)).is_err(), "told more often");
    let fired = |name: &str| {
        metric(&node.url()["http://".len()..], &format!("lamina_generator_triggers_fired_total{{trigger=\"{name}\"}}"))
    };
    assert_eq!([fired("burst"), fired("calm"), fired("other")], [Some(1.0), Some(2.0), None]);
}

/// An address for posts, and their bodies; the first is answered 503, the others 200.
fn receive_posts() -> (String, Receiver<serde_json::Value>) {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let address = format!("http://{}/hook?token=secret", listener.local_addr().unwrap());
    let (bodies, received) = channel();
    std::thread::spawn(move || {
        for (n, connection) in listener.incoming().enumerate() {
            let mut reader = BufReader::new(connection.unwrap());
            let mut lines = reader.by_ref().lines().map(Result::unwrap);
            assert_eq!(lines.next().unwrap(), "POST /hook?token=secret HTTP/1.1");
            let headers: Vec<String> = lines.take_while(|line| !line.is_empty()).collect();
            let length = headers.iter().find_map(|h| h.to_lowercase().strip_prefix("content-length: ")?.parse().ok());
            let mut body = vec![0; length.unwrap()];
            reader.read_exact(&mut body).unwrap();
            let status = if n == 0 { "503 Service Unavailable" } else { "200 OK" };
            let answer = format!("HTTP/1.1 {status}\r\ncontent-length: 0\r\nconnection: close\r\n\r\n");
            reader.get_mut().write_all(answer.as_bytes()).unwrap();
            bodies.send(serde_json::from_slice(&body).unwrap()).unwrap();
        }
    });
    (address, received)
}

#[test]
fn triggers_are_set_and_removed_from_the_page_and_the_record_says_by_whom() {
    let folder = tempfile::tempdir().unwrap();
    let node = Daemon::start("generator-node", free_port(), &["--backend", "cpu"]);
    let viewer = folder.path().join("viz-node.toml");
    let store = folder.path().join("runs");
    std::fs::write(&viewer, format!("store = \"{}\"\n", store.display())).unwrap();
    let viz = ["--backend", "cpu", "--config", viewer.to_str().unwrap(), "--generator", &node.url()];
    let viz = Daemon::start("viz-node", free_port(), &viz);
    let grid = Grid::new([SIDE; 3], DVec3::ONE, DVec3::ZERO).unwrap();
    let options = RunOptions::new(&node.url(), "bursts", "density", grid, VoxelType::F32);
    let mut client = Client::connect(RunOptions { full_policy: FullPolicy::Block, ..options }).unwrap();
    let file = |name: &str| -> String {
        let runs = std::fs::read_dir(&store).into_iter().flatten().flatten();
        runs.filter_map(|run| std::fs::read_to_string(run.path().join(name)).ok()).collect()
    };
    let rows = || file("steps.csv").lines().skip(1).filter_map(StepRow::from_csv).collect::<Vec<_>>();
    let mut push = |step: u64, peak: f32| {
        let voxels: Vec<f32> = (0..SIDE.pow(3)).map(|n| if n % 97 == 0 { peak } else { 0.3 }).collect();
        client.push(step, step as f64, &Brick::new([0; 3], [SIDE; 3], &voxels[..])).unwrap();
        assert!(wait_for(Duration::from_secs(20), || rows().iter().any(|row| row.step == step)), "{step}");
    };
    push(0, 1.0);

    let known = || -> serde_json::Value {
        let answer = curl(&format!("{}/api/state", viz.url()), &[]).1;
        let body = answer.split_once("\r\n\r\n").map(|(_, body)| body);
        serde_json::from_str(body.unwrap_or_default()).unwrap_or_default()
    };
    assert!(wait_for(Duration::from_secs(20), || known()["steerable"]["triggers"] == serde_json::json!([])));
    let ask = |change: &str| {
        curl(&format!("{}/api/trigger", viz.url()), &["--header", "content-type: application/json", "--data", change])
    };
    let burst = r#"{"name":"burst","when":"max > 3 * prev(max)","do":["pause"]}"#;
    assert_eq!(ask(&format!("{{\"set\":{burst}}}")).0, "204");
    push(1, 1.0);
    push(2, 9.0);
    for (change, words) in [
        (r#"{"set":{"name":"x","when":"ssim > 3","do":[]}}"#, "none of step, time"),
        (r#"{"set":{"name":"../x","when":"max > 3","do":[]}}"#, "letters, digits"),
        (r#"{"set":{"name":"x","when":"max > 3","do":["explode"]}}"#, "explode"),
        (r#"{"set":{"name":"x","when":"max > 3","do":["webhook"]}}"#, "nobody can be told"),
        (r#"{"set":{"name":"x","when":"max > 3","do":["picture"],"angles":[400]}}"#, "400"),
        (r#"{"remove":"x"}"#, "there are: burst"),
    ] {
        let (status, answer) = ask(change);
        assert!(status.starts_with('4') && answer.contains(words), "{change}: {status} {answer}");
    }
    let one = serde_json::json!([serde_json::from_str::<serde_json::Value>(burst).unwrap()]);
    assert!(wait_for(Duration::from_secs(20), || known()["steerable"]["triggers"] == one), "{}", known());
    assert_eq!(ask(r#"{"remove":"burst"}"#).0, "204");
    push(3, 1.0);
    push(4, 9.0);
    client.close();
    let fired: Vec<u64> = rows().iter().filter(|row| row.triggers == ["burst"]).map(|row| row.step).collect();
    assert_eq!(fired, [2]);
    let requests = file("requests.csv");
    for words in ["trigger burst: when max > 3 * prev(max), pause", "trigger burst: removed", "browser at 127.0.0.1"] {
        assert!(requests.contains(words), "{requests}");
    }
}

#[test]
fn conditions_that_cannot_be_are_refused_before_the_node_listens() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("generator-node.toml");
    for (when, word) in [("ssim > 3", "none of step, time"), ("max >", "max >"), ("quantile(7) > 1", "0 to 1")] {
        std::fs::write(&config, format!("[[trigger]]\nname = \"x\"\nwhen = \"{when}\"\ndo = [\"pause\"]\n")).unwrap();
        is_refused("generator-node", &["--config", config.to_str().unwrap()], &["trigger", word]);
    }
    for address in ["", "hook", "file:///etc/passwd", "https://", "http:///path"] {
        std::fs::write(&config, format!("webhook = \"{address}\"\n")).unwrap();
        is_refused("generator-node", &["--config", config.to_str().unwrap()], &["webhook", "https://HOST/PATH"]);
    }
}
