//! Which parameters hold for which step.

use lamina_model::{GenerationParams, Setting};

/// Settings by the first step they hold for.
pub(crate) struct Schedule {
    settings: Vec<(u64, Setting)>,
    next_step: u64,
}

impl Schedule {
    /// `params` for every step until told otherwise.
    pub(crate) fn new(params: Option<GenerationParams>) -> Self {
        Self { settings: vec![(0, Setting { params, ..Setting::default() })], next_step: 0 }
    }

    /// Gives all settings the limits and the objective of `contract`, and says whether the node is to start with VDIs; returns the step from which
    /// on they hold.
    pub(crate) fn limit(&mut self, contract: &Setting) -> u64 {
        for (_, setting) in &mut self.settings {
            let Setting { limits, objective, only_vdis, .. } = *contract;
            *setting = Setting { limits, objective, only_vdis, ..std::mem::take(setting) };
        }
        self.next_step
    }

    /// Lets `setting` hold from `from_step`, or from the next step if that one is past; says which.
    pub(crate) fn set(&mut self, from_step: u64, setting: Setting) -> u64 {
        let from = from_step.max(self.next_step);
        self.settings.retain(|(first, _)| *first < from);
        self.settings.push((from, setting));
        from
    }

    /// The setting for `step`, which starts now; settings for the past are forgotten.
    pub(crate) fn begin(&mut self, step: u64) -> Setting {
        self.next_step = step + 1;
        let current = self.settings.partition_point(|(first, _)| *first <= step).saturating_sub(1);
        self.settings.drain(..current);
        self.settings[0].1.clone()
    }

    /// A new run counts its steps from the start again: what holds now holds from there.
    pub(crate) fn restart(&mut self) {
        self.settings.drain(..self.settings.len() - 1);
        self.settings[0].0 = 0;
        self.next_step = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamina_model::{Limits, Objective, TuningState};

    fn setting(resolution: u32) -> Setting {
        Setting {
            params: Some(GenerationParams::vdi(resolution, 0.1).unwrap()),
            limits: Limits::default(),
            objective: Objective::Quality,
            only_vdis: false,
            fallbacks: vec![],
            tuning: TuningState::None,
        }
    }

    #[test]
    fn settings_apply_from_their_step_on_and_never_to_the_past() {
        let mut s = Schedule::new(setting(1).params);
        assert_eq!(s.begin(4), setting(1));
        assert_eq!(s.set(0, setting(2)), 5);
        assert_eq!(s.set(9, setting(3)), 9);
        assert_eq!(s.begin(8), setting(2));
        assert_eq!(s.begin(9), setting(3));
        assert_eq!(s.begin(20), setting(3));
        // New limits leave parameters and their steps as they are.
        let limits = Limits { size_bytes: Some(7), ..Default::default() };
        s.set(30, setting(4));
        let objective = Objective::Size;
        assert_eq!(s.limit(&Setting { limits, objective, ..Setting::default() }), 21);
        assert_eq!(s.begin(21), Setting { limits, objective, ..setting(3) });
        assert_eq!(s.begin(30), Setting { limits, objective, ..setting(4) });
        s.set(31, setting(3));
        s.begin(31);
        s.restart();
        assert_eq!(s.begin(0), setting(3));
    }
}
