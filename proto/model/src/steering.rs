//! Steering: what people who watch a run may ask its simulation for.

use crate::{Effects, Invalid, TransferFunction, TriggerSpec};
use serde::{Deserialize, Serialize};

/// A number of a simulation that may be changed while it runs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SteerableNumber {
    /// What the simulation calls it, such as `inflow`; at most [`SteerableNumber::LONGEST_NAME`] bytes.
    pub name: String,
    /// Its value now.
    pub value: f64,
    /// The least it may be.
    pub least: f64,
    /// The most.
    pub most: f64,
}

impl SteerableNumber {
    /// The most that a run may have.
    pub const MOST: usize = 64;
    /// The longest name, bytes.
    pub const LONGEST_NAME: usize = 63;

    /// Passes a number that people can be offered.
    ///
    /// # Errors
    /// If its name is empty, too long or has control characters, or its value does not lie in a finite range.
    pub fn check(self) -> Result<Self, Invalid> {
        let Self { name, value, least, most } = &self;
        if name.is_empty() || name.len() > Self::LONGEST_NAME || name.chars().any(char::is_control) {
            let most = Self::LONGEST_NAME;
            return Err(Invalid::new("steerable number", format!("\"{name}\": a name has 1 to {most} printed bytes")));
        }
        let is_range = least.is_finite() && most.is_finite() && (least..=most).contains(&value);
        if !is_range {
            return Err(Invalid::new("steerable number", format!("\"{name}\": {value} must lie in {least}..={most}")));
        }
        Ok(self)
    }
}

/// What somebody asks the simulation for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SteeringRequest {
    /// Wait with the next step.
    Pause,
    /// Go on.
    Resume,
    /// End as after the last step.
    Stop,
    /// A [`SteerableNumber`] has another value.
    Set {
        /// Its name.
        name: String,
        /// The value, within its range.
        value: f64,
    },
}

impl std::fmt::Display for SteeringRequest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Pause => f.write_str("pause"),
            Self::Resume => f.write_str("resume"),
            Self::Stop => f.write_str("stop"),
            Self::Set { name, value } => write!(f, "{name} = {value}"),
        }
    }
}

/// A request and who made it.
#[derive(Debug, Clone, PartialEq)]
pub struct Steering {
    /// What is asked for.
    pub request: SteeringRequest,
    /// By whom, for people to read.
    pub asked_by: String,
}

/// What can be asked of the run's simulation now.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Steerable {
    /// Whose simulation it is.
    #[serde(skip)]
    pub run_id: String,
    /// It takes requests.
    pub listens: bool,
    /// It was asked to pause, and not to go on since.
    pub paused: bool,
    /// It was asked to stop.
    pub stopping: bool,
    /// Its numbers, with the values asked for last.
    pub numbers: Vec<SteerableNumber>,
    /// The run's fields.
    pub fields: Vec<String>,
    /// What is shown of them, as asked for last.
    pub shown: String,
    /// Its colors and opacities, and the range of its values that has them.
    pub transfer: Option<TransferFunction>,
    /// The effects that it is shown with.
    pub effects: Option<Effects>,
    /// The node's triggers, which can be changed; those of an older node cannot.
    pub triggers: Option<Vec<TriggerSpec>>,
}

impl Steerable {
    /// Takes a request into account.
    ///
    /// # Errors
    /// If nobody listens, there is no such number, or its range has no such value.
    pub fn take(&mut self, request: &SteeringRequest) -> Result<(), Invalid> {
        if !self.listens {
            let reason = "this simulation takes no requests; it does by RunOptions::steering and Client::steering";
            return Err(Invalid::new("steering", reason));
        }
        match request {
            SteeringRequest::Pause => self.paused = true,
            SteeringRequest::Resume => self.paused = false,
            SteeringRequest::Stop => (self.paused, self.stopping) = (false, true),
            SteeringRequest::Set { name, value } => {
                let known: Vec<&str> = self.numbers.iter().map(|number| number.name.as_str()).collect();
                let unknown =
                    || Invalid::new("steering", format!("no number \"{name}\"; there are: {}", known.join(", ")));
                let at = known.iter().position(|known| known == name).ok_or_else(unknown)?;
                self.numbers[at] = SteerableNumber { value: *value, ..self.numbers[at].clone() }.check()?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn number(name: &str, value: f64) -> SteerableNumber {
        SteerableNumber { name: name.to_owned(), value, least: -1.0, most: 2.0 }
    }

    #[test]
    fn requests_change_what_is_shown_and_what_cannot_be_is_refused() {
        let mut run =
            Steerable { listens: true, numbers: vec![number("a", 0.0), number("b", 1.0)], ..Default::default() };
        let set = |name: &str, value| SteeringRequest::Set { name: name.to_owned(), value };
        run.take(&SteeringRequest::Pause).unwrap();
        run.take(&set("b", 2.0)).unwrap();
        assert!(run.paused && run.numbers == [number("a", 0.0), number("b", 2.0)]);
        for bad in [set("b", 2.1), set("b", f64::NAN), set("b", f64::INFINITY), set("c", 1.0)] {
            assert!(run.take(&bad).is_err(), "{bad}");
        }
        run.take(&SteeringRequest::Stop).unwrap();
        assert!(run.stopping && !run.paused, "what waits cannot end");
        assert!(
            Steerable::default().take(&SteeringRequest::Pause).unwrap_err().to_string().contains("takes no requests")
        );
        for bad in ["", "line\nbreak", &"x".repeat(64)] {
            assert!(number(bad, 0.0).check().is_err());
        }
    }
}
