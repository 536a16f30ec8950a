//! The subscription: connects to the generator-node, again and again, and hands deliveries to the meter in order.

use crate::Config;
use crate::measure::Meter;
use crate::store::Store;
use lamina_wire::MAX_MESSAGE_BYTES;
use lamina_wire::chunks::Assembler;
use lamina_wire::node::connect;
use lamina_wire::v1::{self, delivery::Part, frames_client::FramesClient};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tonic::Status;

/// Pause before a lost generator-node is tried again.
const RETRY: Duration = Duration::from_millis(500);

/// Subscribes for ever; `connected` says whether it stands.
pub async fn run(config: Config, store: Arc<Store>, meter: Arc<Meter>, connected: Arc<AtomicBool>) {
    let mut reported = String::new();
    loop {
        let ended = follow(&config, &store, &meter, &connected).await;
        connected.store(false, Ordering::Relaxed);
        let text = match &ended {
            Ok(()) => "the stream of frames ended".to_owned(),
            Err(status) => status.message().to_owned(),
        };
        // The same trouble twice is one line in the log.
        if text != reported {
            tracing::warn!(generator = config.generator, "{text}; trying again");
            reported = text;
        }
        tokio::time::sleep(RETRY).await;
    }
}

async fn follow(config: &Config, store: &Arc<Store>, meter: &Arc<Meter>, connected: &AtomicBool) -> Result<(), Status> {
    let unreachable = |reason: String| Status::unavailable(format!("generator-node {reason}"));
    let channel = connect(&config.generator).await.map_err(unreachable)?;
    let mut frames = FramesClient::new(channel).max_decoding_message_size(MAX_MESSAGE_BYTES);
    let request = v1::SubscribeRequest {
        run_id: store.run().map(|r| r.id).unwrap_or_default(),
        after_step: store.newest_step(),
        quality_address: config.quality_address.clone().unwrap_or_default(),
    };
    let mut deliveries = frames.subscribe(request).await?.into_inner();
    connected.store(true, Ordering::Relaxed);
    meter.counters.connections.fetch_add(1, Ordering::Relaxed);
    tracing::info!(generator = config.generator, "subscribed");
    let mut assembler = Assembler::new(config.max_frame_bytes);
    while let Some(delivery) = deliveries.message().await? {
        let trial_id = match &delivery.part {
            Some(Part::Frame(frame)) => frame.trial_id,
            _ => 0,
        };
        let whole = match assembler.push(delivery) {
            Ok(whole) => whole,
            Err(too_large) if too_large.code() == tonic::Code::ResourceExhausted => {
                // The next delivery may well fit.
                meter.counters.refused.fetch_add(1, Ordering::Relaxed);
                let reason = format!("{}; raise max_frame_bytes in this viz-node's configuration", too_large.message());
                tracing::error!("{reason}");
                if trial_id != 0 {
                    meter.trials.keep(trial_id, Err(Status::invalid_argument(reason)));
                }
                continue;
            }
            Err(broken) => return Err(broken),
        };
        if let Some((part, payload)) = whole {
            let meter = meter.clone();
            let work = move || meter.take(part, payload);
            tokio::task::spawn_blocking(work).await.map_err(|e| Status::internal(e.to_string()))?;
        }
    }
    Ok(())
}
