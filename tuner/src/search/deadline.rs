//! Trials that end in time.

use crate::evaluator::{Batches, Evaluator, Measurement, TrialError};
use lamina_model::{GenerationParams, Invalid};
use tokio::time::{Duration, Instant};

/// Trials until a time.
pub(super) struct Deadline<'a, T> {
    trial: &'a mut T,
    until: Option<Instant>,
    /// The measurement or timing that took longest so far.
    longest: Duration,
    /// There was no time for a trial that was wanted.
    pub cut: bool,
}

impl<'a, T: Evaluator> Deadline<'a, T> {
    /// Those of `trial`, `until` then or without end.
    pub(super) fn new(trial: &'a mut T, until: Option<Instant>) -> Self {
        Self { trial, until, longest: Duration::ZERO, cut: false }
    }

    /// Time there is; `None` without end.
    pub(super) fn left(&self) -> Option<Duration> {
        self.until.map(|until| until.saturating_duration_since(Instant::now()))
    }

    /// What measures.
    pub(super) fn inner(&mut self) -> &mut T {
        self.trial
    }

    /// True if there is time for so many measurements.
    pub(super) fn enough_for(&self, measurements: u32) -> bool {
        self.until.is_none_or(|until| Instant::now() + measurements * self.longest <= until)
    }

    /// Asks for time for another trial: first its cost, then its quality, each as long as what took longest.
    pub(super) fn enough(&mut self) -> bool {
        let enough = self.enough_for(2);
        self.cut |= !enough;
        enough
    }

    /// See [`Evaluator::time`].
    pub(super) async fn time(&mut self, params: &GenerationParams) -> Result<Result<Duration, Invalid>, TrialError> {
        let begun = Instant::now();
        let answer = self.trial.time(params).await;
        self.longest = self.longest.max(begun.elapsed());
        answer
    }

    /// [`Evaluator::evaluate`] of one.
    pub(super) async fn evaluate(
        &mut self,
        params: &GenerationParams,
        batches: Batches,
    ) -> Result<Result<Measurement, Invalid>, TrialError> {
        let begun = Instant::now();
        let answer = self.trial.evaluate(&[*params], batches).await?.pop();
        self.longest = self.longest.max(begun.elapsed());
        Ok(answer.unwrap_or_else(|| Err(Invalid::new("trial", "gave no answer"))))
    }
}
