//! The viewer in a real browser: `lamina` live, headless Chromium driven through ChromeDriver (WebDriver over HTTP).

#![allow(clippy::unwrap_used)]

use lamina_tests::processes::{Daemon, free_port, wait_for};
use serde_json::{Value, json};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// A ChromeDriver session.
struct Browser {
    driver: Child,
    session: String,
}

fn request(method: &str, url: &str, body: &Value) -> Value {
    let agent: ureq::Agent = ureq::Agent::config_builder().http_status_as_error(false).build().into();
    let answer = if method == "GET" { agent.get(url).call() } else { agent.post(url).send_json(body) };
    let answer: Value = answer.unwrap().body_mut().read_json().unwrap();
    assert!(answer["value"]["error"].is_null(), "{method} {url} {body}: {answer}");
    answer["value"].clone()
}

impl Browser {
    fn open(profile: &str) -> Self {
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
            "--disable-gpu",
            "--disable-quic",
            "--no-first-run",
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-sync",
            "--window-size=1100,900",
            &format!("--user-data-dir={profile}"),
        ];
        let capabilities = json!({"capabilities": {"alwaysMatch": {
            "goog:chromeOptions": {"args": arguments},
            "goog:loggingPrefs": {"browser": "ALL"},
        }}});
        let session = request("POST", &format!("{base}/session"), &capabilities);
        let id = session["sessionId"].as_str().unwrap();
        Self { driver, session: format!("{base}/session/{id}") }
    }

    fn post(&self, path: &str, body: &Value) -> Value {
        request("POST", &format!("{}{path}", self.session), body)
    }

    /// What a JavaScript expression is worth.
    fn js(&self, expression: &str) -> Value {
        self.post("/execute/sync", &json!({"script": format!("return {expression}"), "args": []}))
    }

    fn wait_js(&self, condition: &str) {
        let holds = wait_for(Duration::from_secs(90), || self.js(condition) == json!(true));
        assert!(holds, "not so: {condition}; the page says {}", self.js("document.body.innerText"));
    }

    /// Presses `key`, by its WebDriver code.
    fn key(&self, name: &str) {
        let code = match name {
            "Home" => "\u{e011}",
            "End" => "\u{e010}",
            other => other,
        };
        let keys = json!([{"type": "keyDown", "value": code}, {"type": "keyUp", "value": code}]);
        self.post("/actions", &json!({"actions": [{"type": "key", "id": "keys", "actions": keys}]}));
    }

    /// Presses the mouse in the middle of `selector`, moves by (`dx`, `dy`), releases.
    fn drag(&self, selector: &str, dx: i32, dy: i32) {
        // Places on the page, not in the element: it may be drawn anew while the mouse is on its way.
        let middle = self.js(&format!(
            "(() => {{ const e = document.querySelector('{selector}'); e.scrollIntoView({{block: 'nearest'}}); \
             const b = e.getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2].map(Math.round) }})()"
        ));
        let [x0, y0] = [0, 1].map(|i| middle[i].as_i64().unwrap() as i32);
        let mouse = |x: i32, y: i32| json!({"type": "pointerMove", "duration": 50, "origin": "viewport", "x": x0 + x, "y": y0 + y});
        let actions = json!([mouse(0, 0), {"type": "pointerDown", "button": 0}, mouse(dx / 2, dy / 2), mouse(dx, dy), {"type": "pointerUp", "button": 0}]);
        let pointer =
            json!({"type": "pointer", "id": "mouse", "parameters": {"pointerType": "mouse"}, "actions": actions});
        self.post("/actions", &json!({"actions": [pointer]}));
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = ureq::delete(&self.session).call();
        let _ = self.driver.kill();
        let _ = self.driver.wait();
    }
}

/// Share of the picture's pixels that are not black.
const LIT: &str = "(() => { const c = document.querySelector('#picture'); \
    const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; let n = 0; \
    for (let i = 0; i < d.length; i += 4) n += d[i] + d[i + 1] + d[i + 2] > 30; return 4 * n / d.length })()";

/// `lamina live` with `arguments`, and a browser that looks at it.
fn watched(arguments: &[&str]) -> (Daemon, Browser, tempfile::TempDir) {
    let port = free_port();
    let viewer = format!("127.0.0.1:{port}");
    let lamina = Daemon::start_plain("lamina", port, &[&["live", "--viewer", &viewer], arguments].concat());
    let profile = tempfile::tempdir().unwrap();
    let browser = Browser::open(&profile.path().display().to_string());
    browser.post("/url", &json!({"url": format!("{}/", lamina.url())}));
    (lamina, browser, profile)
}

/// Nothing went wrong on the page, and its server stops when told to.
fn end(browser: &Browser, lamina: Daemon) {
    let log = browser.post("/se/log", &json!({"type": "browser"}));
    let errors: Vec<_> = log.as_array().unwrap().iter().filter(|e| e["level"] == "SEVERE").collect();
    assert!(errors.is_empty(), "{errors:?}");
    assert_eq!(lamina.terminate(), Some(0));
}

/// A number for all of the picture, most likely another for another picture.
const PICTURE: &str = "(() => { const c = document.querySelector('#picture'); \
    return c.getContext('2d').getImageData(0, 0, c.width, c.height).data.reduce((h, x) => (31 * h + x) | 0, 7) })()";
/// The chosen step is drawn, not as a draft.
const DRAWN: &str = "(() => { const c = document.querySelector('#picture').dataset; return Number(c.size) > 256 && \
    c.step === document.querySelector('#timeline').ariaValueNow && !document.querySelector('#stage').ariaBusy })()";

#[test]
fn a_volume_is_drawn_in_the_colours_chosen_on_the_page() {
    let arguments = ["--cells", "24", "--steps", "60", "--representation", "volume"];
    let (lamina, browser, _profile) = watched(&arguments);
    browser.wait_js("document.querySelector('#picture').dataset.step !== undefined");
    browser.js("document.querySelector('#colours summary').click()");
    browser.js("document.querySelector('#timeline').focus()");
    browser.key("End");
    browser
        .wait_js("document.querySelectorAll('#curve .corner').length > 1 && document.querySelector('#fixed').hidden");
    browser.wait_js(DRAWN);
    let recorded = browser.js(PICTURE);

    // The last point becomes transparent: dragged to the bottom.
    browser.drag("#curve .corner:last-of-type", 0, 90);
    browser.wait_js(&format!("{DRAWN} && {PICTURE} !== {recorded}"));
    browser.wait_js("document.querySelector('#corner').textContent.endsWith('opacity 0')");
    // Back, to the last pixel.
    browser.js("document.querySelector('#recorded-colours').click()");
    browser.wait_js(&format!("{DRAWN} && {PICTURE} === {recorded}"));
    end(&browser, lamina);
}

#[test]
fn the_page_shows_the_newest_step_and_the_mouse_turns_it() {
    let (lamina, browser, _profile) = watched(&["--cells", "48", "--representation", "vdi"]);
    browser.wait_js("document.querySelector('#picture').dataset.step !== undefined");
    browser.wait_js("document.querySelector('#psnr').textContent.includes('dB')");
    assert!(browser.js(LIT).as_f64().unwrap() > 0.02, "the blast is seen");
    let first = browser.js("Number(document.querySelector('#picture').dataset.step)").as_f64().unwrap();
    browser.wait_js(&format!("Number(document.querySelector('#picture').dataset.step) > {first}"));

    assert_eq!(browser.js("Number(document.querySelector('#picture').dataset.azimuth)"), json!(0));
    browser.drag("#picture", 150, 40);
    browser.wait_js("Math.abs(Number(document.querySelector('#picture').dataset.azimuth)) > 5");
    assert!(browser.js(LIT).as_f64().unwrap() > 0.02, "the blast is seen from the side too");

    // The shown step's point among all steps' quality and time.
    browser.wait_js("document.querySelectorAll('#accuracy circle.here').length === 1");
    let points = "document.querySelector('#accuracy path.dot').getAttribute('d').split('M').length - 1";
    assert!(browser.js(points).as_u64() > Some(0), "steps are marked");

    // A step chosen on the time line stays.
    browser.drag("#timeline", 0, 0);
    let newest = "fetch('api/state').then(r => r.json()).then(s => s.steps[s.steps.length - 1].step)";
    // On a busy machine the chosen step's picture takes its time: by then newer steps have come.
    let clicked = browser.js(newest).as_u64().unwrap();
    browser.wait_js(&format!("{newest}.then(n => n > {clicked} + 2)"));
    browser.wait_js(&format!("Number(document.querySelector('#picture').dataset.step) < {clicked}"));
    let chosen = browser.js("document.querySelector('#picture').dataset.step");
    let before = browser.js(newest).as_u64().unwrap();
    browser.wait_js(&format!("{newest}.then(n => n > {before})"));
    assert_eq!(browser.js("document.querySelector('#picture').dataset.step"), chosen);
    assert!(chosen.as_str().unwrap().parse::<u64>().unwrap() < before, "{chosen} is not the newest");

    // Steps are VDIs: their colours are their data.
    browser.js("document.querySelector('#colours summary').click()");
    browser.js("document.querySelector('#timeline').focus()");
    browser.key("Home");
    browser.wait_js("!document.querySelector('#fixed').hidden && document.querySelector('#editor').hidden");
    // What the tuner tried is marked beside the steps.
    browser.wait_js("document.querySelector('#accuracy path.trial').getAttribute('d').includes('M')");
    end(&browser, lamina);
}
