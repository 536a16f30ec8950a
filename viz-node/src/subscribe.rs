//! Subscriptions: connects to the generator-node, again and again, and hands deliveries to the intake in order; live steps and
//! trials on connections of their own, so that neither waits behind the other.

use crate::Config;
use crate::intake::Intake;
use crate::quality_service::step_quality;
use crate::store::Event;
use futures::StreamExt as _;
use lamina_rpc::MAX_MESSAGE_BYTES;
use lamina_rpc::chunks::Assembler;
use lamina_rpc::connect::connect;
use lamina_rpc::credentials::{Credentials, Role};
use lamina_rpc::v1::{self, delivery::Part, frames_client::FramesClient};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tonic::transport::Channel;
use tonic::{Code, Status, Streaming};

/// Pause before a generator-node that is too old is asked again.
pub(crate) const OLDER: Duration = Duration::from_secs(60);

/// Pause before a lost generator-node is tried again.
const RETRY: Duration = Duration::from_millis(500);

/// Follows live steps for ever; `connected` says whether the subscription stands.
pub(crate) async fn live(
    config: Config,
    credentials: Option<Credentials>,
    intake: Arc<Intake>,
    connected: Arc<AtomicBool>,
) {
    let follow = || async {
        let ended = follow_live(&config, credentials.as_ref(), &intake, &connected).await;
        connected.store(false, Ordering::Relaxed);
        ended
    };
    forever(&config.generator, follow).await;
}

/// Follows trials for ever, where quality is measured.
pub(crate) async fn trials(config: Config, credentials: Option<Credentials>, intake: Arc<Intake>) {
    if config.quality_address.as_deref().is_none_or(str::is_empty) {
        return;
    }
    let follow = || async {
        let ended = follow_trials(&config, credentials.as_ref(), &intake).await;
        intake.trials.subscribed(false);
        ended
    };
    forever(&config.generator, follow).await;
}

/// Tells the generator-node for ever what is measured of live steps.
pub(crate) async fn report(config: Config, credentials: Option<Credentials>, intake: Arc<Intake>) {
    let follow = || async {
        let measured = intake.store.events().filter_map(|event| {
            let quality = match event {
                Event::Step(run_id, row) => step_quality(run_id, &row),
                _ => None,
            };
            std::future::ready(quality)
        });
        match frames(&config, credentials.as_ref()).await?.report(measured).await {
            Err(status) if status.code() == Code::Unimplemented => {
                // A newer one may take its place.
                tokio::time::sleep(OLDER).await;
                Err(Status::unimplemented("this generator-node is older: its triggers do not depend on quality"))
            }
            other => other.map(drop),
        }
    };
    forever(&config.generator, follow).await;
}

/// Tries again whenever it ends.
pub(crate) async fn forever<F: Future<Output = Result<(), Status>>>(generator: &str, attempt: impl Fn() -> F) {
    let mut reported = String::new();
    loop {
        let text = match attempt().await {
            Ok(()) => "the stream of frames ended".to_owned(),
            Err(status) => status.message().to_owned(),
        };
        // The same trouble twice is one line in the log.
        if text != reported {
            tracing::warn!(generator, "{text}; trying again");
            reported = text;
        }
        tokio::time::sleep(RETRY).await;
    }
}

/// A connection to the generator-node.
///
/// # Errors
/// If it does not answer.
pub(crate) async fn frames(
    config: &Config,
    credentials: Option<&Credentials>,
) -> Result<FramesClient<Channel>, Status> {
    let unreachable = |reason: String| Status::unavailable(format!("generator-node {reason}"));
    let channel = connect(&config.generator, Role::Generator, credentials).await.map_err(unreachable)?;
    Ok(FramesClient::new(channel).max_decoding_message_size(MAX_MESSAGE_BYTES))
}

async fn follow_live(
    config: &Config,
    credentials: Option<&Credentials>,
    intake: &Arc<Intake>,
    connected: &AtomicBool,
) -> Result<(), Status> {
    let run_id = intake.store.run().map(|r| r.id).unwrap_or_default();
    let request = v1::SubscribeRequest { run_id, after_step: intake.store.newest_step() };
    let deliveries = frames(config, credentials).await?.subscribe(request).await?.into_inner();
    connected.store(true, Ordering::Relaxed);
    intake.counters.connections.fetch_add(1, Ordering::Relaxed);
    tracing::info!(generator = config.generator, "subscribed");
    assemble(config, intake, deliveries, Intake::take_live).await
}

async fn follow_trials(config: &Config, credentials: Option<&Credentials>, intake: &Arc<Intake>) -> Result<(), Status> {
    let quality_address = config.quality_address.clone().unwrap_or_default();
    let request = v1::SubscribeTrialsRequest { quality_address };
    let deliveries = frames(config, credentials).await?.subscribe_trials(request).await?.into_inner();
    intake.trials.subscribed(true);
    assemble(config, intake, deliveries, Intake::take_trial).await
}

/// Puts deliveries together and hands them on.
async fn assemble(
    config: &Config,
    intake: &Arc<Intake>,
    mut deliveries: Streaming<v1::Delivery>,
    take: fn(&Intake, Part, Vec<u8>) -> Result<(), Status>,
) -> Result<(), Status> {
    let mut assembler = Assembler::new(config.max_frame_bytes);
    while let Some(delivery) = deliveries.message().await? {
        let trial_id = match &delivery.part {
            Some(Part::Frame(frame)) => frame.trial_id,
            _ => 0,
        };
        let whole = match assembler.push(delivery) {
            Ok(whole) => whole,
            Err(too_large) if too_large.code() == Code::ResourceExhausted => {
                // The next delivery may well fit.
                intake.counters.refused.fetch_add(1, Ordering::Relaxed);
                let reason = format!("{}; raise max_frame_bytes in this viz-node's configuration", too_large.message());
                tracing::error!("{reason}");
                if trial_id != 0 {
                    intake.trials.keep(trial_id, Err(Status::invalid_argument(reason)));
                }
                continue;
            }
            Err(broken) => return Err(broken),
        };
        if let Some((part, payload)) = whole {
            let intake = intake.clone();
            let work = move || take(&intake, part, payload);
            tokio::task::spawn_blocking(work).await.map_err(|e| Status::internal(e.to_string()))??;
        }
    }
    Ok(())
}
