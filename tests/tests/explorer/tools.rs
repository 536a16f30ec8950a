//! What a person does beside turning: light, surfaces and a clip box of their own, two steps side by side, a video; and what the page
//! is without a mouse and without sight.

use super::{ALONE, VIEWS, difference, look, watched};
use lamina_tests::browser::{Browser, end};
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;

/// A number for all of the picture, once it is a still; most likely another for another picture.
const STILL: &str = "(() => { const c = document.querySelector('#picture'); const d = c.dataset; \
    return d.draft === 'false' && !document.querySelector('#stage').ariaBusy && \
    c.getContext('2d').getImageData(0, 0, c.width, c.height).data.reduce((h, x) => (31 * h + x) | 0, 7) })()";

fn set(browser: &Browser, id: &str, value: &str) {
    browser.js(&format!(
        "(e => {{ if (e.type === 'checkbox') e.checked = {value}; else e.value = {value}; \
         e.dispatchEvent(new Event('input', {{bubbles: true}})) }})(document.querySelector('{id}'))"
    ));
}

/// Waits for a still picture that is not `before`; its number.
fn changed(browser: &Browser, before: &Value) -> Value {
    browser.wait_js(&format!("![false, {before}].includes({STILL})"));
    browser.js(STILL)
}

#[test]
fn light_surfaces_and_a_clip_box_are_chosen_on_the_page() {
    let _turn = ALONE.read();
    let (lamina, browser, _profile) = watched(&["--representation", "volume"], &["--disable-gpu"], "");
    look(&browser, VIEWS[1]);
    browser.js("document.querySelector('#effects summary').click()");
    browser.wait_js("!document.querySelector('#add-surface').disabled");
    browser.wait_js(&format!("{STILL} !== false"));
    let recorded = browser.js(STILL);
    let mut last = recorded.clone();
    // One after the other, each seen, and drawn as the viz-node draws it.
    for (id, value) in [
        ("#shading", "true"),
        ("#light-azimuth", "60"),
        ("#shadows", "0.6"),
        ("#occlusion", "0.5"),
        ("#clip-x-to", "0.7"),
        ("#clip-y-from", "0.4"),
    ] {
        set(&browser, id, value);
        last = changed(&browser, &last);
    }
    browser.js("document.querySelector('#add-surface').click()");
    last = changed(&browser, &last);
    set(&browser, "#surfaces .opacity", "0.4");
    last = changed(&browser, &last);
    browser.wait_js("Number(document.querySelector('#surfaces output').textContent) > 0");
    assert_eq!(difference(&browser, VIEWS[1]), 0.0);

    // A handle of the box follows the hand along its axis, and the slider with it; ends do not cross.
    let share = "Number(document.querySelector('#clip-x-to').value)";
    browser.wait_js("document.querySelectorAll('#overlay .clip').length === 6");
    browser.drag("#overlay .clip[data-side=\"1\"]", 40, 0);
    browser.wait_js(&format!("{share} > 0.72"));
    last = changed(&browser, &last);
    set(&browser, "#clip-x-to", "0");
    assert!(browser.js(share).as_f64() > Some(0.0), "something is left");
    // The address follows once all is still, and the picture is of what it says.
    let stated = "new URLSearchParams(location.hash.slice(1)).get('look')";
    let settled = format!("{stated} === document.querySelector('#picture').dataset.appearance && {STILL} !== false");
    browser.wait_js(&format!("JSON.parse({stated}).effects.clip_box.max[0] < 0 && {settled}"));
    let (link, chosen) = (browser.js("location.hash"), browser.js(STILL));
    let recorded_again = format!("{STILL} === {recorded} && document.querySelector('#recorded-effects').disabled");
    browser.js("document.querySelector('#recorded-effects').click()");
    browser.wait_js(&format!("{recorded_again} && !/look=/.test(location.hash)"));
    assert!(last != recorded && chosen != recorded);

    // Taken back, done again, and by the link, also where the page is opened with it.
    browser.js("document.querySelector('#undo-effects').click()");
    browser.wait_js(&format!("{STILL} === {chosen} && document.querySelector('#shading').checked"));
    browser.js("document.querySelector('#redo-effects').click()");
    browser.wait_js(&recorded_again);
    browser.js(&format!("void (location.hash = {link})"));
    browser.wait_js(&format!("{STILL} === {chosen} && document.querySelectorAll('#surfaces > *').length === 1"));
    browser.js("location.reload()");
    browser.wait_js(&format!("location.hash === {link} && {STILL} === {chosen}"));
    // What is no appearance is left out, and what the engine refuses is said; neither is the end.
    browser.js("void (location.hash = '#step=2&look={\"points\":[{\"at\":9}]}')");
    browser.wait_js("document.querySelector('#picture').dataset.appearance === ''");
    browser.js("void (location.hash = '#step=2&look={\"effects\":{\"shadows\":7}}')");
    browser.wait_js("/shadows/.test(document.querySelector('#stage').textContent)");
    browser.js(&format!("void (location.hash = {link})"));
    browser.wait_js(&format!("{STILL} === {chosen}"));
    end(&browser, lamina);
}

#[test]
fn two_steps_are_seen_side_by_side_and_their_difference() {
    let _turn = ALONE.read();
    let (lamina, browser, _profile) = watched(&["--representation", "volume"], &["--disable-gpu"], "");
    look(&browser, VIEWS[1]);
    let text = "document.querySelector('#compared').textContent";
    browser.js("document.querySelector('#compare').click()");
    browser.wait_js(&format!("{text} === 'step 2: equal'"));
    browser.js("document.querySelector('#previous').click()");
    browser.wait_js(&format!("/^step 2: [0-9.]+ dB apart$/.test({text}) && {STILL} !== false"));
    // By the definition, from what is on the page.
    let apart = "(() => { const of = id => { const c = document.querySelector(id); \
        return c.getContext('2d').getImageData(0, 0, c.width, c.height).data }; \
        const [a, b] = [of('#picture'), of('#beside')]; let sum = 0; \
        for (let n = 0; n < a.length; n++) sum += (a[n] - b[n]) ** 2; \
        return -10 * Math.log10(sum / (0.75 * a.length) / 255 ** 2) })()";
    let decibels = browser.js(apart).as_f64().unwrap();
    browser.wait_js(&format!("{text} === 'step 2: {decibels:.1} dB apart'"));
    browser.key("c");
    browser.wait_js(&format!("{text}.startsWith('difference from step 2') && {text}.includes('{decibels:.1} dB')"));
    browser.key("c");
    browser.wait_js("document.querySelector('#beside').hidden");
    end(&browser, lamina);
}

#[test]
fn a_run_is_seen_beside_an_earlier_one_at_the_same_time() {
    let _turn = ALONE.read();
    let folder = tempfile::tempdir().unwrap();
    let open = |name: &str, bound: &str| {
        let out = folder.path().join(name).display().to_string();
        let arguments = ["--representation", "volume", "--resolution", "32", "--gamma", bound, "--out", &out];
        watched(&arguments, &["--disable-gpu"], "")
    };
    let run = "fetch('api/state').then(r => r.json()).then(s => s.run.id)";
    let (lamina, browser, _profile) = open("first", "0.001");
    browser.wait_js(&format!("{STILL} !== false && document.querySelector('#runs').hidden"));
    let earlier = browser.promised(run);
    end(&browser, lamina);

    let (lamina, browser, _profile) = open("second", "0.1");
    // As a viz-node that goes on from run to run records them.
    let id = earlier.as_str().unwrap();
    std::fs::rename(folder.path().join("first/vdi").join(id), folder.path().join("second/vdi").join(id)).unwrap();
    browser.js("location.reload()");
    look(&browser, VIEWS[1]);
    browser.wait_js("!document.querySelector('#runs').hidden");
    let choose = || {
        browser.js(&format!(
            "(e => (e.value = {earlier}, e.dispatchEvent(new Event('change'))))(document.querySelector('#other-run'))"
        ))
    };
    choose();
    let text = "document.querySelector('#compared').textContent";
    browser.wait_js(&format!("/^blast, the other run, step 2, time [0-9.]+: [0-9.]+ dB apart$/.test({text})"));
    browser.js("document.querySelector('#previous').click()");
    browser.wait_js(&format!("{text}.includes('the other run, step 1,') && {STILL} !== false"));
    browser.key("c");
    browser.wait_js(&format!("{text}.startsWith('difference from blast, the other run')"));
    browser.key("c");
    browser.wait_js("document.querySelector('#beside').hidden && document.querySelector('#other-run').value === ''");
    choose();
    browser.wait_js(&format!("/^blast, the other run, step 1,/.test({text})"));
    end(&browser, lamina);
}

#[test]
fn who_flies_moves_and_looks_around() {
    let _turn = ALONE.read();
    let (lamina, browser, _profile) = watched(&["--representation", "volume"], &["--disable-gpu"], "");
    look(&browser, [20.0, 10.0, 1.0]);
    let pose = |name: &str| browser.js(&format!("Number(document.querySelector('#picture').dataset.{name})"));
    let still = |condition: &str| browser.wait_js(&format!("{STILL} !== false && {condition}"));
    let front = browser.js(STILL);
    browser.key("f");
    browser.wait_js("document.querySelector('#fly').ariaPressed === 'true'");
    browser.key("w");
    browser.key("w");
    still("Number(document.querySelector('#picture').dataset.ahead) === 0.1");
    let ahead = changed(&browser, &front);
    // Around once by the arrow keys: the same place, and the same picture.
    let turn = |keys: u32| {
        browser.js(&format!(
            "void [...Array({keys})].forEach(() => document.querySelector('#picture').dispatchEvent( \
             new KeyboardEvent('keydown', {{key: 'ArrowLeft', bubbles: true}})))"
        ))
    };
    turn(72);
    still("Number(document.querySelector('#picture').dataset.azimuth) === 20");
    assert_eq!([pose("ahead"), pose("right")], [json!(0.1), json!(0)]);
    assert_eq!(browser.js(STILL), ahead);
    // Half around, the volume lies behind.
    turn(36);
    still("Number(document.querySelector('#picture').dataset.azimuth) === -160");
    let colors = "(() => { const c = document.querySelector('#picture'); const d =         new Uint32Array(c.getContext('2d').getImageData(0, 0, c.width, c.height).data.buffer); return new Set(d).size })()";
    assert_eq!(browser.js(colors), json!(1), "nothing but background");
    // The address holds the place.
    browser.wait_js("/ahead=/.test(location.hash)");
    browser.js("document.querySelector('#reset').click()");
    still("Number(document.querySelector('#picture').dataset.ahead) === 0");
    browser.js("document.querySelector('#fly').click()");
    browser.wait_js("document.querySelector('#fly').ariaPressed === 'false'");
    end(&browser, lamina);
}

#[test]
fn a_video_of_a_turn_and_of_the_steps_is_a_file() {
    let _turn = ALONE.read();
    let (lamina, browser, _profile) = watched(&["--representation", "volume"], &["--disable-gpu"], "");
    look(&browser, VIEWS[1]);
    browser.js("(window.saved = [], HTMLAnchorElement.prototype.click = function () { \
        saved.push(this.download) }, \
        URL.createObjectURL = (made => blob => (window.blob = blob, made.call(URL, blob)))(URL.createObjectURL))");
    browser.js("document.querySelector('#video').click()");
    for (of, frames, name) in [("turn", 12, "blast_step_2_turn.webm"), ("steps", 3, "blast_steps.webm")] {
        set(&browser, "#video-of", &format!("'{of}'"));
        set(&browser, "#video-seconds", "0.5");
        set(&browser, "#video-side", "96");
        browser.js("document.querySelector('#video-make').click()");
        browser.wait_js(&format!(
            "document.querySelector('#video-message').textContent.startsWith('{frames} pictures of 96 x 96')"
        ));
        assert_eq!(browser.js("saved.at(-1)"), json!(name));
        // What Matroska files begin with.
        let head = browser.promised("blob.slice(0, 4).arrayBuffer().then(b => [...new Uint8Array(b)])");
        assert_eq!(head, json!([0x1a, 0x45, 0xdf, 0xa3]));
        assert!(browser.js("blob.size").as_u64() > Some(1000));
    }
    // The page goes on.
    browser.js("document.querySelector('#video-sheet').close()");
    look(&browser, VIEWS[2]);
    end(&browser, lamina);
}

/// Rules of WCAG by axe-core, in both color schemes, with every panel open.
#[test]
fn no_rule_of_accessibility_is_broken() {
    let _turn = ALONE.read();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("axe");
    let found = Command::new(script).output().unwrap();
    assert!(found.status.success(), "{}", String::from_utf8_lossy(&found.stderr));
    let axe = std::fs::read_to_string(String::from_utf8(found.stdout).unwrap().trim()).unwrap();
    let (lamina, browser, _profile) = watched(&["--representation", "volume"], &["--disable-gpu"], "");
    look(&browser, VIEWS[1]);
    browser.js("document.querySelectorAll('aside details').forEach(d => d.open = true)");
    browser.js("document.querySelector('#box').click()");
    browser.js("document.querySelector('#compare').click()");
    browser.wait_js("document.querySelectorAll('#overlay .clip').length === 6");
    browser.post("/execute/sync", &json!({"script": axe, "args": []}));
    for scheme in ["dark", "light"] {
        let media = json!({"features": [{"name": "prefers-color-scheme", "value": scheme}]});
        browser.post("/goog/cdp/execute", &json!({"cmd": "Emulation.setEmulatedMedia", "params": media}));
        for sheet in ["none", "help", "video"] {
            browser.js(&format!("document.querySelector('#{sheet}')?.click()"));
            let broken = browser.promised(
                "axe.run().then(r => r.violations.map(v => [v.id, v.nodes.map(n => n.html.slice(0, 120) + ' ' + n.failureSummary)]))",
            );
            assert_eq!(broken, json!([]), "{scheme}, {sheet}");
            browser.js("document.querySelector('dialog[open]')?.close()");
        }
    }
    end(&browser, lamina);
}
