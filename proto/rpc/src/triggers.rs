//! Triggers between model and messages.

use crate::v1;
use crate::v1::change_triggers_request::Change;
use lamina_model::{Invalid, TriggerAction, TriggerChange, TriggerSpec};

impl From<TriggerAction> for v1::TriggerAction {
    fn from(action: TriggerAction) -> Self {
        match action {
            TriggerAction::Pause => Self::Pause,
            TriggerAction::Stop => Self::Stop,
            TriggerAction::Raw => Self::Raw,
            TriggerAction::Picture => Self::Picture,
            TriggerAction::Copy => Self::Copy,
            TriggerAction::Webhook => Self::Webhook,
        }
    }
}

impl From<TriggerSpec> for v1::Trigger {
    fn from(TriggerSpec { name, when, actions, copy_kb, angles }: TriggerSpec) -> Self {
        let actions = actions.into_iter().map(|action| v1::TriggerAction::from(action).into()).collect();
        Self { name, when, actions, copy_kb, angles }
    }
}

impl TryFrom<v1::Trigger> for TriggerSpec {
    type Error = Invalid;

    fn try_from(v1::Trigger { name, when, actions, copy_kb, angles }: v1::Trigger) -> Result<Self, Invalid> {
        let action = |number| match v1::TriggerAction::try_from(number) {
            Ok(v1::TriggerAction::Pause) => Ok(TriggerAction::Pause),
            Ok(v1::TriggerAction::Stop) => Ok(TriggerAction::Stop),
            Ok(v1::TriggerAction::Raw) => Ok(TriggerAction::Raw),
            Ok(v1::TriggerAction::Picture) => Ok(TriggerAction::Picture),
            Ok(v1::TriggerAction::Copy) => Ok(TriggerAction::Copy),
            Ok(v1::TriggerAction::Webhook) => Ok(TriggerAction::Webhook),
            Ok(v1::TriggerAction::Unspecified) | Err(_) => {
                let known = "pause, stop, raw, picture, copy and webhook";
                Err(Invalid::new("trigger.do", format!("{number} is none of {known}")))
            }
        };
        let actions = actions.into_iter().map(action).collect::<Result<_, _>>()?;
        Ok(Self { name, when, actions, copy_kb, angles })
    }
}

impl From<Vec<TriggerSpec>> for v1::TriggerList {
    fn from(triggers: Vec<TriggerSpec>) -> Self {
        Self { triggers: triggers.into_iter().map(Into::into).collect() }
    }
}

impl TryFrom<v1::TriggerList> for Vec<TriggerSpec> {
    type Error = Invalid;

    fn try_from(v1::TriggerList { triggers }: v1::TriggerList) -> Result<Self, Invalid> {
        triggers.into_iter().map(TryInto::try_into).collect()
    }
}

/// The request for `change`.
pub fn change_request(change: TriggerChange, asked_by: String) -> v1::ChangeTriggersRequest {
    let change = match change {
        TriggerChange::Set(trigger) => Change::Set(trigger.into()),
        TriggerChange::Remove(name) => Change::Remove(name),
    };
    v1::ChangeTriggersRequest { change: Some(change), asked_by }
}

impl TryFrom<v1::ChangeTriggersRequest> for TriggerChange {
    type Error = Invalid;

    fn try_from(request: v1::ChangeTriggersRequest) -> Result<Self, Invalid> {
        match request.change {
            Some(Change::Set(trigger)) => Ok(Self::Set(trigger.try_into()?)),
            Some(Change::Remove(name)) => Ok(Self::Remove(name)),
            None => Err(Invalid::new("trigger", "neither set nor removed")),
        }
    }
}
