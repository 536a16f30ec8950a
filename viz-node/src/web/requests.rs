//! Requests from the page: another contract of the tuner, another way to show the run, other triggers, and steering of the simulation.

use super::Web;
use super::guard::Rights;
use crate::negotiation::NegotiationError;
use axum::extract::State;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use lamina_model::{
    ControlPoint, Effects, Invalid, SceneChange, Steering, SteeringRequest, TransferFunction, TriggerChange,
};
use lamina_rpc::daemon::Peer;
use serde::Deserialize;
use tonic::Status;

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

/// Asks the generator-node for a change of its triggers; answered when it is in force.
pub(super) async fn trigger(
    State(web): State<Web>,
    Extension(rights): Extension<Rights>,
    Extension(peer): Extension<Peer>,
    Json(change): Json<TriggerChange>,
) -> Response {
    if let Some(refusal) = refusal(rights) {
        return refusal;
    }
    answer(web.steering.change_triggers(change, asked_by(peer)).await)
}

/// How the run is to be shown; what is left out stays.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ShowAsked {
    /// An expression over the run's fields.
    field: Option<String>,
    /// Where VDIs are to be generated from: degrees to the side and upwards from where step `step` was.
    view: Option<ViewAsked>,
    /// Colors and opacities over the range of the values shown.
    points: Option<Vec<ControlPoint>>,
    /// Effects in place of all that are shown.
    effects: Option<Effects>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ViewAsked {
    step: u64,
    azimuth: f64,
    elevation: f64,
}

impl ShowAsked {
    fn change(self, web: &Web) -> Result<SceneChange, Status> {
        let refused = |e: Invalid| Status::invalid_argument(e.to_string());
        let from = |view: ViewAsked| {
            let shown = web.store.prepared(view.step).map_err(|e| Status::not_found(e.to_string()))?;
            shown.camera().orbit(view.azimuth, view.elevation, 1.0).map_err(refused)
        };
        let recolored = |points| {
            let unknown = || Status::failed_precondition("what is shown is not known yet; ask again");
            let shown = web.steering.steerable().transfer.ok_or_else(unknown)?;
            TransferFunction::new(*shown.range(), shown.stated_unit_length(), points).map_err(refused)
        };
        let (camera, transfer) = (self.view.map(from).transpose()?, self.points.map(recolored).transpose()?);
        Ok(SceneChange { field: self.field, camera, transfer, effects: self.effects })
    }
}

/// Asks the generator-node to show the run otherwise; answered when the next step is to be so.
pub(super) async fn show(
    State(web): State<Web>,
    Extension(rights): Extension<Rights>,
    Extension(peer): Extension<Peer>,
    Json(asked): Json<ShowAsked>,
) -> Response {
    if let Some(refusal) = refusal(rights) {
        return refusal;
    }
    // Decodes the step if it is no longer at hand.
    let of_step = web.clone();
    let change = tokio::task::spawn_blocking(move || asked.change(&of_step)).await;
    match change {
        Ok(Ok(change)) => answer(web.steering.show(change, asked_by(peer)).await),
        Ok(Err(status)) => answer(Err(status)),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, error.to_string()).into_response(),
    }
}

fn answer(asked: Result<(), Status>) -> Response {
    match asked {
        Ok(()) => StatusCode::NO_CONTENT.into_response(),
        Err(status) if status.code() == tonic::Code::Unavailable => {
            (StatusCode::SERVICE_UNAVAILABLE, status.message().to_owned()).into_response()
        }
        Err(status) => (StatusCode::BAD_REQUEST, status.message().to_owned()).into_response(),
    }
}
