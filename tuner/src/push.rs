//! The winner to the generator-node.

use crate::Contract;
use crate::evaluator::TrialError;
use crate::tune::Study;
use lamina_model::{GenerationParams, Representation, TuningState};
use lamina_rpc::v1::{self, control_client::ControlClient};
use tonic::transport::Channel;

/// The parameters of row `chosen` as a setting: with the contract's limits, and, under a limit on size or overhead, what to fall
/// back to on steps for which they are too large.
pub fn setting(study: &Study, chosen: usize, contract: &Contract, state: TuningState) -> v1::SetParametersRequest {
    let cheaper = contract.limits.size_bytes.is_some() || contract.limits.overhead.is_some();
    let ladder = if cheaper { study.ladder(chosen) } else { Vec::new() };
    v1::SetParametersRequest {
        params: Some((&study.rows[chosen].params).into()),
        from_step: 0,
        limits: Some(contract.limits.into()),
        fallbacks: ladder.iter().map(Into::into).collect(),
        tuning_state: v1::TuningState::from(state).into(),
        only_vdis: false,
    }
}

/// The contract's limits alone, for steps before the first study, which may become one of `representations`.
pub fn limits_alone(contract: &Contract, representations: &[Representation]) -> v1::SetParametersRequest {
    let only_vdis = !representations.contains(&Representation::Volume);
    v1::SetParametersRequest { limits: Some(contract.limits.into()), only_vdis, ..Default::default() }
}

/// The parameters of a setting.
pub fn params_of(setting: &v1::SetParametersRequest) -> Option<GenerationParams> {
    GenerationParams::try_from(setting.params?).ok()
}

/// Sends parameters; says from which step on they hold.
///
/// # Errors
/// If the generator-node does not take them.
pub async fn push(control: &ControlClient<Channel>, request: v1::SetParametersRequest) -> Result<u64, TrialError> {
    let reply = control.clone().set_parameters(request).await;
    let failed =
        |s: tonic::Status| TrialError::Node { node: "generator-node".to_owned(), reason: s.message().to_owned() };
    Ok(reply.map_err(failed)?.into_inner().applies_from_step)
}
