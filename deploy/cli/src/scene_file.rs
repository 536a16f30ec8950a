//! Scene files: what they leave out is chosen to suit the data.

use crate::cli;
use anyhow::Context;
use lamina_model::{Camera, Effects, Invalid, Scene, TransferFunction, VdiParams, Volume, suggest};
use serde::Deserialize;
use std::path::Path;

/// A scene as written by a user; every part may be left out.
#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
struct SceneFile {
    transfer: Option<TransferFunction>,
    camera: Option<Camera>,
    #[serde(default)]
    background: [f32; 3],
    step_voxels: Option<f64>,
    #[serde(default)]
    effects: Effects,
}

fn read(path: &Path) -> anyhow::Result<SceneFile> {
    let text = std::fs::read_to_string(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    toml::from_str(&text).with_context(|| format!("{}: not a scene", path.display()))
}

/// The scene in `file`, where no data is known yet that could complete it.
pub fn whole(file: &Path) -> anyhow::Result<Scene> {
    let SceneFile { transfer, camera, background, step_voxels, effects } = read(file)?;
    let missing = "is to be stated: there is no data yet that it could suit";
    let name = || file.display().to_string();
    let transfer = transfer.with_context(|| format!("{}: [transfer] {missing}", name()))?;
    let camera = camera.with_context(|| format!("{}: camera {missing}", name()))?;
    let step_voxels = step_voxels.unwrap_or(VdiParams::DEFAULT_STEP_VOXELS);
    Scene { transfer, camera, background, step_voxels, effects }.check().with_context(name)
}

/// `scene`, sampled as `--step` says.
pub fn with_step(scene: Scene, input: &cli::Input) -> anyhow::Result<Scene> {
    Ok(Scene { step_voxels: input.step.unwrap_or(scene.step_voxels), ..scene }.check()?)
}

/// The scene in `file`, completed for `volumes`, or all of it chosen for them.
pub fn scene_for(file: Option<&Path>, volumes: &[&Volume]) -> anyhow::Result<Scene> {
    let stated = file.map(read).transpose()?.unwrap_or_default();
    let complete = || -> Result<Scene, Invalid> {
        let first = suggest::first_of(volumes)?;
        Scene {
            transfer: stated.transfer.map_or_else(|| suggest::suggest_transfer(volumes), Ok)?,
            camera: stated.camera.map_or_else(|| suggest::suggest_camera(&first.grid().bounds()), Ok)?,
            background: stated.background,
            step_voxels: stated.step_voxels.unwrap_or(VdiParams::DEFAULT_STEP_VOXELS),
            effects: if file.is_some() { stated.effects } else { suggest::suggest_effects(volumes)? },
        }
        .check()
    };
    complete().with_context(|| file.map_or_else(|| "scene".to_owned(), |p| p.display().to_string()))
}
