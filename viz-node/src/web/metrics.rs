//! What a viz-node says at `/metrics`.

use super::Web;
use lamina_rpc::daemon::Exposition;
use std::sync::atomic::{AtomicU64, Ordering};

/// Writes all figures of this viz-node.
pub(crate) fn write(web: &Web, text: &mut Exposition) {
    let count = |c: &AtomicU64| c.load(Ordering::Relaxed) as f64;
    let c = &web.intake.counters;
    text.counter("frames_total", "Steps received and recorded.", count(&c.frames));
    text.counter("frame_bytes_total", "Encoded bytes of recorded steps.", count(&c.frame_bytes));
    text.counter("trials_total", "Trials measured for the tuner.", count(&c.trials));
    text.counter("refused_total", "Deliveries that could not be used.", count(&c.refused));
    text.counter("connections_total", "Connections made to the generator-node.", count(&c.connections));
    text.counter("unmeasured_total", "Live steps not measured for want of processor time.", count(&c.unmeasured));
    let connected = f64::from(u8::from(web.connected.load(Ordering::Relaxed)));
    text.gauge("connected", "1 while subscribed to the generator-node.", connected);
    if let Some(row) = web.store.rows().last() {
        text.gauge("step", "Newest step.", row.step as f64);
        text.gauge("dropped_steps", "Steps of the run that the generator-node dropped.", row.dropped_steps as f64);
        text.gauge("vdi_size_bytes", "Encoded size of the newest step.", row.size_bytes as f64);
        text.gauge("vdi_supersegments", "Supersegments of the newest step.", row.supersegments as f64);
        text.gauge("generation_seconds", "Generation time of the newest step.", row.generation_ms / 1e3);
        text.gauge("encode_seconds", "Encoding time of the newest step.", row.encode_ms / 1e3);
        if let Some(overhead) = row.overhead {
            let help = "By which share longer the simulation's steps take beside the nodes.";
            text.gauge("overhead_ratio", help, overhead);
        }
        text.gauge("resolution", "Rays per side of the newest step.", f64::from(row.resolution));
        text.gauge("gamma", "Interrupt parameter of the newest step.", row.gamma);
        if let Some(psnr_db) = row.psnr_db {
            text.gauge("psnr_db", "Pooled PSNR of the newest step.", psnr_db.into());
        }
    }
    text.histogram("step_size_bytes", "Encoded bytes of recorded steps.", &c.size_bytes);
    text.histogram("step_generation_seconds", "Generation times of recorded steps.", &c.generation_secs);
    text.histogram("step_encode_seconds", "Encoding times of recorded steps.", &c.encode_secs);
    text.histogram("step_psnr_db", "Pooled PSNR of measured steps.", &c.psnr_db);
    let share = &web.intake.share;
    share.gauges().into_iter().for_each(|(name, help, value)| text.gauge(name, help, value));
    share.usage().counters().iter().for_each(|c| text.counters(c.name, c.help, c.label, &c.values));
}
