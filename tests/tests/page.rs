//! The viewer in a real browser: `lamina` live, headless Chromium driven through ChromeDriver (WebDriver over HTTP).

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use lamina_tests::browser::{Browser, end, move_to};
use lamina_tests::processes::{Daemon, free_port};
use serde_json::{Value, json};

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
    let browser = Browser::open(&profile.path().display().to_string(), &["--disable-gpu"]);
    browser.post("/url", &json!({"url": format!("{}/", lamina.url())}));
    (lamina, browser, profile)
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

    // Values of a plane, and the one under the pointer.
    browser.js("document.querySelector('#slices summary').click()");
    let value = "document.querySelector('#slice-value').textContent";
    browser.wait_js(&format!("{value}.startsWith('z = ') && document.querySelector('#slice').width === 24"));
    browser.js("document.querySelector('#slice').scrollIntoView()");
    let [x, y] = browser.middle("#slice");
    browser.mouse(&[move_to(x, y, 0), move_to(x + 3, y, 50)]);
    browser.wait_js(&format!("/^(at (most|least) )?[0-9.e-]+ at x = .*, y = .*, z = /.test({value})"));
    browser.js("(() => { const a = document.querySelector('#slice-axis'); a.value = 'x'; \
         a.dispatchEvent(new Event('input')) })()");
    browser.wait_js(&format!("/ at x = 0, y = .*, z = /.test({value})"));
    browser.js("document.querySelector('#slices summary').click()");

    // The last point becomes transparent: dragged to the bottom.
    browser.drag("#curve .corner:last-of-type", 0, 90);
    browser.wait_js(&format!("{DRAWN} && {PICTURE} !== {recorded}"));
    browser.wait_js("document.querySelector('#corner').textContent.endsWith('opacity 0')");
    // The drag is taken back as one change, done again, and all of it left for what was recorded: to the last pixel.
    browser.js("document.querySelector('#undo-colors').click()");
    browser.wait_js(&format!("{DRAWN} && {PICTURE} === {recorded} && document.querySelector('#undo-colors').disabled"));
    browser.js("document.querySelector('#redo-colors').click()");
    browser.wait_js(&format!("{DRAWN} && {PICTURE} !== {recorded}"));
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

    // The shown step's point among all steps' quality and time. On a busy machine the newest steps wait to be measured: back to one
    // that was.
    browser.wait_js("document.querySelector('#accuracy path.dot').getAttribute('d') !== ''");
    browser.wait_js(
        "document.querySelectorAll('#accuracy circle.here').length === 1 || \
         (document.querySelector('#previous').click(), false)",
    );
    browser.js("document.querySelector('#live').click()");
    let points = "document.querySelector('#accuracy path.dot').getAttribute('d').split('M').length - 1";
    assert!(browser.js(points).as_u64() > Some(0), "steps are marked");

    // A step chosen on the time line stays.
    browser.drag("#timeline", 0, 0);
    let newest = "fetch('api/state').then(r => r.json()).then(s => s.steps[s.steps.length - 1].step)";
    browser.promised("new Promise(drawn => requestAnimationFrame(() => requestAnimationFrame(() => drawn(true))))");
    let chosen = browser.js("document.querySelector('#timeline').getAttribute('aria-valuenow')");
    // On a busy machine the chosen step's picture takes its time.
    browser.wait_js(&format!("document.querySelector('#picture').dataset.step === {chosen}"));
    let before = browser.js(newest).as_u64().unwrap();
    browser.wait_js(&format!("{newest}.then(n => n > {before} + 1)"));
    assert_eq!(browser.js("document.querySelector('#picture').dataset.step"), chosen);
    assert!(chosen.as_str().unwrap().parse::<u64>().unwrap() < before, "{chosen} is not the newest");

    // Steps are VDIs: their colors are their data, and others are to be asked for.
    browser.js("document.querySelector('#colors summary').click()");
    browser.js("document.querySelector('#timeline').focus()");
    browser.key("Home");
    browser.wait_js("!document.querySelector('#editor').hidden && !document.querySelector('#ask-colors').hidden");
    // What the tuner tried is marked beside the steps.
    browser.wait_js("document.querySelector('#accuracy path.trial').getAttribute('d').includes('M')");
    end(&browser, lamina);
}

#[test]
fn a_contract_asked_for_at_the_page_is_kept_from_then_on() {
    let (lamina, browser, _profile) = watched(&["--cells", "48", "--pace", "2", "--cpu-share", "100%"]);
    browser.wait_js("document.querySelector('#contract-in-force').textContent === 'size <= 300kB'");
    browser.wait_js("/provisional|tuned/.test(document.querySelector('#readout').innerText)");
    browser.js("document.querySelector('#contract').open = true");
    let type_into = |field: &str, text: &str| {
        browser.js(&format!(
            "(() => {{ const f = document.querySelector('#{field}'); f.value = '{text}'; \
             f.dispatchEvent(new Event('input', {{bubbles: true}})) }})()"
        ));
    };
    let message = "document.querySelector('#contract-message').textContent";
    // Nonsense is refused, with what helps, and what was in force stays.
    type_into("contract-line", "size <= 12 parsecs");
    browser.wait_js("!document.querySelector('#contract-ask').disabled");
    browser.js("document.querySelector('#contract-ask').click()");
    browser.wait_js(&format!("{message}.includes('write limits such as')"));
    assert_eq!(browser.js("document.querySelector('#contract-in-force').textContent"), json!("size <= 300kB"));
    browser.js("document.querySelector('#contract-undo').click()");
    // The browser notes the refusal, too.
    let log = browser.post("/se/log", &json!({"type": "browser"}));
    let severe: Vec<_> = log.as_array().unwrap().iter().filter(|entry| entry["level"] == "SEVERE").collect();
    assert!(severe.iter().all(|entry| entry["message"].as_str().unwrap().contains("/api/contract")), "{severe:?}");

    type_into("limit-size", "9");
    browser.wait_js("document.querySelector('#contract-line').value === 'size <= 9kB'");
    browser.wait_js("!document.querySelector('#contract-ask').disabled");
    browser.js("document.querySelector('#contract-ask').click()");
    browser.wait_js("document.querySelector('#contract-in-force').textContent === 'size <= 9kB'");
    let newest = "fetch('api/state').then(r => r.json()).then(s => s.steps[s.steps.length - 1])";
    browser.wait_js(&format!("{newest}.then(s => s.size_limit_bytes === 9000 && s.tuning === 'done')"));
    let row = browser.promised(newest);
    assert!(row["size_bytes"].as_u64().unwrap() <= 9000, "{row}");
    browser.wait_js("document.querySelector('#size figcaption').textContent.includes('limit 9 kB')");

    // A point of the front is asked for by its size.
    browser.wait_js("document.querySelector('#pareto .point') !== null");
    let bytes = browser.js("document.querySelector('#pareto .point:last-of-type').dataset.bytes");
    let bytes: f64 = bytes.as_str().unwrap().parse().unwrap();
    browser.js(
        "document.querySelector('#pareto .point:last-of-type').dispatchEvent(new MouseEvent('click', {bubbles: true}))",
    );
    let asked = (bytes / 100.0).round() / 10.0;
    browser.wait_js(&format!("document.querySelector('#contract-in-force').textContent === 'size <= {asked}kB'"));
    end(&browser, lamina);
}

#[test]
fn another_field_is_chosen_or_written_on_the_page_and_tuned_anew() {
    let (lamina, browser, _profile) = watched(&["--cells", "32", "--pace", "4", "--cpu-share", "100%"]);
    browser.wait_js("!document.querySelector('#fields').hidden");
    browser.js("document.querySelector('#fields').open = true");
    browser.wait_js("/tuned/.test(document.querySelector('#readout').innerText)");
    let readout = "document.querySelector('#readout').innerText";
    assert!(!browser.js(readout).as_str().unwrap().contains("computed"), "density is shown as it is");
    let choices = browser.js("[...document.querySelector('#field-choice').options].map(o => o.value).join('|')");
    for field in ["density", "momentum.z", "energy", "magnitude(curl(momentum))", "magnitude(gradient(energy))"] {
        assert!(choices.as_str().unwrap().split('|').any(|choice| choice == field), "{choices}");
    }
    browser.js("(() => { const f = document.querySelector('#field-choice'); f.value = 'magnitude(momentum)'; \
         f.dispatchEvent(new Event('change')) })()");
    let shows = |field: &str| {
        let title = format!("document.querySelector('#run').textContent.includes({})", json!(field));
        let computed = format!("{readout}.includes('computed in') && /tuned|provisional/.test({readout})");
        format!("{title} && {computed} && {DRAWN}")
    };
    browser.wait_js(&shows("magnitude(momentum)"));
    let write = |field: &str| {
        browser.js(&format!(
            "(() => {{ const f = document.querySelector('#field-line'); f.value = {}; \
             f.dispatchEvent(new Event('input', {{bubbles: true}})) }})()",
            json!(field)
        ));
        browser.wait_js("!document.querySelector('#field-ask').disabled");
        browser.js("document.querySelector('#field-ask').click()");
    };
    write("pressure");
    browser.wait_js("document.querySelector('#field-message').textContent.includes('no field \"pressure\"')");
    // The browser notes the refusal, too.
    let log = browser.post("/se/log", &json!({"type": "browser"}));
    let mut severe = log.as_array().unwrap().iter().filter(|entry| entry["level"] == "SEVERE");
    assert!(severe.all(|entry| entry["message"].as_str().unwrap().contains("/api/show")), "{log}");
    write("magnitude(curl(momentum / density))");
    browser.wait_js(&shows("magnitude(curl(momentum / density))"));
    end(&browser, lamina);
}

#[test]
fn vdis_come_from_where_the_reader_looks_in_the_colors_and_light_asked_for() {
    // So small that the nodes keep up and measure some of them.
    let arguments = ["--cells", "32", "--pace", "2", "--cpu-share", "100%", "--representation", "vdi"];
    let (lamina, browser, _profile) = watched(&[&arguments[..], &["--contract", "size <= 40kB"]].concat());
    let run = "document.querySelector('#run').textContent !== '' && fetch('api/state').then(r => r.json()).then(s => s.run.id)";
    let is_run = |n: u32| format!("{run}.then(id => id.endsWith('.{n}'))");
    browser.wait_js(DRAWN);
    assert_eq!(browser.js("document.querySelector('#generate-here').hidden"), json!(true), "it is seen from there");
    let turn = || {
        browser.js("document.querySelector('#picture').focus()");
        (0..10).for_each(|_| browser.key("ArrowRight"));
        browser.wait_js("document.querySelector('#camera').textContent.startsWith('50°, 0°')");
    };
    turn();
    browser.wait_js("!document.querySelector('#generate-here').hidden");
    // What was measured at the test views says how good the picture is from here.
    let trust = "document.querySelector('#trust figcaption').textContent";
    browser.wait_js(&format!("/PSNR from here [0-9.]+ dB/.test({trust}) && {trust}.includes('50° off')"));
    browser.js("document.querySelector('#generate-here').click()");
    // Seen from its front, the picture is where it was.
    browser.wait_js(&is_run(2));
    browser.wait_js(&format!("document.querySelector('#camera').textContent === '' && {DRAWN}"));
    browser.wait_js(&format!("{trust}.includes('dB0° off')"));
    // By itself, after a moment of rest.
    browser.js("document.querySelector('#fields').open = true");
    browser.js("document.querySelector('#follow-view').click()");
    turn();
    browser.wait_js(&is_run(3));
    browser.wait_js("document.querySelector('#camera').textContent === ''");

    browser.js("document.querySelector('#colors summary').click()");
    browser
        .wait_js("document.querySelectorAll('#curve .corner').length > 1 && !document.querySelector('#editor').hidden");
    assert_eq!(browser.js("document.querySelector('#ask-colors').disabled"), json!(true));
    browser.drag("#curve .corner:last-of-type", 0, 90);
    browser.wait_js("document.querySelector('#corner').textContent.endsWith('opacity 0')");
    browser.js("document.querySelector('#ask-colors').click()");
    browser.wait_js(&is_run(4));
    let transfer = "fetch('api/state').then(r => r.json()).then(s => s.steerable.transfer)";
    browser.wait_js(&format!("{transfer}.then(t => t.points[t.points.length - 1].opacity === 0)"));
    browser.wait_js(DRAWN);

    // Light and surfaces, which a VDI cannot be given afterwards.
    browser.js("document.querySelector('#effects').open = true");
    browser.wait_js("!document.querySelector('#add-surface').disabled");
    assert_eq!(browser.js("document.querySelector('#ask-effects').disabled"), json!(true));
    browser.js("document.querySelector('#add-surface').click()");
    browser.js("(() => { const s = document.querySelector('#occlusion'); s.value = '0.8'; \
         s.dispatchEvent(new Event('input', {bubbles: true})) })()");
    browser.js("document.querySelector('#ask-effects').click()");
    browser.wait_js(&is_run(5));
    let effects = "fetch('api/state').then(r => r.json()).then(s => s.steerable.effects)";
    browser.wait_js(&format!("{effects}.then(e => e.ambient_occlusion === 0.8 && e.isosurfaces.length === 1)"));
    // The panel shows what the steps are now generated with.
    browser.wait_js(
        "document.querySelector('#ask-effects').disabled && document.querySelector('#occlusion').value === '0.8' \
         && document.querySelector('#surfaces').childElementCount === 1",
    );
    browser.wait_js(DRAWN);
    end(&browser, lamina);
}

#[test]
fn the_simulation_is_paused_paced_and_stopped_from_the_page() {
    let (lamina, browser, _profile) = watched(&["--cells", "24", "--pace", "4", "--cpu-share", "100%"]);
    browser.wait_js("!document.querySelector('#steering').hidden");
    browser.js("document.querySelector('#steering').open = true");
    let newest = "fetch('api/state').then(r => r.json()).then(s => s.steps[s.steps.length - 1].step)";
    browser.wait_js(&format!("{newest}.then(step => step > 1)"));
    browser.js("document.querySelector('#pause').click()");
    browser.wait_js("document.querySelector('#pause').ariaPressed === 'true'");
    // Steps under way arrive still; then there are none.
    std::thread::sleep(std::time::Duration::from_secs(2));
    let at = browser.js(newest).as_u64().unwrap();
    std::thread::sleep(std::time::Duration::from_secs(2));
    assert_eq!(browser.js(newest).as_u64().unwrap(), at, "eight steps would have come");
    browser.js("(() => { const f = document.querySelector('#numbers input'); f.value = '50'; \
         f.dispatchEvent(new Event('change')) })()");
    browser.wait_js("document.querySelector('#steering-message').textContent.endsWith('= 50')");
    browser.js("document.querySelector('#pause').click()");
    browser.wait_js(&format!("{newest}.then(step => step > {at} + 2)"));
    // Stopping takes two presses.
    browser.js("document.querySelector('#stop').click()");
    browser.wait_js("document.querySelector('#stop').textContent === 'Stop for good'");
    browser.js("document.querySelector('#stop').click()");
    browser.wait_js("document.querySelector('#steering').hidden || document.querySelector('#stop').disabled");
    end(&browser, lamina);
}

#[test]
fn a_trigger_is_set_at_the_page_fires_and_is_removed() {
    let (lamina, browser, _profile) = watched(&["--cells", "24", "--pace", "4", "--cpu-share", "100%"]);
    browser.wait_js("!document.querySelector('#triggers').hidden");
    browser.js("document.querySelector('#triggers').open = true");
    let write = |id: &str, text: &str| {
        browser.js(&format!("document.querySelector('#{id}').value = {}", json!(text)));
    };
    let message = "document.querySelector('#trigger-message')";
    write("trigger-name", "late");
    write("trigger-when", "step > pressure");
    browser.js("document.querySelector('#trigger-ask').click()");
    browser.wait_js(&format!("{message}.className === 'broken' && {message}.textContent.includes('pressure')"));
    // The browser notes the refusal, too.
    let log = browser.post("/se/log", &json!({"type": "browser"}));
    assert!(log.as_array().unwrap().iter().any(|entry| entry["message"].to_string().contains("/api/trigger")), "{log}");
    write("trigger-when", "step > 5 && step > prev(step)");
    browser.js("document.querySelector('#trigger-ask').click()");
    let fired = "document.querySelector('#trigger-list .fired')";
    browser.wait_js(&format!("{fired} !== null && /^step \\d+$/.test({fired}.textContent)"));
    browser.js(&format!("{fired}.click()"));
    browser.wait_js("document.querySelector('#readout').innerText.includes('late')");
    write("trigger-name", "kept");
    write("trigger-when", "max > 1e30");
    write("trigger-copy", "250");
    browser.js("document.querySelector('#trigger-actions [value=copy]').checked = true");
    browser.js("document.querySelector('#trigger-ask').click()");
    let listed = "document.querySelector('#trigger-list').innerText";
    browser.wait_js(&format!("{listed}.includes('copy of at most 250 kB when max > 1e30')"));
    for name in ["late", "kept"] {
        browser.js(&format!("document.querySelector('#trigger-list [aria-label=\"Remove trigger {name}\"]').click()"));
    }
    browser.wait_js("document.querySelector('#trigger-list').children.length === 0");
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
    assert!(drafts.iter().all(|side| (96..=1024).contains(side) && side % 32 == 0), "{drafts:?}");
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
    browser.promised(&format!(
        "import('/draft_size.js').then(module => {{ const d = new (Object.values(module)[0])(); \
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
    assert_eq!(draft_side(&browser, 1e-6, 0.0, 200)["side"], json!(1024));
    assert_eq!(draft_side(&browser, 1.0, 0.0, 200)["side"], json!(96));
    // Drafts that take too long are left within five.
    let side = draft_side(&browser, 4e-3, 0.0, 5)["side"].as_f64().unwrap();
    assert!(4e-3 * side * side < 80.0, "{side}");
    end(&browser, lamina);
}
