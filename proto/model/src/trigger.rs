//! Triggers: conditions over each step, and what is done at the step where one becomes true.

use crate::Invalid;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::fmt;

/// A trigger as it is stated; a generator-node has at most [`TriggerSpec::MOST`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TriggerSpec {
    /// What it is called in logs and records: letters, digits, `-` and `_`.
    pub name: String,
    /// The condition, such as `max > 10 && max > 2 * prev(max)`.
    pub when: String,
    /// What is done at a step where the condition is true and was not at the step before.
    #[serde(rename = "do")]
    pub actions: BTreeSet<TriggerAction>,
    /// The most kilobytes of a copy; stated where one is to be kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub copy_kb: Option<u32>,
    /// Pictures are from the scene's camera turned about the y axis through its target by so many degrees each; from it itself, if none
    /// is stated.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub angles: Vec<f64>,
}

impl TriggerSpec {
    /// The most of a node.
    pub const MOST: usize = 64;
    /// The most pictures of a step.
    pub const MOST_ANGLES: usize = 36;

    /// Checked: a size stands where a copy is to be kept, angles only where pictures are.
    ///
    /// # Errors
    /// Names the trigger.
    pub fn check(&self) -> Result<(), Invalid> {
        let refused = |reason: String| Err(Invalid::new("trigger.angles", format!("\"{}\": {reason}", self.name)));
        if !self.angles.is_empty() && !self.actions.contains(&TriggerAction::Picture) {
            return refused("are stated, and no picture is to be kept; add \"picture\" to what is done".to_owned());
        }
        if self.angles.len() > Self::MOST_ANGLES {
            return refused(format!("{} pictures of a step; at most {}", self.angles.len(), Self::MOST_ANGLES));
        }
        if let Some(angle) = self.angles.iter().find(|angle| !(-360.0..=360.0).contains(*angle)) {
            return refused(format!("{angle} is not from -360 to 360 degrees"));
        }
        let reason = match (self.actions.contains(&TriggerAction::Copy), self.copy_kb) {
            (true, None | Some(0)) => "a copy is to be kept; state its most kilobytes, such as copy_kb = 5000",
            (false, Some(_)) => "copy_kb is stated, and no copy is to be kept; add \"copy\" to what is done",
            _ => return Ok(()),
        };
        Err(Invalid::new("trigger.copy_kb", format!("\"{}\": {reason}", self.name)))
    }
}

impl fmt::Display for TriggerSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let actions: Vec<&str> = self.actions.iter().map(TriggerAction::name).collect();
        let actions = if actions.is_empty() { "record".to_owned() } else { actions.join(", ") };
        write!(f, "trigger {}: when {}, {actions}", self.name, self.when)
    }
}

/// What a trigger does; that it fired is logged and recorded in any case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TriggerAction {
    /// Asks the simulation to pause, through steering.
    Pause,
    /// Asks it to stop.
    Stop,
    /// Writes the step's voxels to a raw file.
    Raw,
    /// Writes pictures of the step, ray-cast from the scene's camera and from beside it.
    Picture,
    /// Writes the step once more, as fine as fits `copy_kb`.
    Copy,
    /// Tells the address that the node's configuration states as `webhook`.
    Webhook,
}

impl TriggerAction {
    fn name(&self) -> &'static str {
        match self {
            Self::Pause => "pause",
            Self::Stop => "stop",
            Self::Raw => "raw",
            Self::Picture => "picture",
            Self::Copy => "copy",
            Self::Webhook => "webhook",
        }
    }
}

/// What somebody asks for of a node's triggers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TriggerChange {
    /// This one, in place of one of the same name.
    Set(TriggerSpec),
    /// None of this name.
    Remove(String),
}

impl fmt::Display for TriggerChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Set(trigger) => trigger.fmt(f),
            Self::Remove(name) => write!(f, "trigger {name}: removed"),
        }
    }
}
