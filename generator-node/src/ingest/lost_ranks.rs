//! Ranks that fall silent while the others go on: steps are completed without their bricks.

use super::assembly::Assembly;
use super::core::Core;
use std::time::Instant;

impl Core {
    /// Completes the steps that lack nothing but bricks of ranks that are lost.
    pub fn give_up_lost(&mut self, run_id: &str, now: Instant) {
        let Ok(run) = self.run(run_id) else { return };
        let known = run.lost.len();
        if run.find_lost(now) {
            self.complete_without_lost(run_id, known, now);
        }
    }

    /// The same of a group's node, when all others are past `step`, of which nothing may have come here.
    pub fn overdue(&mut self, run_id: &str, (step, time): (u64, f64), now: Instant) {
        let Ok(run) = self.run(run_id) else { return };
        let known = run.lost.len();
        if run.find_lost_of_group(step, now) {
            self.begin_step(run_id, step, time);
            self.complete_without_lost(run_id, known, now);
        }
    }

    /// `known` ranks were lost before.
    fn complete_without_lost(&mut self, run_id: &str, known: usize, now: Instant) {
        let Ok(run) = self.run(run_id) else { return };
        let ranks = run.ranks_here();
        if run.lost.len() > known {
            let lost = &run.lost;
            tracing::warn!(run_id, ranks = ?lost, "ranks fell silent while the others went on: their bricks are left out");
        }
        let is_whole = |(_, assembly): &(&u64, &Assembly)| assembly.is_complete(ranks, &run.lost);
        let whole: Vec<u64> = run.steps.iter().filter(is_whole).map(|(step, _)| *step).collect();
        whole.into_iter().for_each(|step| self.complete(run_id, step, now));
    }
}
