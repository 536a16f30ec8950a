//! The tuner's configuration file.

use crate::Contract;
use crate::search::SearchGrid;
use lamina_model::{GenerationParams, Invalid, Representation, VdiParams};
use lamina_rpc::connect::NodeAddress;
use lamina_rpc::daemon::check_log;
use serde::{Deserialize, Serialize};
use std::{net::SocketAddr, path::PathBuf};

/// All keys of the configuration; every one has a default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// What is logged, unless RUST_LOG says it: `error`, `warn`, `info`, `debug` or `trace`.
    pub log: String,
    /// Where the tuner's status can be asked for.
    pub listen: SocketAddr,
    /// Folder of keys that `lamina keys` made, with which others than the own user on this host may connect.
    pub credentials: Option<PathBuf>,
    /// Everybody who reaches the address may use the node.
    pub insecure: bool,
    /// The generator-node; the viz-nodes that measure quality are those that subscribe to it.
    pub generator: String,
    /// What the user wants.
    pub contract: Contract,
    /// What steps may be turned into.
    pub representations: Vec<Representation>,
    /// Parameters of VDIs tried; those of volumes follow from the data.
    pub grid: SearchGrid,
    /// Opacity cut-off of every candidate; 1 is off.
    pub opacity_cutoff: f64,
    /// Sampling step of every candidate, voxels.
    pub step_voxels: f64,
    /// Tune again every n-th step; 0: only when a step is unlike those tuned for, or breaks a limit, or the study for it was cut
    /// short.
    pub retune_every: u64,
    /// The most share of the time that studies after the first may take, 0 to 1; 1 is no limit. None begins a trial that would
    /// probably end later.
    pub budget: f64,
}

/// Passes a contract that can be kept beside a running simulation.
///
/// # Errors
/// If it limits where quality is measured, which the generator-node decides.
pub(crate) fn keepable_live(contract: &Contract) -> Result<(), Invalid> {
    if contract.cone_deg.is_some() {
        let reason = "a cone is a matter of where quality is measured; set samples.angles_deg at the generator-node";
        return Err(Invalid::new("contract", reason));
    }
    Ok(())
}

impl Default for Config {
    fn default() -> Self {
        Self {
            log: "info".to_owned(),
            listen: SocketAddr::from(([127, 0, 0, 1], 7103)),
            credentials: None,
            insecure: false,
            generator: "http://127.0.0.1:7101".to_owned(),
            contract: Contract::default(),
            representations: Representation::ALL.to_vec(),
            grid: SearchGrid::default(),
            opacity_cutoff: 1.0,
            step_voxels: VdiParams::DEFAULT_STEP_VOXELS,
            retune_every: 0,
            budget: 0.05,
        }
    }
}

impl Config {
    /// Keys that a running tuner takes up on SIGHUP.
    pub const LIVE: &[&str] = &["log", "contract", "retune_every", "budget"];

    /// Passes a configuration that can be run.
    ///
    /// # Errors
    /// Names the first key whose value cannot be used.
    pub fn check(self) -> Result<Self, Invalid> {
        self.base()?;
        Ok(self)
    }

    /// Passes a configuration that can be run, with what all candidates have in common.
    ///
    /// # Errors
    /// Names the first key whose value cannot be used.
    pub fn base(&self) -> Result<GenerationParams, Invalid> {
        check_log(&self.log)?;
        NodeAddress::read("generator", &self.generator)?;
        if !(0.0..=1.0).contains(&self.budget) {
            return Err(Invalid::new(
                "budget",
                format!("{} must lie in 0..=1, the share of time for studies", self.budget),
            ));
        }
        keepable_live(&self.contract)?;
        if self.representations.is_empty() {
            return Err(Invalid::new("representations", "none; name vdi, volume or both"));
        }
        let base = VdiParams::new(1, 0.0)?
            .with_opacity_cutoff(self.opacity_cutoff)?
            .with_step_voxels(self.step_voxels)?
            .into();
        let gammas = if self.grid.gamma.is_some() {
            self.grid.candidates(&base)?
        } else {
            self.grid.with_gammas(&base, &[0.0])?
        };
        if gammas.is_empty() {
            return Err(Invalid::new("grid", "holds no parameters"));
        }
        Ok(base)
    }
}
