//! The format of a case. A file holds `[[case]]` tables; each is laid over the file's `[base]`, table by table, so that a
//! case states only what it is about.

use crate::fields::VolumeFields;
use crate::stages::STAGES;
use lamina_model::{Camera, Scene, VdiParams};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;

#[derive(Deserialize, Debug)]
#[serde(deny_unknown_fields)]
pub(crate) struct Case {
    pub name: String,
    pub volume: VolumeFields,
    /// As in a scene file, with all parts stated.
    pub scene: Scene,
    pub resolution: u32,
    pub gamma: f64,
    /// First column and row compared, and the first beyond; the whole picture of r x r pixels if left out.
    pub window: Option<[u32; 4]>,
    /// Cameras beside the scene's.
    #[serde(default)]
    pub novel: Vec<Camera>,
    /// Width and height of the novel cameras' pictures.
    pub picture: [u32; 2],
    pub reference: Reference,
    /// A ray is right if it is right for one displaced by so many pixels to a side: where sides of something sharp are
    /// met, to the last digit.
    #[serde(default)]
    pub displaced: f64,
    /// Whether nothing at all is to be seen from the scene's camera.
    #[serde(default)]
    pub clear: bool,
    /// Whether colors tell little of what is there, so that its optical depth is what is held.
    #[serde(default)]
    pub faint: bool,
    /// Supersegments of the longest list, where they are part of the case.
    pub longest_list: Option<usize>,
    /// By stage. Stages without one are not run.
    pub tolerance: BTreeMap<String, Tolerance>,
    /// Why the tolerances are what they are.
    pub reason: String,
}

/// What a volume's pictures are held to.
#[derive(Deserialize, Debug)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub(crate) enum Reference {
    /// Midpoints of the same steps, in double precision.
    March {},
    /// The same with every step divided.
    Fine(usize),
    /// A box of one color and opacity (per unit length), from the share `low` of each axis to `high`; clear beside it.
    Slab { color: [f64; 3], opacity: f64, low: [f64; 3], high: [f64; 3] },
    /// Opacity growing from 0 at the low end of an axis to `opacity` (per unit length) at its high end.
    Wedge { color: [f64; 3], opacity: f64, axis: usize },
}

/// The greatest error allowed: for all backends, or by kind of backend.
#[derive(Deserialize, Debug, Clone, Copy)]
#[serde(untagged)]
pub(crate) enum Tolerance {
    All(f64),
    Each { scalar: f64, lanes: f64, gpu: f64 },
}

impl Tolerance {
    pub(crate) fn greatest(self) -> f64 {
        match self {
            Self::All(error) => error,
            Self::Each { scalar, lanes, gpu } => scalar.max(lanes).max(gpu),
        }
    }
}

impl Case {
    /// The tolerance of `stage` on `backend`, if the case has that stage.
    pub(crate) fn tolerance(&self, stage: &str, backend: &str) -> Option<f64> {
        Some(match *self.tolerance.get(stage)? {
            Tolerance::All(error) => error,
            Tolerance::Each { gpu, .. } if backend.contains("gpu") => gpu,
            Tolerance::Each { lanes, .. } if backend.contains("lanes") => lanes,
            Tolerance::Each { scalar, .. } => scalar,
        })
    }

    pub(crate) fn params(&self) -> VdiParams {
        let params = VdiParams::new(self.resolution, self.gamma).unwrap();
        params.with_step_voxels(self.scene.step_voxels).unwrap()
    }
}

/// The cases in a file.
pub(crate) fn read(path: &Path) -> Vec<Case> {
    let file: toml::Table = std::fs::read_to_string(path).unwrap().parse().unwrap();
    let base = file.get("base").and_then(|base| base.as_table()).cloned().unwrap_or_default();
    let cases = file.get("case").and_then(|cases| cases.as_array()).cloned().unwrap_or_default();
    let read = |case: toml::Value| {
        let mut whole = base.clone();
        lay_over(&mut whole, case.as_table().unwrap());
        let case: Case = whole.try_into().unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        assert!(!case.reason.is_empty(), "{} has no reason", case.name);
        for stage in case.tolerance.keys() {
            assert!(STAGES.contains(&stage.as_str()), "{}: no stage {stage}", case.name);
        }
        assert!(!case.faint || case.tolerance.contains_key("depth"), "{} holds no depth", case.name);
        case
    };
    cases.into_iter().map(read).collect()
}

fn lay_over(base: &mut toml::Table, over: &toml::Table) {
    // A field or a reference has one name: another one replaces it whole.
    let named = |key: &str| matches!(key, "field" | "reference");
    for (key, value) in over {
        match (base.get_mut(key), value) {
            (Some(toml::Value::Table(below)), toml::Value::Table(above)) if !named(key) => lay_over(below, above),
            _ => {
                base.insert(key.clone(), value.clone());
            }
        }
    }
}
