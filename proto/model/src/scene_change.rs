//! What people who watch may change of how a run is shown.

use crate::{Camera, Invalid, Scene, TransferFunction};

/// Another way to show a run; what is not stated stays.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SceneChange {
    /// A field, or an expression over fields.
    pub field: Option<String>,
    /// Where VDIs are generated from.
    pub camera: Option<Camera>,
    /// Colors and opacities of the field that is shown; another field has its own.
    pub transfer: Option<TransferFunction>,
}

impl SceneChange {
    /// Passes a change that changes something.
    ///
    /// # Errors
    /// If nothing is stated.
    pub fn check(self) -> Result<Self, Invalid> {
        match self {
            Self { field: None, camera: None, transfer: None } => {
                Err(Invalid::new("change", "states neither a field nor a camera nor a transfer function"))
            }
            change => Ok(change),
        }
    }

    /// This one and then `later`.
    #[must_use]
    pub fn then(self, later: Self) -> Self {
        let kept = self.transfer.filter(|_| later.field.is_none());
        Self {
            field: later.field.or(self.field),
            camera: later.camera.or(self.camera),
            transfer: later.transfer.or(kept),
        }
    }

    /// `scene`, which is of the same field, with the camera and the colors stated.
    #[must_use]
    pub fn apply(&self, scene: Scene) -> Scene {
        let transfer = self.transfer.clone().unwrap_or(scene.transfer);
        Scene { camera: self.camera.unwrap_or(scene.camera), transfer, ..scene }
    }
}

impl std::fmt::Display for SceneChange {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let field = self.field.as_ref().map(|field| format!("show {field}"));
        let camera = self.camera.map(|camera| {
            let p = camera.position();
            format!("generate from ({:.4}, {:.4}, {:.4})", p.x, p.y, p.z)
        });
        let colors = self.transfer.as_ref().map(|t| format!("colors of {} points", t.points().len()));
        f.write_str(&[field, camera, colors].into_iter().flatten().collect::<Vec<_>>().join("; "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ScalarRange, Scale};
    use glam::DVec3;

    #[test]
    fn later_changes_take_the_place_of_earlier_ones_and_another_field_has_its_own_colors() {
        let transfer = |hi| {
            let range = ScalarRange::new(0.0, hi, Scale::Linear).unwrap();
            let point = crate::ControlPoint { at: 0.5, color: [1.0; 3], opacity: 0.5 };
            Some(TransferFunction::new(range, None, vec![point]).unwrap())
        };
        let camera = |z| Some(Camera::new(DVec3::new(0.0, 0.0, z), DVec3::ZERO, DVec3::Y, 35.0).unwrap());
        let first = SceneChange { transfer: transfer(1.0), camera: camera(2.0), ..SceneChange::default() };
        let field = SceneChange { field: Some("p".into()), ..SceneChange::default() };
        let both = first.clone().then(field);
        assert_eq!((both.field.as_deref(), both.camera, both.transfer.is_none()), (Some("p"), camera(2.0), true));
        assert_eq!(both.to_string(), "show p; generate from (0.0000, 0.0000, 2.0000)");
        let recolored =
            both.then(SceneChange { transfer: transfer(3.0), camera: camera(5.0), ..SceneChange::default() });
        assert_eq!(
            (recolored.field.as_deref(), recolored.camera, &recolored.transfer),
            (Some("p"), camera(5.0), &transfer(3.0))
        );
        assert!(recolored.to_string().ends_with("; colors of 1 points"));
        assert!(SceneChange::default().check().is_err() && first.check().is_ok());
    }
}
