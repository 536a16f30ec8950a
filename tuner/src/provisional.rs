//! Provisional choice: until a run's first study ends, the best of its trials so far that keeps the contract is in use, as far as
//! the pixels measured by then tell.

use crate::Contract;
use crate::characteristic_steps::choose;
use crate::push::{push, setting};
use crate::remote::Progress;
use crate::status::Status;
use crate::tune::{Study, Trial};
use lamina_model::{GenerationParams, Setting, TuningState};
use lamina_rpc::v1::control_client::ControlClient;
use tokio::sync::watch;
use tonic::transport::Channel;

/// Chooses among the trials so far.
pub(crate) struct ProvisionalChoice<'a> {
    contract: &'a Contract,
    progress: Progress,
    /// Chosen last.
    current: Option<GenerationParams>,
    so_far: Study,
    better: watch::Sender<Option<Chosen>>,
}

/// Parameters to push, and what their trial came to, decibels.
pub(crate) type Chosen = (Setting, f64);

impl<'a> ProvisionalChoice<'a> {
    /// No trial yet; and what it chooses, for [`follow`].
    pub(crate) fn new(contract: &'a Contract, progress: Progress) -> (Self, watch::Receiver<Option<Chosen>>) {
        let (better, chosen) = watch::channel(None);
        let so_far = Study { step: 0, rows: Vec::new(), best: None };
        (Self { contract, progress, current: None, so_far, better }, chosen)
    }

    /// Another trial, or one measured at more pixels.
    pub(crate) fn add(&mut self, row: &Trial) {
        let rows = std::mem::take(&mut self.so_far.rows);
        self.so_far.best = None;
        rows.into_iter().filter(|known| known.params != row.params).for_each(|known| self.so_far.add(known));
        self.so_far.add(row.clone());
        if self.so_far.best.is_none() {
            return;
        }
        let Some(chosen) = choose(&self.so_far, self.contract, self.current.as_ref()) else { return };
        let params = self.so_far.rows[chosen].params;
        self.progress.best(&self.so_far.rows[chosen].measured);
        if self.current != Some(params) {
            self.current = Some(params);
            let setting = setting(&self.so_far, chosen, self.contract, TuningState::Provisional);
            self.better.send_replace(Some((setting, self.so_far.rows[chosen].measured.quality.psnr_db())));
        }
    }
}

/// Pushes what is chosen, until no more is; returns what was pushed last, and from which step on it holds.
pub(crate) async fn follow(
    control: &ControlClient<Channel>,
    status: &Status,
    mut chosen: watch::Receiver<Option<Chosen>>,
) -> Option<(Setting, u64)> {
    let mut last = None;
    while chosen.changed().await.is_ok() {
        let Some((setting, psnr_db)) = chosen.borrow_and_update().clone() else { continue };
        match push(control, &setting).await {
            Ok(from) => {
                status.chosen(setting.params, psnr_db);
                last = Some((setting, from));
            }
            // The study meets the same trouble, and says so.
            Err(error) => tracing::debug!("not pushed: {error}"),
        }
    }
    last
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluator::Measurement;
    use lamina_model::Cost;
    use lamina_model::{Quality, ViewError};

    #[test]
    fn the_first_trial_that_keeps_the_contract_is_in_use_at_once_then_what_is_clearly_better() {
        let contract = Contract::size(1000);
        let params = |resolution| GenerationParams::vdi(resolution, 0.02).unwrap();
        let (mut choice, mut chosen) = ProvisionalChoice::new(&contract, Progress::new(true));
        let mut trial = |resolution, size_bytes, mse| {
            let quality = Quality { views: vec![ViewError { angle_deg: 10.0, batch_mse: vec![mse], ssim: None }] };
            let measured = Measurement { cost: Cost { size_bytes, ..Cost::default() }, quality };
            let cost = contract.cost(&measured);
            choice.add(&Trial { params: params(resolution), cost, measured });
            let changed = chosen.has_changed().unwrap();
            let setting = chosen.borrow_and_update().clone();
            setting.filter(|_| changed).map(|(s, _)| (s.params.unwrap().resolution(), s.tuning))
        };
        let in_use = |resolution| Some((resolution, TuningState::Provisional));
        assert_eq!(trial(62, 1001, 1e-6), None, "too large");
        assert_eq!(trial(63, 500, 1e-4), in_use(63));
        assert_eq!(trial(65, 2000, 1e-6), None, "too large");
        assert_eq!(trial(66, 800, 2e-4), None, "worse");
        assert_eq!(trial(67, 800, 0.99e-4), None, "hardly better");
        assert_eq!(trial(68, 1000, 1e-5), in_use(68));
        // More pixels tell that it is worse.
        assert_eq!(trial(68, 1000, 3e-4), in_use(67));
    }
}
