//! Requests from the page: another contract of the tuner, another field, and steering of the simulation.

use super::Web;
use super::guard::Rights;
use crate::negotiation::NegotiationError;
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use lamina_model::{Steering, SteeringRequest};
use lamina_rpc::daemon::Peer;
use serde::Deserialize;

/// The longest contract taken, bytes.
const LONGEST: usize = 1000;

#[derive(Deserialize)]
pub(super) struct ContractAsked {
    contract: String,
}

/// Why somebody may not ask for anything.
fn refusal(rights: Rights) -> Option<Response> {
    let words = "this browser may watch only; come in by the address that the viz-node prints for steering";
    (rights != Rights::Steer).then(|| (StatusCode::FORBIDDEN, words).into_response())
}

/// Who asks, for the record.
fn asked_by(peer: Peer) -> String {
    format!("browser at {}", peer.address.ip().to_canonical())
}

/// Asks the tuner for another contract; answered when it is in force.
pub(super) async fn contract(
    State(web): State<Web>,
    Extension(rights): Extension<Rights>,
    Extension(peer): Extension<Peer>,
    Json(ContractAsked { contract }): Json<ContractAsked>,
) -> Response {
    if let Some(refusal) = refusal(rights) {
        return refusal;
    }
    if contract.len() > LONGEST {
        return (StatusCode::BAD_REQUEST, format!("a contract of at most {LONGEST} bytes")).into_response();
    }
    let asked_by = asked_by(peer);
    match web.negotiation.ask(contract.clone(), asked_by.clone()).await {
        Ok(()) => {
            web.store.record_request(&asked_by, &format!("contract: {contract}"));
            StatusCode::NO_CONTENT.into_response()
        }
        Err(error @ NegotiationError::Refused(_)) => (StatusCode::BAD_REQUEST, error.to_string()).into_response(),
        Err(error) => (StatusCode::SERVICE_UNAVAILABLE, error.to_string()).into_response(),
    }
}

/// Asks the simulation for something; answered when it is on its way there.
pub(super) async fn steer(
    State(web): State<Web>,
    Extension(rights): Extension<Rights>,
    Extension(peer): Extension<Peer>,
    Json(request): Json<SteeringRequest>,
) -> Response {
    if let Some(refusal) = refusal(rights) {
        return refusal;
    }
    answer(web.steering.ask(Steering { request, asked_by: asked_by(peer) }).await)
}

#[derive(Deserialize)]
pub(super) struct FieldAsked {
    field: String,
}

/// Asks the generator-node for another field; answered when it is to be the next step's.
pub(super) async fn show(
    State(web): State<Web>,
    Extension(rights): Extension<Rights>,
    Extension(peer): Extension<Peer>,
    Json(FieldAsked { field }): Json<FieldAsked>,
) -> Response {
    if let Some(refusal) = refusal(rights) {
        return refusal;
    }
    answer(web.steering.show(field, asked_by(peer)).await)
}

fn answer(asked: Result<(), tonic::Status>) -> Response {
    match asked {
        Ok(()) => StatusCode::NO_CONTENT.into_response(),
        Err(status) if status.code() == tonic::Code::Unavailable => {
            (StatusCode::SERVICE_UNAVAILABLE, status.message().to_owned()).into_response()
        }
        Err(status) => (StatusCode::BAD_REQUEST, status.message().to_owned()).into_response(),
    }
}
