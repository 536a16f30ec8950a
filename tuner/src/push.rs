//! The winner to the generator-node.

use crate::Contract;
use crate::evaluator::TrialError;
use crate::tune::Study;
use lamina_model::{Representation, Setting, TuningState};
use lamina_rpc::v1::{self, control_client::ControlClient};
use tonic::transport::Channel;

/// The parameters of row `chosen` as a setting: with the contract's limits, and, under a limit on size or overhead, what to fall
/// back to on steps for which they are too large.
pub fn setting(study: &Study, chosen: usize, contract: &Contract, state: TuningState) -> Setting {
    let cheaper = contract.limits.size_bytes.is_some() || contract.limits.overhead.is_some();
    let ladder = if cheaper { study.ladder(chosen) } else { Vec::new() };
    Setting {
        params: Some(study.rows[chosen].params),
        limits: contract.limits,
        objective: contract.utility().objective(),
        fallbacks: ladder,
        tuning: state,
        only_vdis: false,
    }
}

/// The contract's limits alone, for steps before the first study, which may become one of `representations`.
pub fn limits_alone(contract: &Contract, representations: &[Representation]) -> Setting {
    let only_vdis = !representations.contains(&Representation::Volume);
    let objective = contract.utility().objective();
    Setting { limits: contract.limits, objective, only_vdis, ..Setting::default() }
}

/// Sends a setting for the next step; says from which step on they hold.
///
/// # Errors
/// If the generator-node does not take them.
pub async fn push(control: &ControlClient<Channel>, setting: &Setting) -> Result<u64, TrialError> {
    let reply = control.clone().set_parameters(v1::SetParametersRequest::new(setting, 0)).await;
    let failed =
        |s: tonic::Status| TrialError::Node { node: "generator-node".to_owned(), reason: s.message().to_owned() };
    Ok(reply.map_err(failed)?.into_inner().applies_from_step)
}
