//! A real browser: headless Chromium driven through ChromeDriver (WebDriver over HTTP).

use crate::processes::{Daemon, free_port, wait_for};
use base64::prelude::{BASE64_STANDARD, Engine as _};
use serde_json::{Value, json};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// A ChromeDriver session.
#[derive(Debug)]
pub struct Browser {
    driver: Child,
    session: String,
}

fn request(method: &str, url: &str, body: &Value) -> Value {
    let agent: ureq::Agent = ureq::Agent::config_builder().http_status_as_error(false).build().into();
    let answer = if method == "GET" { agent.get(url).call() } else { agent.post(url).send_json(body) };
    let answer: Value = answer.expect("a WebDriver answer").body_mut().read_json().expect("a WebDriver answer");
    assert!(answer["value"]["error"].is_null(), "{method} {url} {body}: {answer}");
    answer["value"].clone()
}

impl Browser {
    /// Headless Chromium with `flags` besides, and its data in the folder `profile`.
    ///
    /// # Panics
    /// If there is none.
    pub fn open(profile: &str, flags: &[&str]) -> Self {
        let port = free_port();
        let mut command = Command::new("chromedriver");
        command.arg(format!("--port={port}")).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        let driver = command.spawn().expect("chromedriver is installed by tests/run");
        let base = format!("http://127.0.0.1:{port}");
        let up = || ureq::get(format!("{base}/status")).call().is_ok();
        assert!(wait_for(Duration::from_secs(60), up), "chromedriver does not answer");
        let arguments = [
            "--headless",
            "--no-sandbox",
            "--disable-quic",
            "--no-first-run",
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-sync",
            "--window-size=1100,900",
            &format!("--user-data-dir={profile}"),
        ];
        let arguments: Vec<&str> = arguments.into_iter().chain(flags.iter().copied()).collect();
        let capabilities = json!({"capabilities": {"alwaysMatch": {
            "goog:chromeOptions": {"args": arguments},
            "goog:loggingPrefs": {"browser": "ALL"},
        }}});
        let session = request("POST", &format!("{base}/session"), &capabilities);
        let id = session["sessionId"].as_str().expect("a WebDriver answer");
        Self { driver, session: format!("{base}/session/{id}") }
    }

    /// A command of WebDriver.
    ///
    /// # Panics
    /// If it fails.
    pub fn post(&self, path: &str, body: &Value) -> Value {
        request("POST", &format!("{}{path}", self.session), body)
    }

    /// What a JavaScript expression is worth.
    ///
    /// # Panics
    /// If it throws.
    pub fn js(&self, expression: &str) -> Value {
        self.post("/execute/sync", &json!({"script": format!("return {expression}"), "args": []}))
    }

    /// What a promise comes to.
    ///
    /// # Panics
    /// If it is refused.
    pub fn promised(&self, expression: &str) -> Value {
        let script = format!("const done = arguments[0]; ({expression}).then(done, e => done({{error: String(e)}}))");
        let answer = self.post("/execute/async", &json!({"script": script, "args": []}));
        assert!(answer.get("error").is_none(), "{expression}: {answer}");
        answer
    }

    /// Waits until an expression is true.
    ///
    /// # Panics
    /// If it is not within 5 minutes: a GPU in software compiles kernels for one of them beside other tests.
    pub fn wait_js(&self, condition: &str) {
        let holds = wait_for(Duration::from_secs(300), || self.js(condition) == json!(true));
        assert!(holds, "not so: {condition}; the page says {}", self.js("document.body.innerText"));
    }

    /// Presses `key`, by its WebDriver code.
    ///
    /// # Panics
    /// If the browser is gone.
    pub fn key(&self, name: &str) {
        let code = match name {
            "Home" => "\u{e011}",
            "End" => "\u{e010}",
            "ArrowRight" => "\u{e014}",
            other => other,
        };
        let keys = json!([{"type": "keyDown", "value": code}, {"type": "keyUp", "value": code}]);
        self.post("/actions", &json!({"actions": [{"type": "key", "id": "keys", "actions": keys}]}));
    }

    /// What the mouse does.
    ///
    /// # Panics
    /// If the browser is gone.
    pub fn mouse(&self, actions: &[Value]) {
        let pointer =
            json!({"type": "pointer", "id": "mouse", "parameters": {"pointerType": "mouse"}, "actions": actions});
        self.post("/actions", &json!({"actions": [pointer]}));
    }

    /// The middle of `selector` on the page, not in the element: it may be drawn anew while the mouse is on its way.
    ///
    /// # Panics
    /// If there is none.
    pub fn middle(&self, selector: &str) -> [i32; 2] {
        let middle = self.js(&format!(
            "(() => {{ const e = document.querySelector('{selector}'); e.scrollIntoView({{block: 'center'}}); \
             const b = e.getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2].map(Math.round) }})()"
        ));
        [0, 1].map(|i| middle[i].as_i64().expect("a WebDriver answer") as i32)
    }

    /// Presses the mouse in the middle of `selector`, moves by (`dx`, `dy`), releases.
    ///
    /// # Panics
    /// If there is none.
    pub fn drag(&self, selector: &str, dx: i32, dy: i32) {
        let [x, y] = self.middle(selector);
        let moves = [move_to(x + dx / 2, y + dy / 2, 50), move_to(x + dx, y + dy, 50)];
        let [down, up] = ["pointerDown", "pointerUp"].map(|kind| json!({"type": kind, "button": 0}));
        self.mouse(&[&[move_to(x, y, 50), down][..], &moves, &[up]].concat());
    }

    /// Presses the mouse in the middle of `selector` and moves to and fro for about `seconds`, with an event every 16 ms.
    ///
    /// # Panics
    /// If there is none.
    pub fn drag_on(&self, selector: &str, seconds: u32) {
        let [x, y] = self.middle(selector);
        self.mouse(&[move_to(x, y, 0), json!({"type": "pointerDown", "button": 0})]);
        for second in 0..seconds {
            let side = if second % 2 == 0 { 3 } else { -3 };
            let moves: Vec<Value> = (-30..30).map(|i| move_to(x + side * i, y + i, 16)).collect();
            self.mouse(&moves);
        }
    }
}

/// Moves the mouse.
pub fn move_to(x: i32, y: i32, duration_ms: u32) -> Value {
    json!({"type": "pointerMove", "duration": duration_ms, "origin": "viewport", "x": x, "y": y})
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = ureq::delete(&self.session).call();
        let _ = self.driver.kill();
        let _ = self.driver.wait();
    }
}

/// Nothing went wrong on the page, and its server stops when told to. What was last seen stays in `target/screenshots`, by the name
/// of the test.
///
/// # Panics
/// If something did.
pub fn end(browser: &Browser, lamina: Daemon) {
    keep_screenshot(browser);
    let log = browser.post("/se/log", &json!({"type": "browser"}));
    let current = "fetch('api/state').then(r => r.json()).then(s => encodeURIComponent(s.run.id)).catch(() => '')";
    let current = browser.js(current);
    // A step of a run that another took the place of meanwhile, and that is not kept, may be asked for in vain.
    let is_replaced = |message: &str| {
        let of_step = message.contains("/api/step/") && message.contains("404");
        of_step && current.as_str().is_some_and(|current| !message.contains(current))
    };
    let is_error = |e: &&Value| e["level"] == "SEVERE" && !e["message"].as_str().is_some_and(is_replaced);
    let errors: Vec<_> = log.as_array().expect("a list").iter().filter(is_error).collect();
    assert!(errors.is_empty(), "{errors:?}");
    assert_eq!(lamina.terminate(), Some(0));
}

fn keep_screenshot(browser: &Browser) {
    let answer = request("GET", &format!("{}/screenshot", browser.session), &Value::Null);
    let png = BASE64_STANDARD.decode(answer.as_str().expect("a picture")).expect("base64");
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/screenshots");
    let name = std::thread::current().name().unwrap_or("page").replace("::", "-");
    std::fs::create_dir_all(&folder).expect("a folder");
    std::fs::write(folder.join(format!("{name}.png")), png).expect("a file");
}
