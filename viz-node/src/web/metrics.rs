//! `/metrics` in Prometheus text format 0.0.4.

use super::Web;
use axum::extract::State;
use axum::http::header;
use axum::response::IntoResponse;
use lamina_compute::{Activity, Priority, Usage};
use std::fmt::Write;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::UNIX_EPOCH;

/// All figures of this viz-node.
pub(super) async fn metrics(State(web): State<Web>) -> impl IntoResponse {
    let mut text = String::new();
    let mut say = |name: &str, kind: &str, help: &str, value: f64| {
        // Writing to a String cannot fail.
        let _ = write!(text, "# HELP lamina_{name} {help}\n# TYPE lamina_{name} {kind}\nlamina_{name} {value}\n");
    };
    let count = |c: &AtomicU64| c.load(Ordering::Relaxed) as f64;
    let c = &web.intake.counters;
    say("frames_total", "counter", "Steps received and recorded.", count(&c.frames));
    say("frame_bytes_total", "counter", "Bytes of encoded VDIs received.", count(&c.frame_bytes));
    say("trials_total", "counter", "Trials measured for the tuner.", count(&c.trials));
    say("refused_total", "counter", "Deliveries that could not be used.", count(&c.refused));
    say("connections_total", "counter", "Connections made to the generator-node.", count(&c.connections));
    say("unmeasured_total", "counter", "Live steps not measured for want of processor time.", count(&c.unmeasured));
    let refused = &web.refusals;
    say(
        "page_rate_limited_total",
        "counter",
        "Requests refused because their connection sent too many.",
        count(&refused.rate),
    );
    say("page_slow_requests_total", "counter", "Requests whose body did not come in time.", count(&refused.slow));
    say("page_broken_connections_total", "counter", "Connections that ended with an error.", count(&refused.broken));
    let connected = f64::from(u8::from(web.connected.load(Ordering::Relaxed)));
    say("connected", "gauge", "1 while subscribed to the generator-node.", connected);
    let share = &web.intake.share;
    say("cpu_share_cores", "gauge", "Cores that this node may use.", share.cores());
    say("cpu_share_throttle", "gauge", "Share of them in use to keep a limit on overhead.", share.throttled_to());
    say("cpu_share_waiting", "gauge", "Pieces of heavy work that wait.", share.waiting() as f64);
    if let Some(row) = web.store.rows().last() {
        say("step", "gauge", "Newest step.", row.step as f64);
        say("dropped_steps", "gauge", "Steps of the run that the generator-node dropped.", row.dropped_steps as f64);
        say("vdi_size_bytes", "gauge", "Encoded size of the newest step.", row.size_bytes as f64);
        say("vdi_supersegments", "gauge", "Supersegments of the newest step.", row.supersegments as f64);
        say("generation_seconds", "gauge", "Generation time of the newest step.", row.generation_ms / 1e3);
        say("encode_seconds", "gauge", "Encoding time of the newest step.", row.encode_ms / 1e3);
        if let Some(overhead) = row.overhead {
            say(
                "overhead_ratio",
                "gauge",
                "By which share longer the simulation's steps take beside the nodes.",
                overhead,
            );
        }
        say("resolution", "gauge", "Rays per side of the newest step.", f64::from(row.resolution));
        say("gamma", "gauge", "Interrupt parameter of the newest step.", row.gamma);
        if let Some(psnr_db) = row.psnr_db {
            say("psnr_db", "gauge", "Pooled PSNR of the newest step.", psnr_db.into());
        }
    }
    if let Some(end) = web.access.certificate_end().and_then(|end| end.duration_since(UNIX_EPOCH).ok()) {
        let help = "When the node's certificate expires.";
        say("certificate_expiry_timestamp_seconds", "gauge", help, end.as_secs_f64());
    }
    c.size_bytes.write(&mut text, "step_size_bytes", "Encoded bytes of recorded steps.");
    c.generation_secs.write(&mut text, "step_generation_seconds", "Generation times of recorded steps.");
    c.encode_secs.write(&mut text, "step_encode_seconds", "Encoding times of recorded steps.");
    c.psnr_db.write(&mut text, "step_psnr_db", "Pooled PSNR of measured steps.");
    say_usage(&mut text, &share.usage());
    ([(header::CONTENT_TYPE, "text/plain; version=0.0.4")], text.replace(" inf\n", " +Inf\n"))
}

/// Processor time by activity, and work by priority.
fn say_usage(text: &mut String, usage: &Usage) {
    let mut family = |name: &str, help: &str, label: &str, values: &[(&str, f64)]| {
        // Writing to a String cannot fail.
        let _ = write!(text, "# HELP lamina_{name} {help}\n# TYPE lamina_{name} counter\n");
        for (value, count) in values {
            let _ = writeln!(text, "lamina_{name}{{{label}=\"{value}\"}} {count}");
        }
    };
    let spent = Activity::ALL.map(|a| (a.name(), usage.cpu(a).as_secs_f64()));
    family("cpu_seconds_total", "Processor time of heavy work.", "activity", &spent);
    let admitted = Priority::ALL.map(|p| (p.name(), usage.admitted(p) as f64));
    family("work_admitted_total", "Pieces of heavy work that were admitted.", "priority", &admitted);
    let skipped = Priority::ALL.map(|p| (p.name(), usage.skipped(p) as f64));
    family("work_skipped_total", "Pieces of heavy work left out for want of processor time.", "priority", &skipped);
}
