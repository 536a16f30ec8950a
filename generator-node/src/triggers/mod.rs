//! Triggers: conditions over each step, and what is done at the step where one becomes true.

mod condition;
mod files;
mod statistics;
mod webhook;

pub(crate) use files::{write_copy, write_picture, write_raw};
pub(crate) use statistics::{Moments, Statistics, sample_stride};
pub(crate) use webhook::{Webhook, Word};

use condition::Condition;
use lamina_model::{Cost, Diagnostics, Invalid, TriggerAction, TriggerChange, TriggerSpec};

/// The longest condition, bytes.
const LONGEST: usize = 1000;

struct Trigger {
    spec: TriggerSpec,
    condition: Condition,
    was_true: bool,
}

impl Trigger {
    fn new(spec: &TriggerSpec) -> Result<Self, Invalid> {
        let TriggerSpec { name, when, .. } = spec;
        let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
        if name.is_empty() || name.len() > 60 || !name.chars().all(is_plain) {
            let reason = format!("\"{name}\": a name has 1 to 60 letters, digits, - and _");
            return Err(Invalid::new("trigger.name", reason));
        }
        if when.len() > LONGEST {
            return Err(Invalid::new("trigger.when", format!("\"{name}\": longer than {LONGEST} bytes")));
        }
        spec.check()?;
        let condition = Condition::parse(when);
        let condition = condition.map_err(|e| Invalid::new("trigger.when", format!("\"{name}\": {e}")))?;
        Ok(Self { spec: spec.clone(), condition, was_true: false })
    }
}

/// What a node can do for its triggers.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Means {
    /// It is of a group: no step is in one place, to be kept there.
    pub of_group: bool,
    /// Its configuration states an address to be told.
    pub webhook: bool,
}

/// All triggers of a node, and what they remember of a run.
#[derive(Default)]
pub(crate) struct Triggers {
    triggers: Vec<Trigger>,
    means: Means,
    run_id: String,
    /// Sampled values of the step before, for `change`.
    samples: Vec<f64>,
    /// The newest step of the run.
    newest: u64,
    /// What a viz-node said last of a step of the run.
    measured: Option<Measured>,
}

/// The quality of a step as a viz-node measured it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Measured {
    /// The step.
    pub step: u64,
    /// Decibels.
    pub psnr_db: f64,
    /// It kept the contract's limits.
    pub limit_kept: bool,
}

impl Triggers {
    /// Reads all conditions, of a node with these `means`.
    ///
    /// # Errors
    /// Names the trigger, and what is wrong with it.
    pub(crate) fn new(specs: &[TriggerSpec], means: Means) -> Result<Self, Invalid> {
        let mut triggers = Self { means, ..Self::default() };
        for spec in specs {
            if triggers.names().any(|name| name == spec.name) {
                return Err(Invalid::new("trigger.name", format!("\"{}\" stands twice", spec.name)));
            }
            triggers.set(spec)?;
        }
        Ok(triggers)
    }

    /// Does what somebody asks for; the others remember what they have seen.
    ///
    /// # Errors
    /// The trigger cannot be right, there are too many, or none of that name.
    pub(crate) fn change(&mut self, change: &TriggerChange) -> Result<(), Invalid> {
        match change {
            TriggerChange::Set(spec) => self.set(spec),
            TriggerChange::Remove(name) => {
                let known: Vec<&str> = self.names().collect();
                let unknown = || Invalid::new("trigger", format!("no \"{name}\"; there are: {}", known.join(", ")));
                let at = known.iter().position(|known| known == name).ok_or_else(unknown)?;
                self.triggers.remove(at);
                Ok(())
            }
        }
    }

    /// Adds a trigger, or puts it in place of that of its name.
    fn set(&mut self, spec: &TriggerSpec) -> Result<(), Invalid> {
        let trigger = Trigger::new(spec)?;
        let refused = |reason: &str| Err(Invalid::new("trigger.do", format!("\"{}\": {reason}", spec.name)));
        if self.means.of_group && spec.actions.contains(&TriggerAction::Raw) {
            return refused("a group has no step in one place to keep; leave \"raw\" out, or use one node");
        }
        if !self.means.webhook && spec.actions.contains(&TriggerAction::Webhook) {
            return refused(
                "nobody can be told; state webhook = \"https://HOST/PATH\" in the generator-node's configuration",
            );
        }
        match self.triggers.iter().position(|known| known.spec.name == spec.name) {
            Some(at) => self.triggers[at] = trigger,
            None if self.triggers.len() == TriggerSpec::MOST => {
                return Err(Invalid::new("trigger", format!("there are {}, and no more can be", TriggerSpec::MOST)));
            }
            None => self.triggers.push(trigger),
        }
        Ok(())
    }

    /// True if there are none, and nothing of a step has to be known.
    pub(crate) fn is_empty(&self) -> bool {
        self.triggers.is_empty()
    }

    /// Their names.
    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        self.triggers.iter().map(|trigger| trigger.spec.name.as_str())
    }

    /// As they are stated.
    pub(crate) fn specs(&self) -> Vec<TriggerSpec> {
        self.triggers.iter().map(|trigger| trigger.spec.clone()).collect()
    }

    /// True if a trigger may want the voxels of a step.
    pub(crate) fn wants_voxels(&self) -> bool {
        self.triggers.iter().any(|trigger| trigger.spec.actions.contains(&TriggerAction::Raw))
    }

    /// A viz-node has measured a step of `run_id`. One that is older than what was known is of a slower viz-node; one that is not there yet,
    /// or of no quality, is passed over.
    pub(crate) fn measured(&mut self, run_id: &str, measured: Measured) {
        let can_be = measured.step <= self.newest && !measured.psnr_db.is_nan();
        if can_be && self.run_id == run_id && self.measured.is_none_or(|known| known.step <= measured.step) {
            self.measured = Some(measured);
        }
    }

    /// Those that fire at a step of `run_id` with these `statistics` and `diagnostics`, which cost so much to encode.
    pub(crate) fn evaluate(
        &mut self,
        run_id: &str,
        (step, time): (u64, f64),
        statistics: &Statistics,
        cost: &Cost,
        diagnostics: &Diagnostics,
    ) -> Vec<TriggerSpec> {
        if self.run_id != run_id {
            run_id.clone_into(&mut self.run_id);
            self.samples.clear();
            self.measured = None;
            self.triggers.iter_mut().for_each(|trigger| {
                trigger.condition.forget();
                trigger.was_true = false;
            });
        }
        self.newest = step;
        let change = statistics.change_from(&self.samples);
        self.samples.clone_from(&statistics.samples);
        let (mut fired, measured) = (Vec::new(), self.measured);
        for trigger in &mut self.triggers {
            let is_true = trigger.condition.evaluate(&|quantity| match quantity {
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
                condition::Quantity::Quantile(p) => statistics.quantile(*p),
                condition::Quantity::Psnr => measured.map_or(f64::NAN, |measured| measured.psnr_db),
                condition::Quantity::Kept => measured.map_or(f64::NAN, |measured| f64::from(measured.limit_kept)),
                condition::Quantity::Diagnostic(name) => diagnostics.get(name).unwrap_or(f64::NAN),
            });
            if is_true && !trigger.was_true {
                fired.push(trigger.spec.clone());
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
    use std::collections::BTreeSet;

    fn spec(name: &str, when: &str) -> TriggerSpec {
        let actions = BTreeSet::from([TriggerAction::Pause]);
        TriggerSpec { name: name.into(), when: when.into(), actions, copy_kb: None, angles: Vec::new() }
    }

    #[test]
    fn a_trigger_fires_at_the_step_where_its_condition_becomes_true() {
        let mut triggers =
            Triggers::new(&[spec("high", "max > 2"), spec("jump", "max > 2 * prev(max)")], Means::default()).unwrap();
        let mut names = |run: &str, step: u64, value: f64| -> Vec<String> {
            let statistics = Statistics::of(&Voxels::F64(vec![0.0, value]));
            let fired = triggers.evaluate(run, (step, 0.5), &statistics, &Cost::default(), &Diagnostics::default());
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
    fn a_change_of_one_trigger_leaves_the_others_what_they_remember() {
        let mut triggers =
            Triggers::new(&[spec("high", "max > 2"), spec("jump", "max > 2 * prev(max)")], Means::default()).unwrap();
        let fire = |triggers: &mut Triggers, value: f64| -> Vec<String> {
            let statistics = Statistics::of(&Voxels::F64(vec![0.0, value]));
            let fired = triggers.evaluate("a", (0, 0.0), &statistics, &Cost::default(), &Diagnostics::default());
            fired.into_iter().map(|fired| fired.name).collect()
        };
        assert_eq!(fire(&mut triggers, 3.0), ["high"]);
        triggers.change(&TriggerChange::Set(spec("high", "max > 2.5"))).unwrap();
        triggers.change(&TriggerChange::Set(spec("low", "max < 100"))).unwrap();
        assert_eq!(fire(&mut triggers, 7.0), ["high", "jump", "low"], "a new one is true for the first time");
        triggers.change(&TriggerChange::Remove("jump".into())).unwrap();
        assert_eq!(fire(&mut triggers, 50.0), Vec::<String>::new());
        let before = triggers.specs();
        let refused = |triggers: &mut Triggers, change, word: &str| {
            let error = triggers.change(&change).unwrap_err().to_string();
            assert!(error.contains(word), "{error} does not say {word}");
        };
        refused(&mut triggers, TriggerChange::Remove("jump".into()), "there are: high, low");
        refused(&mut triggers, TriggerChange::Set(spec("high", "max >")), "high");
        assert_eq!(triggers.specs(), before);
    }

    #[test]
    fn what_viewers_measure_is_that_of_the_newest_step_of_the_run() {
        let specs = [spec("coarse", "psnr < 40"), spec("missed", "kept == 0"), spec("better", "psnr > prev(psnr)")];
        let mut triggers = Triggers::new(&specs, Means::default()).unwrap();
        let statistics = Statistics::of(&Voxels::F64(vec![0.0, 1.0]));
        let fire = |triggers: &mut Triggers, run: &str| -> Vec<String> {
            let fired = triggers.evaluate(run, (4, 0.0), &statistics, &Cost::default(), &Diagnostics::default());
            fired.into_iter().map(|fired| fired.name).collect()
        };
        assert_eq!(fire(&mut triggers, "a"), Vec::<String>::new(), "nothing was measured");
        triggers.measured("a", Measured { step: 5, psnr_db: 1.0, limit_kept: false });
        triggers.measured("a", Measured { step: 4, psnr_db: f64::NAN, limit_kept: false });
        triggers.measured("a", Measured { step: 3, psnr_db: 39.0, limit_kept: true });
        triggers.measured("a", Measured { step: 2, psnr_db: 10.0, limit_kept: false });
        triggers.measured("b", Measured { step: 9, psnr_db: 10.0, limit_kept: false });
        assert_eq!(fire(&mut triggers, "a"), ["coarse"]);
        triggers.measured("a", Measured { step: 4, psnr_db: 50.0, limit_kept: false });
        assert_eq!(fire(&mut triggers, "a"), ["missed", "better"]);
        assert_eq!(fire(&mut triggers, "b"), Vec::<String>::new(), "another run begins anew");
    }

    #[test]
    fn change_is_that_of_the_step_before_in_ranges() {
        let mut triggers = Triggers::new(&[spec("moved", "change >= 0.25")], Means::default()).unwrap();
        let mut fires = |values: Vec<f64>| {
            let statistics = Statistics::of(&Voxels::F64(values));
            !triggers.evaluate("a", (0, 0.0), &statistics, &Cost::default(), &Diagnostics::default()).is_empty()
        };
        assert!(!fires(vec![0.0, 2.0, 4.0]));
        assert!(!fires(vec![0.5, 2.5, 4.0]), "root mean square 0.41 of 3.5");
        assert!(fires(vec![2.5, 0.5, 4.0]), "1.63 of 3.5");
    }

    #[test]
    fn what_is_no_trigger_is_refused_by_name() {
        let refused = |specs: &[TriggerSpec], word: &str| {
            let error = Triggers::new(specs, Means::default()).err().unwrap();
            assert!(error.to_string().contains(word), "{error} does not say {word}");
        };
        refused(&[spec("a b", "max > 1")], "a b");
        refused(&[spec("a", "max > 1"), spec("a", "min < 0")], "twice");
        refused(&[spec("a", "ssim > 1")], "ssim");
        refused(&[spec("a", &format!("max > {}1{}", "(".repeat(500), ")".repeat(500)))], "longer than");
        refused(&[spec("a", "max >")], "\"a\"");
        refused(&[TriggerSpec { copy_kb: Some(100), ..spec("a", "max > 1") }], "no copy");
        refused(&[TriggerSpec { angles: vec![0.0], ..spec("a", "max > 1") }], "no picture");
        let picture = TriggerSpec { actions: BTreeSet::from([TriggerAction::Picture]), ..spec("a", "max > 1") };
        refused(&[TriggerSpec { angles: vec![0.0, 361.0], ..picture.clone() }], "361");
        refused(&[TriggerSpec { angles: vec![f64::NAN], ..picture.clone() }], "NaN");
        refused(&[TriggerSpec { angles: vec![0.0; 37], ..picture }], "at most 36");
        let webhook = BTreeSet::from([TriggerAction::Webhook]);
        refused(&[TriggerSpec { actions: webhook, ..spec("a", "max > 1") }], "webhook = ");
        let actions = BTreeSet::from([TriggerAction::Copy]);
        for copy_kb in [None, Some(0)] {
            refused(&[TriggerSpec { actions: actions.clone(), copy_kb, ..spec("a", "max > 1") }], "copy_kb = 5000");
        }
        let many: Vec<_> = (0..=TriggerSpec::MOST).map(|n| spec(&format!("t{n}"), "max > 1")).collect();
        refused(&many, "no more");
    }
}
