//! Steering of the simulations that the command line runs.

use crate::cli::StepsPerSecond;
use crate::pacer::Pacer;
use lamina_client::{Client, SteerableNumber, SteeringRequest};
use std::time::Duration;

/// How often a paused simulation asks whether it may go on.
const INTERVAL: Duration = Duration::from_millis(50);

/// The name of the number that is the pace.
const PACE: &str = "steps a second (0: no limit)";

/// What people may change: the pace.
pub(crate) fn numbers(pace: StepsPerSecond) -> Vec<SteerableNumber> {
    vec![SteerableNumber { name: PACE.to_owned(), value: pace.0, least: 0.0, most: 1e6 }]
}

/// Does what people asked for; true if the simulation is to end. While they want it to pause it waits, and does something else
/// `meanwhile`.
///
/// # Errors
/// Those of `meanwhile`.
pub(crate) fn obey(
    client: &mut Client,
    pacer: &mut Pacer,
    stopped: &impl Fn() -> bool,
    mut meanwhile: impl FnMut() -> anyhow::Result<()>,
) -> anyhow::Result<bool> {
    let mut paused = false;
    loop {
        for steering in client.steering() {
            say!("{} by {}", steering.request, steering.asked_by);
            match steering.request {
                SteeringRequest::Pause => paused = true,
                SteeringRequest::Resume => paused = false,
                SteeringRequest::Stop => return Ok(true),
                SteeringRequest::Set { value, .. } => pacer.set(StepsPerSecond(value)),
            }
        }
        if !paused || stopped() {
            return Ok(false);
        }
        meanwhile()?;
        std::thread::sleep(INTERVAL);
    }
}
