//! Steering from the page: what the simulation can be asked for, and asking it.

use crate::Config;
use crate::store::{Event, Store};
use crate::subscribe::{OLDER, frames};
use lamina_model::{RunInfo, SceneChange, Steerable, Steering, TriggerChange};
use lamina_rpc::credentials::Credentials;
use lamina_rpc::steering::show_request;
use lamina_rpc::triggers::change_request;
use lamina_rpc::v1;
use parking_lot::Mutex;
use std::sync::Arc;
use tonic::{Code, Status};

/// Between the page and the generator-node, which hands requests on to the simulation.
#[derive(Debug)]
pub(crate) struct SteeringDesk {
    config: Config,
    credentials: Option<Credentials>,
    store: Arc<Store>,
    steerable: Mutex<Steerable>,
}

impl SteeringDesk {
    /// Nobody listens yet; pages are told through `store`.
    pub(crate) fn new(config: Config, credentials: Option<Credentials>, store: Arc<Store>) -> Self {
        Self { config, credentials, store, steerable: Mutex::default() }
    }

    /// What the simulation of the run shown can be asked for.
    pub(crate) fn steerable(&self) -> Steerable {
        let steerable = self.steerable.lock().clone();
        let is_shown = self.store.run().is_some_and(|run| RunInfo::is_same_simulation(&run.id, &steerable.run_id));
        if is_shown { steerable } else { Steerable::default() }
    }

    /// Asks for something; it is on its way to the simulation, and in the run's record, when this returns.
    ///
    /// # Errors
    /// If the simulation takes no requests, or not this one, or the generator-node does not answer.
    pub(crate) async fn ask(&self, steering: Steering) -> Result<(), Status> {
        let run = self.store.run().ok_or_else(|| Status::failed_precondition("no run yet"))?;
        let (words, asked_by) = (steering.request.to_string(), steering.asked_by.clone());
        let request = v1::SteerRequest { run_id: run.id, steering: Some(steering.into()) };
        frames(&self.config, self.credentials.as_ref()).await?.steer(request).await?;
        self.store.record_request(&asked_by, &words);
        Ok(())
    }

    /// Asks the generator-node to show the run otherwise, which is in its record when this returns.
    ///
    /// # Errors
    /// If it cannot be shown so, or the generator-node does not answer.
    pub(crate) async fn show(&self, change: SceneChange, asked_by: String) -> Result<(), Status> {
        let run = self.store.run().ok_or_else(|| Status::failed_precondition("no run yet"))?;
        let request = show_request(run.id, &change, asked_by.clone());
        frames(&self.config, self.credentials.as_ref()).await?.show(request).await?;
        self.store.record_request(&asked_by, &change.to_string());
        Ok(())
    }

    /// Asks the generator-node for a change of its triggers, which is in force for the next step and in the record when this returns.
    ///
    /// # Errors
    /// If the trigger cannot be right, there is none such, or the generator-node takes none or does not answer.
    pub(crate) async fn change_triggers(&self, change: TriggerChange, asked_by: String) -> Result<(), Status> {
        let words = change.to_string();
        let request = change_request(change, asked_by.clone());
        frames(&self.config, self.credentials.as_ref()).await?.change_triggers(request).await?;
        self.store.record_request(&asked_by, &words);
        Ok(())
    }

    /// Follows what can be asked for, until the generator-node is lost.
    pub(crate) async fn follow(&self) -> Result<(), Status> {
        let ended = self.follow_steerable().await;
        self.tell(Steerable::default());
        match ended {
            // A newer one may take its place.
            Err(status) if status.code() == Code::Unimplemented => {
                tokio::time::sleep(OLDER).await;
                Err(Status::unimplemented("this generator-node is older and cannot steer"))
            }
            other => other,
        }
    }

    async fn follow_steerable(&self) -> Result<(), Status> {
        let mut generator = frames(&self.config, self.credentials.as_ref()).await?;
        let mut changes = generator.steerable(v1::SteerableRequest {}).await?.into_inner();
        while let Some(steerable) = changes.message().await? {
            self.tell(steerable.try_into().map_err(|e: lamina_model::Invalid| Status::internal(e.to_string()))?);
        }
        Ok(())
    }

    fn tell(&self, steerable: Steerable) {
        *self.steerable.lock() = steerable;
        self.store.announce(Event::Steerable);
    }
}
