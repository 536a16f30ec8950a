//! Until a run's first study ends, the best of its trials so far is in use, as far as the pixels measured by then tell, once
//! it is better than what was in use before.

use crate::Contract;
use crate::characteristic::choose;
use crate::push::{push, setting};
use crate::status::Status;
use crate::tune::{Row, Study};
use lamina_model::GenerationParams;
use lamina_wire::v1::{self, control_client::ControlClient};
use tokio::sync::watch;
use tonic::transport::Channel;

/// Picks trials to go ahead with.
pub struct Ahead<'a> {
    contract: &'a Contract,
    /// Before the study, which tries it too.
    before: GenerationParams,
    /// What was picked last.
    current: GenerationParams,
    so_far: Study,
    better: watch::Sender<Option<v1::SetParametersRequest>>,
}

impl<'a> Ahead<'a> {
    /// While `in_use` holds; and what it picks, for [`follow`].
    pub fn new(
        contract: &'a Contract,
        in_use: GenerationParams,
    ) -> (Self, watch::Receiver<Option<v1::SetParametersRequest>>) {
        let (better, picked) = watch::channel(None);
        let so_far = Study { step: 0, rows: Vec::new(), best: None };
        (Self { contract, before: in_use, current: in_use, so_far, better }, picked)
    }

    /// Another trial.
    pub fn tried(&mut self, row: &Row) {
        self.so_far.add(row.clone());
        let measured = self.so_far.rows.iter().any(|r| r.params == self.before);
        if !measured || self.so_far.best.is_none() {
            return;
        }
        let Some(chosen) = choose(&self.so_far, self.contract, Some(&self.current)) else { return };
        let params = self.so_far.rows[chosen].params;
        if params != self.current {
            self.current = params;
            self.better.send_replace(Some(setting(&self.so_far, chosen, self.contract)));
        }
    }
}

/// Pushes what is picked, until no more is; returns what was pushed last, and from which step on it holds.
pub async fn follow(
    control: &ControlClient<Channel>,
    status: &Status,
    mut picked: watch::Receiver<Option<v1::SetParametersRequest>>,
) -> Option<(v1::SetParametersRequest, u64)> {
    let mut last = None;
    while picked.changed().await.is_ok() {
        let Some(setting) = picked.borrow_and_update().clone() else { continue };
        match push(control, setting.clone()).await {
            Ok(from) => {
                status.chosen(setting.params.unwrap_or_default());
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
    use crate::trial::{Cost, Measured};
    use lamina_model::{Quality, ViewError};

    #[test]
    fn what_keeps_the_contract_and_is_clearly_better_than_what_is_in_use_goes_ahead() {
        let contract = Contract::size(1000);
        let params = |resolution| GenerationParams::new(resolution, 0.02).unwrap();
        let (mut ahead, mut picked) = Ahead::new(&contract, params(64));
        let mut trial = |resolution, size_bytes, mse| {
            let quality = Quality { views: vec![ViewError { angle_deg: 10.0, batch_mse: vec![mse] }] };
            let measured = Measured { cost: Cost { size_bytes, ..Cost::default() }, quality };
            let cost = contract.cost(&measured);
            ahead.tried(&Row { params: params(resolution), cost, measured });
            let changed = picked.has_changed().unwrap();
            let setting = picked.borrow_and_update().clone();
            setting.filter(|_| changed).map(|s| (s.params.unwrap().resolution, s.limits.unwrap().size_bytes))
        };
        assert_eq!(trial(63, 500, 1e-4), None, "what is in use may be better");
        assert_eq!(trial(64, 900, 1e-3), Some((63, Some(1000))), "it is not");
        assert_eq!(trial(65, 2000, 1e-6), None, "too large");
        assert_eq!(trial(66, 800, 2e-4), None, "worse");
        assert_eq!(trial(67, 800, 0.99e-4), None, "hardly better");
        assert_eq!(trial(68, 1000, 1e-5), Some((68, Some(1000))));
    }
}
