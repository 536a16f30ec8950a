//! Who is let in: real nodes with credentials, and everybody who should not be.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use futures::StreamExt as _;
use lamina_client::{Brick, Client, ClientError, RunOptions};
use lamina_model::VoxelType;
use lamina_rpc::connect::connect;
use lamina_rpc::credentials::{Credentials, Role};
use lamina_rpc::v1::{self, control_client::ControlClient, frames_client::FramesClient, tuning_client::TuningClient};
use lamina_tests::browser::Browser;
use lamina_tests::http::{curl, metric};
use lamina_tests::processes::{Daemon, binary, free_port, run, wait_for};
use lamina_tests::{clumps, sampled_cube};
use serde_json::json;
use std::io::{BufRead as _, BufReader, ErrorKind, Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use tokio::runtime::Runtime;
use tonic::Code;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_client::HealthClient;

/// A node with the credentials of its role.
fn node(name: &str, keys: &Path, role: Role, arguments: &[&str]) -> (Daemon, String) {
    let (port, folder) = (free_port(), keys.join(role.name()).display().to_string());
    let daemon = Daemon::start(name, port, &[&["--credentials", &folder], arguments].concat());
    (daemon, format!("https://127.0.0.1:{port}"))
}

fn make_keys(folder: &Path) {
    run("lamina", &["keys", &folder.display().to_string(), "--days", "2"]);
}

fn of(keys: &Path, role: Role) -> Option<Credentials> {
    Some(Credentials::open(keys.join(role.name())).unwrap())
}

fn options(generator: &str, credentials: Option<&Path>) -> RunOptions {
    let volume = sampled_cube(24, clumps);
    let options = RunOptions::new(generator, "trust", "density", *volume.grid(), VoxelType::F64);
    RunOptions { credentials: credentials.map(Path::to_owned), ..options }
}

fn push(generator: &str, credentials: Option<&Path>, steps: u64) -> Result<(), ClientError> {
    let mut client = Client::connect(options(generator, credentials))?;
    let volume = sampled_cube(24, clumps);
    let lamina_model::Voxels::F64(voxels) = volume.voxels() else { unreachable!("made of f64") };
    for step in 0..steps {
        client.push(step, step as f64, &Brick::new([0; 3], [24; 3], &voxels[..]))?;
    }
    client.close();
    Ok(())
}

#[test]
fn nodes_with_credentials_work_together_and_each_role_does_only_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let [keys, others] = ["keys", "others"].map(|name| folder.path().join(name));
    make_keys(&keys);
    make_keys(&others);
    let (generator, at_generator) = node("generator-node", &keys, Role::Generator, &[]);
    let (_viz, at_viz) = node("viz-node", &keys, Role::Viewer, &["--generator", &at_generator]);
    let config = folder.path().join("tuner.toml");
    std::fs::write(&config, "contract = \"size <= 40kB\"\nbudget = 1.0\n").unwrap();
    let arguments = ["--generator", &at_generator, "--config", &config.display().to_string()];
    let (_tuner, at_tuner) = node("tuner", &keys, Role::Tuner, &arguments);

    push(&at_generator, Some(&keys.join("simulation")), 3).unwrap();
    let [certificate, key] = ["cert.pem", "key.pem"].map(|name| keys.join("viewer").join(name).display().to_string());
    let as_viewer = ["--cert", certificate.as_str(), "--key", key.as_str()];
    // The last step came, its quality was measured, and its parameters are a study's: all links carry.
    let shown = wait_for(Duration::from_secs(60), || {
        let (_, state) = curl(&format!("{at_viz}/api/state"), &as_viewer);
        state.contains("\"step\":2") && state.contains("\"measured\":\"yes\"")
    });
    assert!(shown, "{:?}", curl(&format!("{at_viz}/api/state"), &as_viewer));
    let runtime = Runtime::new().unwrap();
    let studied = wait_for(Duration::from_secs(60), || {
        runtime.block_on(async {
            let channel = connect(&at_tuner, Role::Tuner, of(&keys, Role::Admin).as_ref()).await.unwrap();
            let status =
                TuningClient::new(channel).status(v1::TunerStatusRequest { with_trials: false }).await.unwrap();
            status.into_inner().studies > 0
        })
    });
    assert!(studied, "trials go from generator-node to viz-node and their measurements to the tuner");

    // A simulation cannot set parameters or look on, a viewer cannot push or set, a tuner cannot push.
    for role in Role::ALL {
        let may = |roles: &[Role]| {
            if roles.contains(&role) || role == Role::Admin { None } else { Some(Code::PermissionDenied) }
        };
        let (set, subscribed) = runtime.block_on(async {
            let channel = connect(&at_generator, Role::Generator, of(&keys, role).as_ref()).await.unwrap();
            let set = ControlClient::new(channel.clone()).watch(v1::WatchRequest {}).await.err().map(|s| s.code());
            let subscribed = FramesClient::new(channel).subscribe(v1::SubscribeRequest::default()).await;
            (set, subscribed.err().map(|status| status.code()))
        });
        assert_eq!((set, subscribed), (may(&[Role::Tuner]), may(&[Role::Viewer])), "{role}");
        let pushed = Client::connect(options(&at_generator, Some(&keys.join(role.name()))));
        match pushed {
            Ok(_) => assert!(matches!(role, Role::Simulation | Role::Admin), "{role}"),
            Err(ClientError::Refused(words)) => assert!(words.contains(&format!("a {role}'s certificate")), "{words}"),
            Err(other) => panic!("{role}: {other}"),
        }
    }

    // Certificates of another authority, none at all, and no TLS.
    let strangers = runtime.block_on(connect(&at_generator, Role::Generator, of(&others, Role::Admin).as_ref()));
    assert!(strangers.is_err(), "the node's certificate is not of their authority, nor theirs of its");
    let plain = at_generator.replace("https", "http");
    assert!(push(&plain, None, 1).is_err());
    assert!(matches!(push(&at_generator, None, 1), Err(ClientError::Invalid(_))), "https asks for credentials");
    // A node of another role does not pass for a generator-node.
    assert!(runtime.block_on(connect(&at_tuner, Role::Generator, of(&keys, Role::Viewer).as_ref())).is_err());

    // New certificates of the same authority are taken up by the nodes that run.
    let before = std::fs::read(keys.join("generator/cert.pem")).unwrap();
    make_keys(&keys);
    assert_ne!(std::fs::read(keys.join("generator/cert.pem")).unwrap(), before);
    push(&at_generator, Some(&keys.join("simulation")), 1).unwrap();
    // Files that cannot be used leave those before in use.
    std::fs::write(keys.join("generator/cert.pem"), "nothing").unwrap();
    push(&at_generator, Some(&keys.join("simulation")), 1).unwrap();
    assert_eq!(generator.terminate(), Some(0));
}

/// A viz-node with the keys in `keys`, its page, and the addresses that it prints: to watch, to steer.
fn viewer_with_tokens(keys: &Path) -> (Child, String, [String; 2]) {
    let (port, credentials) = (free_port(), keys.join("viewer").display().to_string());
    let mut command = Command::new(binary("viz-node"));
    let listen = format!("127.0.0.1:{port}");
    command.args(["--listen", &listen, "--credentials", &credentials, "--generator", "https://127.0.0.1:9"]);
    let mut child = command.stdin(Stdio::null()).stdout(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
    let printed =
        ["watch it at ", "steer it at "].map(|words| lines.next().unwrap().strip_prefix(words).unwrap().to_owned());
    (child, format!("https://127.0.0.1:{port}"), printed)
}

#[test]
fn a_browser_enters_with_the_token_that_was_printed() {
    let folder = tempfile::tempdir().unwrap();
    make_keys(folder.path());
    let (mut child, page, [entrance, steering]) = viewer_with_tokens(folder.path());
    assert!(entrance.starts_with(&page), "{entrance}");
    assert_eq!(curl(&page, &[]).0, "401");
    for path in ["", "api/state", "api/events", "api/step/0", "api/image?step=newest", "metrics"] {
        let asked = format!("{page}/{path}");
        assert_eq!(curl(&asked, &[]).0, "401", "{path}");
        // What it says of itself opens nothing.
        assert_eq!(curl(&asked, &["--header", "content-type: application/grpc"]).0, "401", "{path}");
    }
    let (status, entered) = curl(&entrance, &[]);
    assert_eq!(status, "200");
    let cookie = entered.lines().find_map(|line| line.strip_prefix("set-cookie: ")).unwrap();
    let session = cookie.split(';').next().unwrap();
    let (status, shown) = curl(&page, &["--cookie", session]);
    assert_eq!((status.as_str(), shown.contains("<title>")), ("200", true));
    assert_eq!(curl(&entrance, &[]).0, "401", "the token was used");
    // Who came in to watch changes nothing; who came in to steer may, but there is no tuner yet, and no run.
    let post = |session: &str, path: &str, body: &str| {
        let json = ["--header", "content-type: application/json", "--data", body, "--cookie", session];
        curl(&format!("{page}/api/{path}"), &json).0
    };
    let (status, entered) = curl(&steering, &[]);
    assert_eq!(status, "200");
    let steerer = entered.lines().find_map(|line| line.strip_prefix("set-cookie: ")).unwrap();
    let contract = r#"{"contract":"size <= 1kB"}"#;
    assert_eq!([session, steerer].map(|of| post(of, "contract", contract)), ["403", "503"]);
    assert_eq!([session, steerer].map(|of| post(of, "steer", "\"pause\"")), ["403", "400"]);
    assert_eq!(post(session, "trigger", "{\"remove\":\"x\"}"), "403");
    assert_eq!(post("none=1", "steer", "\"pause\""), "401");
    // A name that leads here is not this host's (DNS rebinding); another site's script asks (cross-site request).
    assert_eq!(curl(&page, &["--cookie", session, "--header", "Host: evil.example"]).0, "421");
    let cross_site = ["--cookie", session, "--header", "Sec-Fetch-Site: cross-site"];
    assert_eq!(curl(&format!("{page}/api/state"), &cross_site).0, "403");
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn a_real_browser_enters_by_the_printed_address_and_no_script_reads_its_session() {
    let folder = tempfile::tempdir().unwrap();
    make_keys(folder.path());
    let (mut child, page, entrances) = viewer_with_tokens(folder.path());
    let page = page + "/";
    for (entrance, may_steer) in entrances.iter().zip([false, true]) {
        let profile = folder.path().join(if may_steer { "steer" } else { "watch" }).display().to_string();
        // It does not know the private authority; a person imports it.
        let browser = Browser::open(&profile, &["--ignore-certificate-errors"]);
        let open = |url: &str| browser.post("/url", &json!({"url": url}));
        open(entrance);
        browser.wait_js(&format!("location.href === '{page}' && document.title.includes('Lamina')"));
        assert_eq!(browser.js("document.cookie"), json!(""));
        let state = "fetch('/api/state').then(answer => answer.json()).then(state => state.may_steer)";
        assert_eq!(browser.promised(state), json!(may_steer));
        // The token is used, the session goes on; another site's script reads nothing with it.
        open(&page);
        browser.wait_js("document.title.includes('Lamina')");
        open("data:text/html,elsewhere");
        let asked =
            format!("fetch('{page}api/state', {{credentials: 'include'}}).then(a => a.text(), () => 'refused')");
        assert_eq!(browser.promised(&asked), json!("refused"));
    }
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn other_users_of_this_host_are_refused() {
    use std::os::unix::fs::MetadataExt as _;
    let viz = Daemon::start("viz-node", free_port(), &["--generator", "http://127.0.0.1:9"]);
    assert_eq!(curl(&viz.url(), &[]).0, "200");
    if std::fs::metadata("/proc/self").unwrap().uid() != 0 {
        eprintln!("another user takes root: not tried");
        return;
    }
    let nobody = Command::new("setpriv")
        .args(["--reuid=65534", "--clear-groups", "curl", "--silent", "--include", &viz.url()])
        .output()
        .unwrap();
    let answer = String::from_utf8_lossy(&nobody.stdout).into_owned();
    assert!(answer.starts_with("HTTP/1.1 403") && answer.contains("user 65534"), "{answer}");
}

#[test]
fn nodes_that_others_could_reach_start_with_credentials_or_not_at_all() {
    for name in ["generator-node", "viz-node", "tuner"] {
        let listen = format!("0.0.0.0:{}", free_port());
        let refused = Command::new(binary(name)).args(["--listen", &listen]).output().unwrap();
        let words = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(!refused.status.success() && words.contains("--credentials DIR"), "{name}: {words}");
        let nowhere = ["--listen", "127.0.0.1:0", "--credentials", "/nonexistent"];
        let refused = Command::new(binary(name)).args(nowhere).output().unwrap();
        let words = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(!refused.status.success() && words.contains("/nonexistent/ca.pem"), "{name}: {words}");
    }
    let port = free_port();
    let open = Daemon::start_plain("generator-node", port, &["--listen", &format!("0.0.0.0:{port}"), "--insecure"]);
    assert_eq!(open.terminate(), Some(0));
}

/// True once the other side has closed the connection.
fn is_closed(connection: &mut TcpStream) -> bool {
    connection.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
    match connection.read(&mut [0; 256]) {
        Ok(count) => count == 0,
        Err(e) => !matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut),
    }
}

#[test]
fn connections_that_send_nothing_or_half_a_request_are_closed() {
    let generator = Daemon::start("generator-node", free_port(), &[]);
    let url = generator.url();
    let viz = Daemon::start("viz-node", free_port(), &["--generator", &url]);
    // Nothing, half a preface of HTTP/2, and half the head of a request that comes in pieces.
    let beginnings: [&[u8]; 3] = [b"", b"PRI * HTTP/2", b"GET /api/state HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: "];
    let mut connections = Vec::new();
    for daemon in [&generator, &viz] {
        for beginning in beginnings.iter().cycle().take(60) {
            let mut connection = TcpStream::connect(daemon.url().trim_start_matches("http://")).unwrap();
            connection.write_all(beginning).unwrap();
            connections.push(connection);
        }
    }
    let (code, _) = curl(&format!("{}/api/state", viz.url()), &[]);
    assert_eq!(code, "200", "others are served meanwhile");
    let all = connections.len();
    let closed = wait_for(Duration::from_secs(60), || {
        connections.retain_mut(|connection| {
            // A header that grows for ever is no request either.
            let _ = connection.write_all(b"");
            !is_closed(connection)
        });
        connections.is_empty()
    });
    assert!(closed, "{} of {all} are still open", connections.len());
}

#[test]
fn a_connection_that_asks_for_too_much_is_told_to_wait() {
    let viz = Daemon::start("viz-node", free_port(), &["--generator", &format!("http://127.0.0.1:{}", free_port())]);
    let address = viz.url();
    let mut connection = TcpStream::connect(address.trim_start_matches("http://")).unwrap();
    let request = b"GET /icon.svg HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n";
    let mut sent = connection.try_clone().unwrap();
    // In one go: the answers are read meanwhile.
    let sending = std::thread::spawn(move || sent.write_all(&request.repeat(1000)));
    let mut answers = BufReader::new(&mut connection);
    let (mut good, mut refused, mut line) = (0, 0, String::new());
    while good + refused < 1000 {
        line.clear();
        assert!(answers.read_line(&mut line).unwrap_or(0) > 0, "closed after {good} and {refused}");
        good += u32::from(line.contains("HTTP/1.1 200"));
        refused += u32::from(line.contains("HTTP/1.1 429"));
    }
    sending.join().unwrap().unwrap();
    assert!(good >= 400 && refused > 0, "{good} answered, {refused} refused");
    // Another connection is served, and the metrics say what happened.
    let (code, text) = curl(&format!("{address}/metrics"), &[]);
    let counted = text.lines().find_map(|line| line.strip_prefix("lamina_rate_limited_total "));
    assert_eq!((code.as_str(), counted), ("200", Some(refused.to_string().as_str())));
    // A body that does not come is not waited for.
    let mut slow = TcpStream::connect(address.trim_start_matches("http://")).unwrap();
    let head = "POST /api/contract HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\nContent-Length: 20\r\n\r\n{";
    slow.write_all(head.as_bytes()).unwrap();
    let mut first = String::new();
    slow.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    BufReader::new(slow).read_line(&mut first).unwrap();
    assert!(first.contains("408"), "{first}");
}

#[test]
fn every_node_counts_what_it_does_and_bounds_the_calls_of_a_connection() {
    let generator = Daemon::start("generator-node", free_port(), &[]);
    let viz = Daemon::start("viz-node", free_port(), &["--generator", &generator.url()]);
    let tuner = Daemon::start("tuner", free_port(), &["--generator", &generator.url()]);
    push(&generator.url(), None, 3).unwrap();
    let recorded = || metric(&viz.url(), "lamina_frames_total") == Some(3.0);
    assert!(wait_for(Duration::from_secs(60), recorded), "{:?}", curl(&format!("{}/metrics", viz.url()), &[]));
    let at_generator = |name| metric(&generator.url(), name);
    // Three steps of 24^3 doubles.
    assert_eq!(at_generator("lamina_generator_received_bytes_total"), Some(f64::from(3 * 24 * 24 * 24 * 8)));
    assert_eq!(at_generator("lamina_generator_step_size_bytes_count"), Some(3.0));
    let bytes = metric(&viz.url(), "lamina_frame_bytes_total");
    assert_eq!(at_generator("lamina_generator_step_size_bytes_sum"), bytes, "what was sent is what came");
    let seen = || metric(&tuner.url(), "lamina_tuner_step") == Some(2.0);
    assert!(wait_for(Duration::from_secs(60), seen), "{:?}", curl(&format!("{}/metrics", tuner.url()), &[]));
    for node in [&generator, &tuner] {
        let metrics = format!("{}/metrics", node.url());
        assert_eq!(curl(&metrics, &["--header", "Sec-Fetch-Site: same-origin"]).0, "403", "a page's script");
        assert_eq!(curl(&metrics, &["--header", "Sec-Fetch-Site: none"]).0, "200", "what a user typed");
        assert_eq!(curl(&node.url(), &[]).0, "404");
        let refused = Runtime::new().unwrap().block_on(async {
            let health = HealthClient::new(connect(&node.url(), Role::Generator, None).await.unwrap());
            let question = |n: usize| {
                let mut health = health.clone();
                async move { (n, health.check(HealthCheckRequest::default()).await.err().map(|status| status.code())) }
            };
            let answers = futures::stream::iter(0..2000).map(question).buffer_unordered(64).collect::<Vec<_>>().await;
            assert!(answers.iter().all(|(_, code)| code.is_none_or(|code| code == Code::ResourceExhausted)));
            answers.iter().filter(|(_, code)| code.is_some()).count()
        });
        assert!((1..=1600).contains(&refused), "{refused} of 2000 refused");
        assert_eq!(metric(&node.url(), "lamina_rate_limited_total"), Some(refused as f64));
    }
}

#[test]
fn a_cluster_is_examined_link_by_link() {
    let folder = tempfile::tempdir().unwrap();
    let keys = folder.path().join("keys");
    make_keys(&keys);
    let (_generator, at_generator) = node("generator-node", &keys, Role::Generator, &[]);
    let plain = Daemon::start("tuner", free_port(), &["--generator", &at_generator.replace("https", "http")]);
    let doctor = |cluster: &str| {
        let admin = keys.join("admin").display().to_string();
        let arguments = ["doctor", "--cluster", cluster, "--credentials", &admin];
        let output = Command::new(binary("lamina")).args(arguments).output().unwrap();
        (output.status.success(), String::from_utf8(output.stdout).unwrap())
    };
    let (good, said) = doctor(&format!("generator={at_generator},tuner={}", plain.url()));
    assert!(good, "{said}");
    let number = |line: &str, before: &str| -> f64 {
        let end = line.find(before).unwrap_or_else(|| panic!("no {before} in {line}"));
        line[..end].rsplit(' ').next().unwrap().parse().unwrap()
    };
    for (line, tls) in said.lines().zip(["TLS 1.3", "no TLS"]) {
        assert!(line.contains(tls) && !line.contains("install"), "{line}");
        assert!(number(line, " MB/s") > 1.0, "{line}");
        // The same host's clock, known to half a round trip.
        let clock = line.split("clock ").nth(1).unwrap().split(' ').next().unwrap().parse::<f64>().unwrap();
        let round_trip = line.split("round trip ").nth(1).unwrap().split(' ').next().unwrap().parse::<f64>().unwrap();
        assert!(clock.abs() <= round_trip / 2.0 + 0.1, "{line}");
    }
    let nobody = format!("viewer=http://127.0.0.1:{}", free_port());
    let (good, said) = doctor(&format!("{nobody},generator={}", at_generator.replace("https", "http")));
    assert!(!good && said.matches("UNUSABLE").count() == 2, "{said}");
    assert!(said.contains("--listen") && said.contains("then it is https://"), "{said}");
}
