//! What people who watch may change of how a run is shown.

use crate::{Camera, Effects, Invalid, Scene, TransferFunction};

/// Another way to show a run; what is not stated stays.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SceneChange {
    /// A field, or an expression over fields.
    pub field: Option<String>,
    /// Where VDIs are generated from.
    pub camera: Option<Camera>,
    /// Colors and opacities of the field that is shown; another field has its own.
    pub transfer: Option<TransferFunction>,
    /// In place of all that are shown but a color field, which is the simulation's. Isosurfaces are of the field that is shown.
    pub effects: Option<Effects>,
}

impl SceneChange {
    /// Passes a change that changes something.
    ///
    /// # Errors
    /// If nothing is stated, or effects are that are not of the field that is shown.
    pub fn check(self) -> Result<Self, Invalid> {
        match &self {
            Self { field: None, camera: None, transfer: None, effects: None } => {
                Err(Invalid::new("change", "states neither a field nor a camera nor a transfer function nor effects"))
            }
            Self { effects: Some(Effects { color_field: Some(_), .. }), .. } => {
                Err(Invalid::new("effects.color_field", "is the simulation's; leave it out"))
            }
            Self { field: Some(_), effects: Some(effects), .. } if !effects.isosurfaces.is_empty() => {
                let reason = "are of the field that is shown; ask for another field first";
                Err(Invalid::new("effects.isosurfaces", reason))
            }
            _ => Ok(self),
        }
    }

    /// This one and then `later`.
    #[must_use]
    pub fn then(self, later: Self) -> Self {
        let (transfer, effects) = match later.field {
            Some(_) => (None, self.effects.map(Effects::of_any_field)),
            None => (self.transfer, self.effects),
        };
        Self {
            field: later.field.or(self.field),
            camera: later.camera.or(self.camera),
            transfer: later.transfer.or(transfer),
            effects: later.effects.or(effects),
        }
    }

    /// `scene`, which is of the same field, with the camera, the colors and the effects stated.
    #[must_use]
    pub fn apply(&self, scene: Scene) -> Scene {
        let transfer = self.transfer.clone().unwrap_or(scene.transfer);
        let effects = match self.effects.clone() {
            Some(effects) => Effects { color_field: scene.effects.color_field, ..effects },
            None => scene.effects,
        };
        Scene { camera: self.camera.unwrap_or(scene.camera), transfer, effects, ..scene }
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
        let effects = self.effects.as_ref().map(|effects| format!("effects: {}", effects.listed()));
        f.write_str(&[field, camera, colors, effects].into_iter().flatten().collect::<Vec<_>>().join("; "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{ColorField, ColorPoint, DepthCue, Isosurface};
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

    #[test]
    fn effects_take_the_place_of_those_shown_and_surfaces_stay_with_their_field() {
        let surface = Isosurface { value: 0.5, color: [1.0; 3], opacity: 1.0 };
        let lit = Effects { light: Some(DVec3::X), shadows: Some(0.5), ..Effects::default() };
        let effects = Effects { isosurfaces: vec![surface, surface], ..lit.clone() };
        let asked = SceneChange { effects: Some(effects.clone()), ..SceneChange::default() };
        assert_eq!(asked.to_string(), "effects: shadows 0.5, isosurfaces 2");
        let off = SceneChange { effects: Some(Effects::default()), ..SceneChange::default() };
        assert_eq!(off.clone().check().unwrap().to_string(), "effects: none");

        let range = ScalarRange::new(0.0, 1.0, Scale::Linear).unwrap();
        let point = crate::ControlPoint { at: 0.5, color: [1.0; 3], opacity: 0.5 };
        let transfer = TransferFunction::new(range, None, vec![point]).unwrap();
        let camera = Camera::new(DVec3::Z, DVec3::ZERO, DVec3::Y, 35.0).unwrap();
        let colors = ColorField { name: "t".into(), range, points: vec![ColorPoint { at: 0.0, color: [1.0; 3] }] };
        let depth_cue = Some(DepthCue { color: [0.0; 3], strength: 0.5 });
        let own = Effects { color_field: Some(colors), depth_cue, ..Effects::default() };
        let scene = Scene { transfer, camera, background: [0.0; 3], step_voxels: 0.5, effects: own.clone() };
        let seen = asked.clone().check().unwrap().apply(scene.clone());
        assert_eq!(seen.effects, Effects { color_field: own.color_field.clone(), ..effects });
        assert_eq!(SceneChange::default().apply(scene.clone()), scene);

        let field = SceneChange { field: Some("p".into()), ..SceneChange::default() };
        assert_eq!(asked.clone().then(field.clone()).effects, Some(lit));
        let refused = |change: SceneChange| change.check().unwrap_err().to_string();
        assert!(refused(SceneChange { field: field.field, ..asked }).contains("ask for another field first"));
        assert!(refused(SceneChange { effects: Some(own), ..off }).contains("color_field"));
    }
}
