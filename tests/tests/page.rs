//! The viewer in a real browser: `lamina` live, headless Chromium driven through ChromeDriver (WebDriver over HTTP).

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

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

    /// What the mouse does.
    fn mouse(&self, actions: &[Value]) {
        let pointer =
            json!({"type": "pointer", "id": "mouse", "parameters": {"pointerType": "mouse"}, "actions": actions});
        self.post("/actions", &json!({"actions": [pointer]}));
    }

    /// The middle of `selector` on the page, not in the element: it may be drawn anew while the mouse is on its way.
    fn middle(&self, selector: &str) -> [i32; 2] {
        let middle = self.js(&format!(
            "(() => {{ const e = document.querySelector('{selector}'); e.scrollIntoView({{block: 'nearest'}}); \
             const b = e.getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2].map(Math.round) }})()"
        ));
        [0, 1].map(|i| middle[i].as_i64().unwrap() as i32)
    }

    /// Presses the mouse in the middle of `selector`, moves by (`dx`, `dy`), releases.
    fn drag(&self, selector: &str, dx: i32, dy: i32) {
        let [x, y] = self.middle(selector);
        let moves = [move_to(x + dx / 2, y + dy / 2, 50), move_to(x + dx, y + dy, 50)];
        let [down, up] = ["pointerDown", "pointerUp"].map(|kind| json!({"type": kind, "button": 0}));
        self.mouse(&[&[move_to(x, y, 50), down][..], &moves, &[up]].concat());
    }

    /// Presses the mouse in the middle of `selector` and moves to and fro for about `seconds`, with an event every 16 ms.
    fn drag_on(&self, selector: &str, seconds: u32) {
        let [x, y] = self.middle(selector);
        self.mouse(&[move_to(x, y, 0), json!({"type": "pointerDown", "button": 0})]);
        for second in 0..seconds {
            let side = if second % 2 == 0 { 3 } else { -3 };
            let moves: Vec<Value> = (-30..30).map(|i| move_to(x + side * i, y + i, 16)).collect();
            self.mouse(&moves);
        }
    }
}

fn move_to(x: i32, y: i32, duration_ms: u32) -> Value {
    json!({"type": "pointerMove", "duration": duration_ms, "origin": "viewport", "x": x, "y": y})
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
const DRAWN: &str = "(() => { const c = document.querySelector('#picture').dataset; return c.draft === 'false' && \
    c.step === document.querySelector('#timeline').ariaValueNow && !document.querySelector('#stage').ariaBusy })()";

#[test]
fn a_volume_is_drawn_in_the_colors_chosen_on_the_page() {
    let arguments = ["--cells", "24", "--steps", "60", "--representation", "volume"];
    let (lamina, browser, _profile) = watched(&arguments);
    browser.wait_js("document.querySelector('#picture').dataset.step !== undefined");
    browser.js("document.querySelector('#colors summary').click()");
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
    browser.js("document.querySelector('#recorded-colors').click()");
    browser.wait_js(&format!("{DRAWN} && {PICTURE} === {recorded}"));
    end(&browser, lamina);
}

#[test]
fn the_page_shows_the_newest_step_and_the_mouse_turns_it() {
    let (lamina, browser, _profile) =
        watched(&["--cells", "32", "--representation", "vdi", "--pace", "1", "--cpu-share", "100%"]);
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

    // Steps are VDIs: their colors are their data.
    browser.js("document.querySelector('#colors summary').click()");
    browser.js("document.querySelector('#timeline').focus()");
    browser.key("Home");
    browser.wait_js("!document.querySelector('#fixed').hidden && document.querySelector('#editor').hidden");
    // What the tuner tried is marked beside the steps.
    browser.wait_js("document.querySelector('#accuracy path.trial').getAttribute('d').includes('M')");
    end(&browser, lamina);
}

#[test]
fn drafts_keep_coming_while_the_camera_turns_and_a_study_runs() {
    let (lamina, browser, _profile) = watched(&[]);
    browser.wait_js("document.querySelector('#picture').dataset.step !== undefined");
    browser.js(
        "(window.drafts = [], new MutationObserver(() => { const c = document.querySelector('#picture').dataset; \
         if (c.draft === 'true') drafts.push(Number(c.size)) }).observe(document.querySelector('#picture'), \
         {attributes: true, attributeFilter: ['data-azimuth']}))",
    );
    browser.wait_js("document.querySelector('#study').textContent.startsWith('tuning: trial ')");
    browser.drag_on("#picture", 4);
    // Counted, not timed: the machine may be busy.
    let drafts = browser.js("drafts").as_array().unwrap().iter().map(|d| d.as_u64().unwrap()).collect::<Vec<_>>();
    assert!(drafts.len() >= 12, "{drafts:?}");
    assert!(drafts.iter().all(|side| (96..=512).contains(side) && side % 32 == 0), "{drafts:?}");
    assert_eq!(browser.js("document.querySelector('#notice').hidden"), json!(true));
    // The hand still holds the picture; released, it is drawn well.
    assert_eq!(browser.js("document.querySelector('#picture').dataset.draft"), json!("true"));
    browser.mouse(&[json!({"type": "pointerUp", "button": 0})]);
    browser.wait_js(DRAWN);
    // The study may have ended meanwhile.
    browser.wait_js("/provisional|tuned/.test(document.querySelector('#readout').innerText)");
    end(&browser, lamina);
}

/// A controller that saw `count` drafts, each of which took `c` ms a pixel and `overhead` ms.
fn draft_side(browser: &Browser, c: f64, overhead: f64, count: u32) -> Value {
    browser.js(&format!(
        "fetch('draft_size.js').then(r => r.text()).then(text => {{ const d = new (new Function(text + '; return DraftSize')())(); \
         let changes = 0; for (let i = 0; i < {count}; i++) {{ const side = d.side; \
         d.record(side, ({overhead} + {c} * side ** 2) * (i % 2 ? 1.15 : 1 / 1.15)); \
         if (i >= {count} / 2) changes += d.side !== side; }} return {{side: d.side, changes}} }})"
    ))
}

#[test]
fn the_side_of_a_draft_settles_where_it_takes_the_target() {
    let (lamina, browser, _profile) = watched(&["--cells", "24", "--steps", "2"]);
    // At c ms a pixel, 33 ms are taken by a side of sqrt(33 / c), within the hysteresis of 24 pixels.
    for c in [2e-4, 4e-4, 8e-4, 1.6e-3, 3e-3] {
        let settled = draft_side(&browser, c, 0.0, 200);
        let side = settled["side"].as_f64().unwrap();
        assert!((side - (33.0 / c).sqrt()).abs() <= 26.0 && side % 32.0 == 0.0, "{c}: {settled}");
        assert_eq!(settled["changes"], json!(0), "{c}: the size flickers");
    }
    // A constant time leaves less for the pixels; bounds hold.
    let side = draft_side(&browser, 4e-4, 13.0, 200)["side"].as_f64().unwrap();
    assert!((side - (20.0_f64 / 4e-4).sqrt()).abs() <= 34.0, "{side}");
    assert_eq!(draft_side(&browser, 1e-6, 0.0, 200)["side"], json!(512));
    assert_eq!(draft_side(&browser, 1.0, 0.0, 200)["side"], json!(96));
    // Drafts that take too long are left within five.
    let side = draft_side(&browser, 4e-3, 0.0, 5)["side"].as_f64().unwrap();
    assert!(4e-3 * side * side < 80.0, "{side}");
    end(&browser, lamina);
}
