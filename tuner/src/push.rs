//! The winner to the generator-node.

use crate::trial::TrialError;
use crate::tune::Study;
use crate::utility::Utility;
use lamina_wire::v1::{self, control_client::ControlClient};
use tonic::transport::Channel;

/// The parameters of a study to use from now on, and the row they come from: the best, or, where nothing keeps the limit,
/// what comes nearest.
pub fn decide(study: &Study, utility: &Utility) -> Option<(usize, v1::SetParametersRequest)> {
    let chosen = study.best.or_else(|| study.nearest(utility))?;
    let (size_limit_bytes, time_limit_ns) = match *utility {
        Utility::Size { limit_bytes } => (Some(limit_bytes), None),
        Utility::Time { limit_ms } => (None, Some((limit_ms * 1e6) as u64)),
    };
    let ladder = if size_limit_bytes.is_some() { study.ladder(chosen) } else { Vec::new() };
    let request = v1::SetParametersRequest {
        params: Some((&study.rows[chosen].params).into()),
        from_step: 0,
        size_limit_bytes,
        fallbacks: ladder.iter().map(Into::into).collect(),
        time_limit_ns,
    };
    Some((chosen, request))
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
