//! Input that cannot be meant: refused where it comes in, by name.

use crate::fields::VolumeFields;
use lamina_model::{GenerationParams, Scene};
use serde::Deserialize;
use std::path::Path;

/// A `[[refused]]` table: parts of a case, the thing that the message names and a part of what it says of it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Refused {
    name: String,
    volume: Option<toml::Table>,
    scene: Option<toml::Table>,
    params: Option<toml::Table>,
    thing: String,
    remedy: String,
}

/// The refusals in a file.
pub(crate) fn read(path: &Path) -> Vec<Refused> {
    let file: toml::Table = std::fs::read_to_string(path).unwrap().parse().unwrap();
    let refused = file.get("refused").and_then(|refused| refused.as_array()).cloned().unwrap_or_default();
    refused.into_iter().map(|r| r.try_into().unwrap_or_else(|e| panic!("{}: {e}", path.display()))).collect()
}

impl Refused {
    /// What is wrong with the refusal; none if it is as it should be.
    pub(crate) fn fault(&self) -> Option<String> {
        let message = match self.message() {
            Ok(()) => return Some(format!("{}: accepted", self.name)),
            Err(message) => message,
        };
        let good = message.contains(&self.thing) && message.contains(&self.remedy);
        (!good).then(|| format!("{}: the message names no {} and {}: {message}", self.name, self.thing, self.remedy))
    }

    fn message(&self) -> Result<(), String> {
        if let Some(volume) = &self.volume {
            let fields: VolumeFields = volume.clone().try_into().unwrap();
            fields.volume().map_err(|e| e.to_string())?;
        }
        if let Some(scene) = &self.scene {
            let scene: Scene = scene.clone().try_into().map_err(|e: toml::de::Error| e.to_string())?;
            scene.check().map_err(|e| e.to_string())?;
        }
        if let Some(params) = &self.params {
            let read: Result<GenerationParams, _> = params.clone().try_into();
            read.map_err(|e: toml::de::Error| e.to_string())?;
        }
        Ok(())
    }
}
