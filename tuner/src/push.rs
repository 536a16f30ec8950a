//! The winner to the generator-node.

use crate::Contract;
use crate::trial::TrialError;
use crate::tune::Study;
use lamina_wire::v1::{self, control_client::ControlClient};
use tonic::transport::Channel;

/// The parameters of row `chosen` as a setting: with the contract's limits, and, under a size limit, what to fall back to on
/// steps for which they are too large.
pub fn setting(study: &Study, chosen: usize, contract: &Contract) -> v1::SetParametersRequest {
    let ladder = if contract.size_bytes.is_some() { study.ladder(chosen) } else { Vec::new() };
    v1::SetParametersRequest {
        params: Some((&study.rows[chosen].params).into()),
        from_step: 0,
        limits: Some(limits(contract)),
        fallbacks: ladder.iter().map(Into::into).collect(),
    }
}

/// The contract's limits alone, for steps before the first study.
pub fn limits_alone(contract: &Contract) -> v1::SetParametersRequest {
    v1::SetParametersRequest { limits: Some(limits(contract)), ..Default::default() }
}

fn limits(contract: &Contract) -> v1::Limits {
    v1::Limits {
        size_bytes: contract.size_bytes,
        time_ns: contract.time_ms.map(|ms| (ms * 1e6) as u64),
        with_encoding: contract.with_encoding,
        psnr_db: contract.psnr_db,
    }
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
