//! The generator-node's configuration file.

use crate::triggers::{Means, Triggers, Webhook};
use lamina_codec::{Codec, EncodeOptions, ErrorMeasure, Layout};
use lamina_compute::CpuLimit;
use lamina_compute::gpu::Choice;
use lamina_model::{GenerationParams, Invalid, SamplePlan, Scene, Segmentation, TriggerSpec};
use lamina_rpc::daemon::check_log;
use serde::{Deserialize, Serialize};
use std::{net::SocketAddr, path::PathBuf};

/// All keys of the configuration; every one has a default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// What is logged, unless RUST_LOG says it: `error`, `warn`, `info`, `debug` or `trace`.
    pub log: String,
    /// Where simulations, viz-nodes and the tuner connect.
    pub listen: SocketAddr,
    /// Folder of keys that `lamina keys` made, with which others than the own user on this host may connect.
    pub credentials: Option<PathBuf>,
    /// Everybody who reaches the address may use the node.
    pub insecure: bool,
    /// Bytes for time steps: those that arrive, wait, and are worked on. Decides admission.
    pub memory_bytes: u64,
    /// Whether simulations on this host hand their bricks over in memory that both map.
    pub shared_memory: bool,
    /// The most whole time steps that wait for their turn: so many the viewers may be behind.
    pub waiting_steps: u32,
    /// Bytes of encoded frames kept for viz-nodes that connect late or again.
    pub history_bytes: u64,
    /// Seconds without a push after which another run may take the node over.
    pub idle_secs: f64,
    /// Reference samples with every n-th step; 0 never.
    pub reference_every: u64,
    /// Which pixels of which views are reference samples.
    pub samples: SamplePlan,
    /// Batches of them that live steps are compared at, other ones from step to step; 0: all. Trials have all.
    pub live_batches: u32,
    /// Processor time of the node's own: cores (0.5) or percent of the machine's ("25%").
    pub cpu_share: CpuLimit,
    /// Parameters until the tuner sends some; if absent, a small reduced volume, or a VDI where none can stand for a step.
    pub params: Option<GenerationParams>,
    /// What casts the rays: `auto`, `cpu` or `gpu`.
    pub backend: Choice,
    /// How samples become the supersegments of VDIs: `fitted`, or `greedy` as in the paper.
    pub segmentation: Segmentation,
    /// What makes VDIs small: `context-mixing`, `bzip2` or `zstd`.
    pub codec: CodecName,
    /// Byte layout of VDIs: `columns`, or `plain` (the paper's records) for comparison.
    pub layout: LayoutName,
    /// How to show runs that do not say; if absent, chosen from the first step.
    pub scene: Option<Scene>,
    /// Conditions over each step, and what is done at the step where one becomes true.
    pub trigger: Vec<TriggerSpec>,
    /// Folder for the raw steps that triggers ask for.
    pub trigger_folder: PathBuf,
    /// Address that is told of triggers that ask for it; nobody is told without.
    pub webhook: Option<String>,
}

/// A compressor's name in configuration files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CodecName {
    /// bzip2, level 9.
    Bzip2,
    /// Zstandard, level 3.
    Zstd,
    /// Context mixing of neighboring rays.
    ContextMixing,
}

/// A layout's name in configuration files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LayoutName {
    /// Filtered columns.
    Columns,
    /// Interleaved records.
    Plain,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            log: "info".to_owned(),
            listen: SocketAddr::from(([127, 0, 0, 1], 7101)),
            credentials: None,
            insecure: false,
            memory_bytes: 2 << 30,
            shared_memory: true,
            waiting_steps: 32,
            history_bytes: 256 << 20,
            idle_secs: 30.0,
            reference_every: 1,
            samples: SamplePlan::default(),
            live_batches: 2,
            cpu_share: CpuLimit::default(),
            params: None,
            backend: Choice::Auto,
            segmentation: Segmentation::Fitted,
            codec: CodecName::ContextMixing,
            layout: LayoutName::Columns,
            scene: None,
            trigger: Vec::new(),
            trigger_folder: "raw".into(),
            webhook: None,
        }
    }
}

impl Config {
    /// Keys that a running node takes up on SIGHUP.
    pub const LIVE: &[&str] = &[
        "log",
        "memory_bytes",
        "waiting_steps",
        "history_bytes",
        "idle_secs",
        "reference_every",
        "live_batches",
        "cpu_share",
    ];

    /// Passes a configuration that can be run.
    ///
    /// # Errors
    /// Names the first key whose value cannot be used.
    pub fn check(self) -> Result<Self, Invalid> {
        check_log(&self.log)?;
        self.samples.clone().check()?;
        if let Some(scene) = self.scene.clone() {
            scene.check()?;
        }
        if !(self.idle_secs.is_finite() && (0.0..=1e9).contains(&self.idle_secs)) {
            return Err(Invalid::new(
                "idle_secs",
                format!("{} must be a number of seconds, 0 or more", self.idle_secs),
            ));
        }
        if self.memory_bytes < 1 << 20 {
            return Err(Invalid::new(
                "memory_bytes",
                format!("{} is too small for any step; give 1048576 or more", self.memory_bytes),
            ));
        }
        if self.waiting_steps == 0 {
            return Err(Invalid::new("waiting_steps", "0: no step could wait for its turn; give 1 or more"));
        }
        self.encode_options().check()?;
        self.webhook.as_deref().map_or(Ok(()), Webhook::check)?;
        Triggers::new(&self.trigger, self.means(false))?;
        Ok(self)
    }

    /// Whether a group can do what its triggers ask for.
    ///
    /// # Errors
    /// Names the trigger, and what is wrong with it.
    pub fn check_triggers_of_group(&self) -> Result<(), Invalid> {
        Triggers::new(&self.trigger, self.means(true)).map(|_| ())
    }

    /// What the node, or the group that it is of, can do for its triggers.
    pub(crate) fn means(&self, of_group: bool) -> Means {
        Means { of_group, webhook: self.webhook.is_some() }
    }

    /// How VDIs and reduced volumes are encoded.
    pub fn encode_options(&self) -> EncodeOptions {
        EncodeOptions {
            codec: match self.codec {
                CodecName::Bzip2 => Codec::Bzip2,
                CodecName::Zstd => Codec::Zstd,
                CodecName::ContextMixing => Codec::ContextMixing,
            },
            layout: match self.layout {
                LayoutName::Columns => Layout::Columns,
                LayoutName::Plain => Layout::Plain,
            },
            error: ErrorMeasure::MeanSquare,
        }
    }
}
