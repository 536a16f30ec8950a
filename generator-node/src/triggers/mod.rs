//! Triggers: conditions over each step, and what is done at the step where one becomes true.

mod condition;
mod files;
mod statistics;

pub(crate) use files::{write_picture, write_raw};
pub(crate) use statistics::Statistics;

use condition::Condition;
use lamina_model::{Cost, Invalid};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// A trigger as the configuration states it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TriggerSpec {
    /// What it is called in logs and records: letters, digits, `-` and `_`.
    pub name: String,
    /// The condition, such as `max > 10 && max > 2 * prev(max)`.
    pub when: String,
    /// What is done at a step where the condition is true and was not at the step before.
    #[serde(rename = "do")]
    pub actions: BTreeSet<Action>,
}

/// What a trigger does; that it fired is logged and recorded in any case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Action {
    /// Asks the simulation to pause, through steering.
    Pause,
    /// Asks it to stop.
    Stop,
    /// Writes the step's voxels to a raw file.
    Raw,
    /// Writes a picture of the step, ray-cast from the scene's camera.
    Picture,
}

/// The most triggers of a node.
const MOST: usize = 64;

struct Trigger {
    name: String,
    condition: Condition,
    actions: BTreeSet<Action>,
    was_true: bool,
}

/// A trigger that fired.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Fired {
    /// Its name.
    pub name: String,
    /// What is to be done.
    pub actions: BTreeSet<Action>,
}

/// All triggers of a node, and what they remember of a run.
#[derive(Default)]
pub(crate) struct Triggers {
    triggers: Vec<Trigger>,
    run_id: String,
    /// Sampled values of the step before, for `change`.
    samples: Vec<f64>,
}

impl Triggers {
    /// Reads all conditions.
    ///
    /// # Errors
    /// Names the trigger, and what is wrong with it.
    pub(crate) fn new(specs: &[TriggerSpec]) -> Result<Self, Invalid> {
        if specs.len() > MOST {
            return Err(Invalid::new("trigger", format!("{} triggers; at most {MOST}", specs.len())));
        }
        let mut names = BTreeSet::new();
        let read = |spec: &TriggerSpec| {
            let TriggerSpec { name, when, actions } = spec;
            let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
            if name.is_empty() || name.len() > 60 || !name.chars().all(is_plain) {
                let reason = format!("\"{name}\": a name has 1 to 60 letters, digits, - and _");
                return Err(Invalid::new("trigger.name", reason));
            }
            if !names.insert(name.clone()) {
                return Err(Invalid::new("trigger.name", format!("\"{name}\" stands twice")));
            }
            let condition = Condition::parse(when);
            let condition = condition.map_err(|e| Invalid::new("trigger.when", format!("\"{name}\": {e}")))?;
            Ok(Trigger { name: name.clone(), condition, actions: actions.clone(), was_true: false })
        };
        Ok(Self { triggers: specs.iter().map(read).collect::<Result<_, _>>()?, ..Self::default() })
    }

    /// True if there are none, and nothing of a step has to be known.
    pub(crate) fn is_empty(&self) -> bool {
        self.triggers.is_empty()
    }

    /// Their names.
    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        self.triggers.iter().map(|trigger| trigger.name.as_str())
    }

    /// True if a trigger may want the voxels of a step.
    pub(crate) fn wants_voxels(&self) -> bool {
        self.triggers.iter().any(|trigger| trigger.actions.contains(&Action::Raw))
    }

    /// Those that fire at a step of `run_id` with these `statistics`, which cost so much to encode.
    pub(crate) fn evaluate(
        &mut self,
        run_id: &str,
        (step, time): (u64, f64),
        statistics: &Statistics,
        cost: &Cost,
    ) -> Vec<Fired> {
        if self.run_id != run_id {
            run_id.clone_into(&mut self.run_id);
            self.samples.clear();
            self.triggers.iter_mut().for_each(|trigger| {
                trigger.condition.forget();
                trigger.was_true = false;
            });
        }
        let change = statistics.change_from(&self.samples);
        self.samples.clone_from(&statistics.samples);
        let mut fired = Vec::new();
        for trigger in &mut self.triggers {
            let is_true = trigger.condition.evaluate(&|quantity| match *quantity {
                condition::Quantity::Step => step as f64,
                condition::Quantity::Time => time,
                condition::Quantity::Min => statistics.min,
                condition::Quantity::Max => statistics.max,
                condition::Quantity::Mean => statistics.mean,
                condition::Quantity::Entropy => statistics.entropy(),
                condition::Quantity::Missing => statistics.missing as f64,
                condition::Quantity::Change => change,
                condition::Quantity::Size => cost.size_bytes as f64 / 1e3,
                condition::Quantity::Generation => 1e3 * cost.generation.as_secs_f64(),
                condition::Quantity::Quantile(p) => statistics.quantile(p),
            });
            if is_true && !trigger.was_true {
                fired.push(Fired { name: trigger.name.clone(), actions: trigger.actions.clone() });
            }
            trigger.was_true = is_true;
        }
        fired
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamina_model::Voxels;

    fn spec(name: &str, when: &str) -> TriggerSpec {
        TriggerSpec { name: name.into(), when: when.into(), actions: BTreeSet::from([Action::Pause]) }
    }

    #[test]
    fn a_trigger_fires_at_the_step_where_its_condition_becomes_true() {
        let mut triggers = Triggers::new(&[spec("high", "max > 2"), spec("jump", "max > 2 * prev(max)")]).unwrap();
        let mut names = |run: &str, step: u64, value: f64| -> Vec<String> {
            let statistics = Statistics::of(&Voxels::F64(vec![0.0, value]));
            let fired = triggers.evaluate(run, (step, 0.5), &statistics, &Cost::default());
            fired.into_iter().map(|fired| fired.name).collect()
        };
        // The first step has none before it.
        assert_eq!(names("a", 0, 1.0), Vec::<String>::new());
        assert_eq!(names("a", 1, 3.0), ["high", "jump"]);
        assert_eq!(names("a", 2, 5.0), Vec::<String>::new(), "still high, and no jump");
        assert_eq!(names("a", 3, 1.0), Vec::<String>::new());
        assert_eq!(names("a", 4, 1.5), Vec::<String>::new());
        assert_eq!(names("a", 5, 9.0), ["high", "jump"]);
        // Another run begins anew.
        assert_eq!(names("b", 0, 9.0), ["high"]);
    }

    #[test]
    fn change_is_that_of_the_step_before_in_ranges() {
        let mut triggers = Triggers::new(&[spec("moved", "change >= 0.25")]).unwrap();
        let mut fires = |values: Vec<f64>| {
            let statistics = Statistics::of(&Voxels::F64(values));
            !triggers.evaluate("a", (0, 0.0), &statistics, &Cost::default()).is_empty()
        };
        assert!(!fires(vec![0.0, 2.0, 4.0]));
        assert!(!fires(vec![0.5, 2.5, 4.0]), "root mean square 0.41 of 3.5");
        assert!(fires(vec![2.5, 0.5, 4.0]), "1.63 of 3.5");
    }

    #[test]
    fn what_is_no_trigger_is_refused_by_name() {
        let refused = |specs: &[TriggerSpec], word: &str| {
            let error = Triggers::new(specs).err().unwrap();
            assert!(error.to_string().contains(word), "{error} does not say {word}");
        };
        refused(&[spec("a b", "max > 1")], "a b");
        refused(&[spec("a", "max > 1"), spec("a", "min < 0")], "twice");
        refused(&[spec("a", "psnr > 1")], "psnr");
        refused(&[spec("a", "max >")], "\"a\"");
        refused(&vec![spec("a", "max > 1"); MOST + 1], "at most");
    }
}
