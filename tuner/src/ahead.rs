//! Until a run's first study ends, the best of its trials so far is in use: what is shown meanwhile keeps the contract.

use crate::Contract;
use crate::push::{push, setting};
use crate::tune::{Row, Study};
use lamina_wire::v1::{self, control_client::ControlClient};
use tokio::sync::watch;
use tonic::transport::Channel;

/// Picks trials to go ahead with.
pub struct Ahead<'a> {
    contract: &'a Contract,
    so_far: Study,
    better: watch::Sender<Option<v1::SetParametersRequest>>,
}

impl<'a> Ahead<'a> {
    /// And what it picks, for [`follow`].
    pub fn new(contract: &'a Contract) -> (Self, watch::Receiver<Option<v1::SetParametersRequest>>) {
        let (better, picked) = watch::channel(None);
        (Self { contract, so_far: Study { step: 0, rows: Vec::new(), best: None }, better }, picked)
    }

    /// Another trial.
    pub fn tried(&mut self, row: &Row) {
        let before = self.so_far.best;
        self.so_far.add(row.clone());
        if let Some(best) = self.so_far.best.filter(|_| self.so_far.best != before) {
            self.better.send_replace(Some(setting(&self.so_far, best, self.contract)));
        }
    }
}

/// Pushes what is picked, until no more is; returns what was pushed last, and from which step on it holds.
pub async fn follow(
    control: &ControlClient<Channel>,
    mut picked: watch::Receiver<Option<v1::SetParametersRequest>>,
) -> Option<(v1::SetParametersRequest, u64)> {
    let mut last = None;
    while picked.changed().await.is_ok() {
        let Some(setting) = picked.borrow_and_update().clone() else { continue };
        match push(control, setting.clone()).await {
            Ok(from) => last = Some((setting, from)),
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
    use lamina_model::{GenerationParams, Quality, ViewError};

    #[test]
    fn what_keeps_the_contract_and_is_better_than_all_before_goes_ahead() {
        let contract = Contract::size(1000);
        let (mut ahead, mut picked) = Ahead::new(&contract);
        let mut trial = |resolution, size_bytes, mse| {
            let quality = Quality { views: vec![ViewError { angle_deg: 10.0, batch_mse: vec![mse] }] };
            let measured = Measured { cost: Cost { size_bytes, ..Cost::default() }, quality };
            let (params, cost) = (GenerationParams::new(resolution, 0.02).unwrap(), contract.cost(&measured));
            ahead.tried(&Row { params, cost, measured });
            let changed = picked.has_changed().unwrap();
            let setting = picked.borrow_and_update().clone();
            setting.filter(|_| changed).map(|s| (s.params.unwrap().resolution, s.limits.unwrap().size_bytes))
        };
        assert_eq!(trial(64, 2000, 1e-5), None, "too large");
        assert_eq!(trial(65, 900, 1e-2), Some((65, Some(1000))));
        assert_eq!(trial(66, 800, 2e-2), None, "worse");
        assert_eq!(trial(67, 1000, 1e-3), Some((67, Some(1000))));
    }
}
