//! The real binaries as processes, on free ports, ended with the value that holds them.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicU16, Ordering::Relaxed};
use std::time::{Duration, Instant};
use tokio::net::TcpSocket;

/// The built binary `name`, beside this test's own.
///
/// # Panics
/// If the workspace's binaries have not been built.
pub fn binary(name: &str) -> PathBuf {
    let test = std::env::current_exe().expect("a running test has a path");
    let path = test.ancestors().nth(2).expect("tests lie in target/*/deps").join(name);
    assert!(path.exists(), "{} is missing: run `cargo build --workspace --release` first", path.display());
    path
}

/// A port nobody listens on now, below those that systems hand to outgoing connections, and never the same one twice:
/// until the daemon it is for listens there, nobody else takes it.
///
/// # Panics
/// If there is none.
pub fn free_port() -> u16 {
    static NEXT: AtomicU16 = AtomicU16::new(0);
    let first = 10_000 + (std::process::id() % 200) as u16 * 100;
    // Bound, but never listening: another thread's child holds a copy of the socket until it executes, and a daemon
    // that is waited for must not seem to accept connections there.
    let free = |port: &u16| {
        let socket = TcpSocket::new_v4().expect("a socket");
        socket.set_reuseaddr(true).and_then(|()| socket.bind((Ipv4Addr::LOCALHOST, *port).into())).is_ok()
    };
    (0..1000).map(|_| first + NEXT.fetch_add(1, Relaxed)).find(free).expect("a free port")
}

/// A daemon that is killed when dropped.
#[derive(Debug)]
pub struct Daemon {
    child: Child,
    /// Where it listens.
    pub address: SocketAddr,
}

impl Daemon {
    /// Starts `name --listen 127.0.0.1:port arguments...` and waits until it accepts connections.
    ///
    /// # Panics
    /// If it does not come up within a minute.
    pub fn start(name: &str, port: u16, arguments: &[&str]) -> Self {
        let listen = format!("127.0.0.1:{port}");
        Self::start_plain(name, port, &[&["--listen", &listen], arguments].concat())
    }

    /// Starts `name arguments...`, which are to make it listen on `port`, and waits until it accepts connections.
    ///
    /// # Panics
    /// If it does not come up within a minute.
    pub fn start_plain(name: &str, port: u16, arguments: &[&str]) -> Self {
        let mut command = Command::new(binary(name));
        command.args(arguments).stdin(Stdio::null()).stdout(Stdio::null());
        Self::spawn(command, port)
    }

    /// Starts `command`, which is to make it listen on `port`, and waits until it accepts connections.
    ///
    /// # Panics
    /// If it does not come up within a minute.
    pub fn spawn(mut command: Command, port: u16) -> Self {
        let (address, name) = (SocketAddr::from((Ipv4Addr::LOCALHOST, port)), format!("{:?}", command.get_program()));
        let mut daemon = Self { child: command.spawn().expect("the binary starts"), address };
        let up = wait_for(Duration::from_secs(60), || {
            assert!(daemon.child.try_wait().expect("a child").is_none(), "{name} ended early");
            std::net::TcpStream::connect(address).is_ok()
        });
        assert!(up, "{name} does not listen on {address}");
        daemon
    }

    /// `http://HOST:PORT`.
    pub fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    /// Processes named `name` below it.
    pub fn children(&self, name: &str) -> Vec<u32> {
        let stat = |pid: u32| {
            let text = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
            let (head, tail) = text.rsplit_once(')')?;
            let mut fields = tail.split_whitespace();
            let (state, parent) = (fields.next()?.to_owned(), fields.next()?.parse::<u32>().ok()?);
            Some((head.split_once('(')?.1.to_owned(), state, parent))
        };
        let all = std::fs::read_dir("/proc").into_iter().flatten().flatten();
        let pids: Vec<u32> = all.filter_map(|e| e.file_name().to_str()?.parse().ok()).collect();
        let below = |pid: u32| {
            std::iter::successors(stat(pid), |(_, _, parent)| stat(*parent)).any(|(_, _, parent)| parent == self.pid())
        };
        let named = |pid: u32| stat(pid).is_some_and(|(found, state, _)| found == name && state != "Z");
        pids.into_iter().filter(|&pid| named(pid) && below(pid)).collect()
    }

    /// Its process.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Sends it the signal `name`: after STOP it stays, and answers nothing.
    ///
    /// # Panics
    /// If there is no `kill`.
    pub fn signal(&self, name: &str) {
        Command::new("kill").args([&format!("-{name}"), &self.pid().to_string()]).status().expect("kill runs");
    }

    /// SIGKILL.
    pub fn kill(mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    /// SIGTERM; gives the exit code.
    ///
    /// # Panics
    /// If it does not end within 20 seconds.
    pub fn terminate(mut self) -> Option<i32> {
        self.signal("TERM");
        let mut status = None;
        let ended = wait_for(Duration::from_secs(20), || {
            status = self.child.try_wait().expect("a child");
            status.is_some()
        });
        assert!(ended, "did not stop on SIGTERM");
        status.and_then(|s| s.code())
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Runs `name arguments...` to its end.
///
/// # Panics
/// If it cannot be started.
pub fn run(name: &str, arguments: &[&str]) -> Output {
    Command::new(binary(name)).args(arguments).stdin(Stdio::null()).output().expect("the binary starts")
}

/// Polls `condition` until it holds or `patience` ends; says which.
pub fn wait_for(patience: Duration, mut condition: impl FnMut() -> bool) -> bool {
    let start = Instant::now();
    while start.elapsed() < patience {
        if condition() {
            return true;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    condition()
}

/// The series recorded by the project's own example simulation.
pub fn recorded_series() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("data/blast.pvd")
}

/// What `program` prints, which succeeds.
///
/// # Panics
/// If it fails.
pub fn stdout_of(program: &str, arguments: &[&str]) -> String {
    let output = run(program, arguments);
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{program} {arguments:?}: {out}{err}");
    out.into_owned()
}

/// Holds `program` to refusing `arguments` with an error that has all of `words`.
///
/// # Panics
/// If it succeeds, panics, or says something else.
pub fn is_refused(program: &str, arguments: &[&str], words: &[&str]) {
    let output = run(program, arguments);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success(), "{program} {arguments:?} went through");
    assert!(words.iter().all(|w| text.contains(w)), "{program} {arguments:?} said: {text}");
    assert!(!text.contains("panicked"), "{text}");
}

/// The number behind `name` in `output`.
///
/// # Panics
/// If there is none.
pub fn figure(output: &str, name: &str) -> f64 {
    let line = output.lines().find_map(|l| l.strip_prefix(name)).unwrap_or_else(|| panic!("no {name} in {output}"));
    line.trim().parse().expect("a number")
}
