//! The browser draws: by its processor as the viz-node does, to the byte, and by WebGPU and WebGL2 within their stated bounds.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod tools;

use lamina_tests::browser::{Browser, end};
use lamina_tests::processes::{Daemon, binary, free_port, wait_for};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::RwLock;
use std::time::Duration;

/// Held for writing by the test that has the machine to itself: a GPU in software beside six browsers takes minutes a picture.
static ALONE: RwLock<()> = RwLock::new(());

/// GPUs in software, by the page's query; `WEBGPU_FLAGS` and `WEBGL_FLAGS` hold others for a real one.
const GPUS: [(&str, &str); 2] = [
    ("webgpu", "--enable-unsafe-webgpu --use-webgpu-adapter=swiftshader"),
    ("webgl", "--use-angle=swiftshader --enable-unsafe-swiftshader"),
];
/// Azimuth, elevation, zoom.
const VIEWS: [[f64; 3]; 6] =
    [[0.0, 0.0, 1.0], [20.0, 10.0, 1.0], [-35.0, 25.0, 1.4], [60.0, -20.0, 0.8], [150.0, 40.0, 1.0], [10.0, 5.0, 3.0]];

/// `lamina live` with `arguments`, and a browser that looks at its page with `query`.
fn watched(arguments: &[&str], flags: &[&str], query: &str) -> (Daemon, Browser, tempfile::TempDir) {
    let port = free_port();
    let viewer = format!("127.0.0.1:{port}");
    let live = ["live", "--viewer", &viewer, "--cells", "32", "--steps", "3", "--cpu-share", "100%"];
    let lamina = Daemon::start_plain("lamina", port, &[&live[..], arguments].concat());
    let profile = tempfile::tempdir().unwrap();
    let browser = Browser::open(&profile.path().display().to_string(), &[&["--window-size=900,420"], flags].concat());
    browser.post("/url", &json!({"url": format!("{}/{query}", lamina.url())}));
    browser.wait_js("document.querySelector('#picture').dataset.step !== undefined");
    // On a busy machine others may be dropped.
    browser.wait_js("document.querySelector('#timeline').ariaValueMax === '2'");
    (lamina, browser, profile)
}

/// Turns to a view by the page's address, and waits for its still picture.
fn look(browser: &Browser, [azimuth, elevation, zoom]: [f64; 3]) {
    browser.js(&format!("void (location.hash = '#step=2&azimuth={azimuth}&elevation={elevation}&zoom={zoom}')"));
    browser.wait_js(&format!(
        "(() => {{ const d = document.querySelector('#picture').dataset; return d.draft === 'false' && d.step === '2' && \
         Number(d.azimuth) === {azimuth} && Number(d.elevation) === {elevation} && Number(d.zoom) === {zoom} && \
         !document.querySelector('#stage').ariaBusy }})()"
    ));
}

/// The mean squared difference, of 255^2, between the page's picture and the viz-node's.
fn difference(browser: &Browser, [azimuth, elevation, zoom]: [f64; 3]) -> f64 {
    let answer = browser.promised(&format!(
        "(async () => {{ const bytes = (source, n) => {{ const c = document.createElement('canvas'); c.width = c.height = n; \
         const x = c.getContext('2d'); x.drawImage(source, 0, 0); return x.getImageData(0, 0, n, n).data }}; \
         const c = document.querySelector('#picture'), n = c.width; \
         const look = c.dataset.appearance && `&appearance=${{encodeURIComponent(c.dataset.appearance)}}`; \
         const r = await fetch(`api/image?step=2&azimuth={azimuth}&elevation={elevation}&zoom={zoom}&size=${{n}}${{look}}`); \
         const a = bytes(c, n), b = bytes(await createImageBitmap(await r.blob()), n); \
         let sum = 0; for (let i = 0; i < a.length; i++) sum += (a[i] - b[i]) ** 2; \
         return {{mean: sum / (3 * n * n) / 255 ** 2, lit: b.some((v, i) => i % 4 < 3 && v > 60)}} }})()"
    ));
    assert_eq!(answer["lit"], json!(true), "something is seen");
    answer["mean"].as_f64().unwrap()
}

/// Every effect that a reduced volume is drawn with, in parts: one kernel with all takes a GPU in software minutes to compile.
const EFFECTS: [&str; 4] = [
    "light = [0.5, 1.0, 1.0]
shading = { ambient = 0.4, diffuse = 0.6, specular = 0.2, shininess = 32 }
depth_cue = { color = [0.0, 0.0, 0.2], strength = 0.5 }",
    "pre_integrated = true",
    "light = [0.5, 1.0, 1.0]
shadows = 0.7
ambient_occlusion = 0.7
clip_planes = [{ normal = [1.0, 0.0, 0.0], offset = 0.3 }]",
    "isosurfaces = [{ value = 3.0, color = [0.9, 0.8, 0.7], opacity = 0.5 }]",
];

/// A scene file with `effects` in `folder`.
fn scene(folder: &tempfile::TempDir, effects: &str) -> String {
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, format!("[effects]\n{effects}\n")).unwrap();
    path.display().to_string()
}

#[test]
fn the_browsers_processor_draws_the_viz_nodes_picture_to_the_byte() {
    let _turn = ALONE.read();
    let folder = tempfile::tempdir().unwrap();
    // All together.
    let [shading, integration, shadows, surfaces] = EFFECTS;
    let shadows = shadows.trim_start_matches("light = [0.5, 1.0, 1.0]");
    let scene = scene(&folder, &[shading, integration, shadows, surfaces].join("\n"));
    for arguments in [&["--representation", "vdi"][..], &["--representation", "volume", "--scene", &scene]] {
        let (lamina, browser, _profile) = watched(arguments, &["--disable-gpu"], "");
        for view in VIEWS {
            look(&browser, view);
            assert_eq!(difference(&browser, view), 0.0, "{arguments:?}, {view:?}");
        }
        assert_eq!(browser.js("document.querySelector('#picture').dataset.drawnBy"), json!("cpu"));
        end(&browser, lamina);
    }
}

#[test]
fn a_vdi_of_many_supersegments_is_decoded_by_several_workers() {
    let _turn = ALONE.read();
    let large = ["--representation", "vdi", "--resolution", "768", "--gamma", "0.001"];
    let (lamina, browser, _profile) = watched(&large, &["--disable-gpu"], "");
    look(&browser, VIEWS[0]);
    let workers = browser.js("Number(document.querySelector('#picture').dataset.decoders)");
    let available = browser.js("navigator.hardwareConcurrency");
    assert!(workers.as_u64() > Some(1) || available == json!(1), "{workers} of {available}");
    // The page answers meanwhile: no task of its own takes a good part of the time that decoding does.
    let longest = "new Promise(told => { const longest = list => Math.max(0, ...list.map(task => task.duration)); \
        new PerformanceObserver(list => told(longest(list.getEntries()))).observe({type: 'longtask', buffered: true}); \
        setTimeout(() => told(0), 1000) })";
    let blocked = browser.promised(longest).as_f64().unwrap();
    let decoding = browser.js("Number(document.querySelector('#picture').dataset.decodeMs)").as_f64().unwrap();
    eprintln!("decoded in {decoding:.0} ms, the page's longest task {blocked:.0} ms");
    assert!(blocked < decoding / 2.0, "{blocked} ms, decoding {decoding} ms");
    assert_eq!(difference(&browser, VIEWS[0]), 0.0);
    end(&browser, lamina);
}

fn holds_by_gpu((api, flags): (&str, &str), arguments: &[&str], views: &[[f64; 3]]) {
    let flags = std::env::var(format!("{}_FLAGS", api.to_uppercase())).unwrap_or_else(|_| flags.to_owned());
    let (lamina, browser, _profile) = watched(arguments, &flags.split(' ').collect::<Vec<_>>(), &format!("?{api}"));
    // The processor draws until the kernel is compiled: isosurfaces take SwiftShader half a minute. Chromium ignores changes of an
    // address that follow each other too fast.
    let by_gpu =
        "(location.hash = `#azimuth=${90 * Math.random()}`, document.querySelector('#picture').dataset.drawnBy)";
    let drawn_by_gpu = || {
        std::thread::sleep(Duration::from_millis(250));
        browser.js(by_gpu) == json!("gpu")
    };
    assert!(wait_for(Duration::from_secs(400), drawn_by_gpu), "{api}, {arguments:?}: no kernel");
    let device = browser.js("document.querySelector('#rendered').title");
    assert!(device.as_str().unwrap().to_lowercase().starts_with(api), "{device}");
    for &view in views {
        look(&browser, view);
        let decibels = -10.0 * difference(&browser, view).log10();
        eprintln!("{decibels:.1} dB: {}", browser.js("document.querySelector('#rendered').textContent"));
        assert!(decibels >= 50.0, "{api}, {arguments:?}, {view:?}: {decibels} dB");
        assert_eq!(browser.js("document.querySelector('#picture').dataset.drawnBy"), json!("gpu"));
    }
    end(&browser, lamina);
}

#[test]
fn the_browsers_gpu_draws_the_viz_nodes_picture_within_fifty_decibels() {
    let _turn = ALONE.write();
    for gpu in GPUS {
        holds_by_gpu(gpu, &["--representation", "vdi", "--resolution", "96", "--gamma", "0.02"], &VIEWS);
        holds_by_gpu(gpu, &["--representation", "volume"], &VIEWS);
        // SwiftShader compiles the loop over isosurfaces for longer than ten minutes where it comes by WebGL2.
        let in_software = gpu.0 == "webgl" && std::env::var_os("WEBGL_FLAGS").is_none();
        for effects in &EFFECTS[..EFFECTS.len() - usize::from(in_software)] {
            let folder = tempfile::tempdir().unwrap();
            holds_by_gpu(gpu, &["--representation", "volume", "--scene", &scene(&folder, effects)], &VIEWS[1..3]);
        }
    }
}

#[test]
fn a_step_that_has_arrived_is_turned_without_the_server() {
    let _turn = ALONE.read();
    let (lamina, browser, _profile) = watched(&["--representation", "vdi"], &["--disable-gpu"], "");
    look(&browser, VIEWS[1]);
    browser.js("performance.clearResourceTimings()");
    browser.drag_on("#picture", 2);
    browser.mouse(&[json!({"type": "pointerUp", "button": 0})]);
    let asked = "performance.getEntriesByType('resource').map(e => e.name).filter(n => /image|api.step/.test(n))";
    assert_eq!(browser.js(asked), json!([]));
    // Nor does it need one that answers.
    end(&browser, lamina);
    browser.wait_js("document.querySelector('#state').dataset.state === 'reconnecting'");
    look(&browser, VIEWS[2]);
    assert_eq!(browser.js("document.querySelector('#notice').hidden"), json!(false));
}

/// The file called `name` in `folder` or below.
fn recorded(folder: &Path, name: &str) -> Option<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries
        .into_iter()
        .find_map(|path| if path.is_dir() { recorded(&path, name) } else { path.ends_with(name).then_some(path) })
}

#[test]
fn a_damaged_step_is_said_to_be_and_the_others_are_drawn() {
    let _turn = ALONE.read();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().display().to_string();
    let (lamina, browser, _profile) = watched(&["--out", &out, "--representation", "vdi"], &["--disable-gpu"], "");
    let path = recorded(folder.path(), "step_000000.vdi").unwrap();
    let whole = std::fs::read(&path).unwrap();
    let hostile = [("checksum", whole[..whole.len() / 2].to_vec()), ("begins neither", vec![0; 64])];
    for (reason, bytes) in hostile {
        std::fs::write(&path, bytes).unwrap();
        browser.post("/refresh", &json!({}));
        browser.wait_js("document.querySelector('#timeline').ariaValueMax === '2'");
        browser.js("void (location.hash = '#step=0')");
        browser.wait_js(&format!(
            "document.querySelector('#notice').textContent.startsWith('No picture of step 0') && \
             document.querySelector('#notice').textContent.includes('{reason}')"
        ));
        look(&browser, VIEWS[1]);
        browser.wait_js("document.querySelector('#notice').hidden");
    }
    end(&browser, lamina);
}

#[test]
fn the_page_moves_by_hand_and_key_and_says_so_in_its_address() {
    let _turn = ALONE.read();
    let (lamina, browser, _profile) = watched(&["--representation", "volume"], &["--disable-gpu"], "");
    look(&browser, VIEWS[0]);
    // Shift pans, alt rolls, the address follows, and back goes to where it says.
    let drag = |modifier: &str| {
        browser.post(
            "/actions",
            &json!({"actions": [
            {"type": "key", "id": "keys", "actions": [{"type": "keyDown", "value": modifier}]}]}),
        );
        browser.drag("#picture", 60, 30);
        browser.post(
            "/actions",
            &json!({"actions": [
            {"type": "key", "id": "keys", "actions": [{"type": "keyUp", "value": modifier}]}]}),
        );
    };
    drag("\u{e008}");
    browser.wait_js("/right=-0\\.\\d+&up=0\\.\\d+/.test(location.hash) && !/azimuth/.test(location.hash)");
    drag("\u{e00a}");
    browser.wait_js("/roll=\\d+/.test(location.hash)");
    let shared = browser.js("location.href");
    browser.js("document.querySelector('#reset').click()");
    browser.wait_js("!/right|roll/.test(location.hash)");
    browser.post("/url", &json!({"url": "about:blank"}));
    browser.post("/url", &json!({"url": shared}));
    browser.wait_js(
        "document.querySelector('#picture').dataset.roll > 0 && document.querySelector('#picture').dataset.right < 0",
    );
    end(&browser, lamina);
}

#[test]
fn every_button_does_what_it_says() {
    let _turn = ALONE.read();
    let (lamina, browser, _profile) = watched(&["--representation", "volume"], &["--disable-gpu"], "");
    let click = |id: &str| browser.js(&format!("document.querySelector('#{id}').click()"));
    look(&browser, VIEWS[0]);
    // The box: twelve edges; its axes' labels, and the scale's; seen from the front, at the recorded camera, it is upright and in the middle.
    click("box");
    browser.wait_js("document.querySelectorAll('#overlay .edge').length === 12 && document.querySelectorAll('#overlay text').length === 4");
    let middle = "[...document.querySelectorAll('#overlay .edge')].flatMap(e => e.getAttribute('d').match(/-?[\\d.]+/g).map(Number)) \
        .reduce((sum, c, n) => (sum[n % 2] += c / 24, sum), [0, 0])";
    let before = browser.js(middle);
    // Half a picture's height to the right is a whole half of its side, at the depth of the target.
    browser.js("void (location.hash = '#step=2&right=0.25')");
    browser.wait_js("document.querySelector('#picture').dataset.right === '0.25'");
    // The box is drawn with the next frame.
    browser.wait_js(&format!("{middle}[0] !== {}", before[0]));
    let shift = browser.js(middle)[0].as_f64().unwrap() - before[0].as_f64().unwrap();
    assert!((shift + 0.5).abs() < 0.05, "{shift}: near and far corners shift by more and less");
    browser.js("document.activeElement.blur()");
    browser.key("b");
    browser.wait_js("document.querySelectorAll('#overlay .edge').length === 0");

    // Colors: a map changes the picture, as recorded brings it back.
    look(&browser, VIEWS[0]);
    browser.js("document.querySelector('#colors summary').click()");
    browser.wait_js("document.querySelectorAll('#curve .bar').length === 64");
    let picture = "(() => { const c = document.querySelector('#picture'); const d = c.dataset; return d.draft === 'false' && \
        !document.querySelector('#stage').ariaBusy && c.toDataURL() })()";
    browser.wait_js(&format!("{picture} !== false"));
    let recorded = browser.js(picture);
    browser.js("(p => (p.value = 'gray', p.dispatchEvent(new Event('change'))))(document.querySelector('#preset'))");
    browser.wait_js(&format!("{picture} !== false && {picture} !== {recorded}"));
    let gray = "(() => { const c = document.querySelector('#picture'); const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data; \
        for (let i = 0; i < d.length; i += 4) if (Math.abs(d[i] - d[i + 1]) + Math.abs(d[i] - d[i + 2]) > 2) return false; return true })()";
    browser.wait_js(gray);
    click("recorded-colors");
    browser.wait_js(&format!("{picture} === {recorded}"));

    // Playing goes from the first step to the last and stops there; in a loop it goes on.
    browser.js("void (location.hash = '#step=0')");
    browser.wait_js("document.querySelector('#timeline').ariaValueNow === '0'");
    click("speed");
    assert_eq!(browser.js("document.querySelector('#speed').textContent"), json!("5/s"));
    click("play");
    browser.wait_js("document.querySelector('#timeline').ariaValueNow === '2'");
    browser.wait_js("document.querySelector('#play').ariaPressed === 'false'");
    click("loop");
    click("play");
    browser.wait_js("document.querySelector('#timeline').ariaValueNow === '0'");
    browser.wait_js("document.querySelector('#timeline').ariaValueNow === '2'");
    click("play");

    // The sheet of keys opens and closes by key; the picture is a file.
    browser.js("document.activeElement.blur()");
    browser.key("?");
    browser.wait_js("document.querySelector('#help-sheet').open");
    browser.key("\u{e00c}");
    browser.wait_js("!document.querySelector('#help-sheet').open");
    browser.js("(window.saved = null, document.addEventListener('click', e => { \
        if (e.target.download) { saved = e.target.download; e.preventDefault() } }), \
        HTMLAnchorElement.prototype.click = function () { saved = this.download })");
    click("save");
    browser.wait_js("saved === 'blast_step_2.png'");
    end(&browser, lamina);
}

/// Turns the report's picture, which `drawn_by` should draw.
fn is_turned(browser: &Browser, drawn_by: &str) {
    let still = format!(
        "(() => {{ const d = document.querySelector('#turntable').dataset; \
         return d.still === 'true' && d.drawnBy === '{drawn_by}' }})()"
    );
    browser.wait_js(&still);
    let lit = "(() => { const c = document.querySelector('#turntable'); const d = c.getContext('2d').getImageData(0, 0, c.width, \
            c.height).data; return d.some((v, i) => i % 4 < 3 && v > 60) && [c.width, c.toDataURL()] })()";
    let front = browser.js(lit);
    assert!(front[0].as_u64() > Some(256), "something is seen, and large");
    browser.drag("#turntable", 120, 40);
    browser.wait_js(&format!("{still} && document.querySelector('#turntable').dataset.azimuth < -10"));
    assert_ne!(browser.js(lit)[1], front[1], "it has turned");
    let log = browser.post("/se/log", &json!({"type": "browser"}));
    let errors: Vec<_> = log.as_array().unwrap().iter().filter(|e| e["level"] == "SEVERE").collect();
    assert!(errors.is_empty(), "{errors:?}");
}

#[test]
fn the_last_step_is_turned_in_the_report_without_a_server() {
    let _turn = ALONE.read();
    for representation in ["vdi", "volume"] {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().display().to_string();
        let live =
            ["live", "--headless", "--cells", "32", "--steps", "2", "--representation", representation, "--out", &out];
        let done = Command::new(binary("lamina")).args(live).env("RUST_LOG", "error").output().unwrap();
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        for (query, flags, drawn_by) in [("", "--disable-gpu", "cpu"), ("?webgl", GPUS[1].1, "gpu")] {
            let profile = tempfile::tempdir().unwrap();
            let flags: Vec<&str> = flags.split(' ').collect();
            let browser = Browser::open(&profile.path().display().to_string(), &flags);
            browser.post("/url", &json!({"url": format!("file://{out}/report.html{query}")}));
            is_turned(&browser, drawn_by);
        }
    }
}
