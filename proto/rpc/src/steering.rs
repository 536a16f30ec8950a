//! Steering between model and messages.

use crate::v1;
use lamina_model::{Invalid, SceneChange, Steerable, SteerableNumber, Steering, SteeringRequest};

impl From<SteerableNumber> for v1::SteerableNumber {
    fn from(number: SteerableNumber) -> Self {
        let SteerableNumber { name, value, least, most } = number;
        Self { name, value, least, most }
    }
}

/// Numbers that a simulation offers.
///
/// # Errors
/// If there are too many, two have one name, or one cannot be offered.
pub fn numbers(given: Vec<v1::SteerableNumber>) -> Result<Vec<SteerableNumber>, Invalid> {
    if given.len() > SteerableNumber::MOST {
        let most = SteerableNumber::MOST;
        return Err(Invalid::new("steerable numbers", format!("{}; at most {most} are shown", given.len())));
    }
    let mut numbers: Vec<SteerableNumber> = Vec::new();
    for v1::SteerableNumber { name, value, least, most } in given {
        if numbers.iter().any(|known| known.name == name) {
            return Err(Invalid::new("steerable numbers", format!("two are named \"{name}\"")));
        }
        numbers.push(SteerableNumber { name, value, least, most }.check()?);
    }
    Ok(numbers)
}

impl From<Steering> for v1::Steering {
    fn from(steering: Steering) -> Self {
        use v1::SteeringCommand::{Pause, Resume, Stop};
        let command = |command: v1::SteeringCommand| v1::steering::Request::Command(command.into());
        let request = match steering.request {
            SteeringRequest::Pause => command(Pause),
            SteeringRequest::Resume => command(Resume),
            SteeringRequest::Stop => command(Stop),
            SteeringRequest::Set { name, value } => v1::steering::Request::Number(v1::NewValue { name, value }),
        };
        Self { request: Some(request), asked_by: steering.asked_by }
    }
}

impl TryFrom<v1::Steering> for Steering {
    type Error = Invalid;

    fn try_from(steering: v1::Steering) -> Result<Self, Invalid> {
        let unknown = || Invalid::new("steering", "neither pause, resume, stop nor a number");
        let request = match steering.request.ok_or_else(unknown)? {
            v1::steering::Request::Number(v1::NewValue { name, value }) => SteeringRequest::Set { name, value },
            v1::steering::Request::Command(command) => match v1::SteeringCommand::try_from(command) {
                Ok(v1::SteeringCommand::Pause) => SteeringRequest::Pause,
                Ok(v1::SteeringCommand::Resume) => SteeringRequest::Resume,
                Ok(v1::SteeringCommand::Stop) => SteeringRequest::Stop,
                Ok(v1::SteeringCommand::Unspecified) | Err(_) => return Err(unknown()),
            },
        };
        Ok(Self { request, asked_by: steering.asked_by })
    }
}

impl From<Steerable> for v1::Steerable {
    fn from(of: Steerable) -> Self {
        let Steerable { run_id, listens, paused, stopping, numbers, fields, shown, transfer, effects, triggers } = of;
        let triggers = triggers.map(Into::into);
        let numbers = numbers.into_iter().map(Into::into).collect();
        let (transfer, effects) = (transfer.as_ref().map(Into::into), effects.as_ref().map(Into::into));
        Self { run_id, listens, paused, stopping, numbers, fields, shown, transfer, effects, triggers }
    }
}

impl TryFrom<v1::Steerable> for Steerable {
    type Error = Invalid;

    fn try_from(of: v1::Steerable) -> Result<Self, Invalid> {
        let v1::Steerable { run_id, listens, paused, stopping, fields, shown, .. } = of;
        let numbers = numbers(of.numbers)?;
        let transfer = of.transfer.map(TryInto::try_into).transpose()?;
        let effects = of.effects.map(TryInto::try_into).transpose()?;
        let triggers = of.triggers.map(TryInto::try_into).transpose()?;
        Ok(Self { run_id, listens, paused, stopping, numbers, fields, shown, transfer, effects, triggers })
    }
}

/// The request for `change` of run `run_id`.
pub fn show_request(run_id: String, change: &SceneChange, asked_by: String) -> v1::ShowRequest {
    let SceneChange { field, camera, transfer, effects } = change;
    let (camera, transfer) = (camera.as_ref().map(Into::into), transfer.as_ref().map(Into::into));
    v1::ShowRequest {
        run_id,
        field: field.clone(),
        asked_by,
        camera,
        transfer,
        effects: effects.as_ref().map(Into::into),
    }
}

impl TryFrom<v1::ShowRequest> for SceneChange {
    type Error = Invalid;

    fn try_from(request: v1::ShowRequest) -> Result<Self, Invalid> {
        let v1::ShowRequest { field, camera, transfer, effects, .. } = request;
        let camera = camera.map(TryInto::try_into).transpose()?;
        let transfer = transfer.map(TryInto::try_into).transpose()?;
        let effects = effects.map(TryInto::try_into).transpose()?;
        Self { field: field.map(|field| field.trim().to_owned()), camera, transfer, effects }.check()
    }
}
