//! How a reader wants a recorded volume drawn, where that differs from its scene.

use crate::transfer::TransferFunction;
use crate::{ControlPoint, Effects, Invalid, Scene};
use serde::Deserialize;

/// Colors and effects in place of a recorded volume's; what is absent stays as recorded.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Appearance {
    /// Control points of the transfer function, over the recorded range.
    pub points: Option<Vec<ControlPoint>>,
    /// Effects, all of them.
    pub effects: Option<Effects>,
}

impl Appearance {
    /// `recorded`, looking so. What the recorded transfer function leaves transparent stays so: values there were not recorded.
    ///
    /// # Errors
    /// If points or effects are invalid, or an isosurface has a value that was not recorded.
    pub fn applied_to(&self, recorded: &Scene) -> Result<Scene, Invalid> {
        let mut scene = recorded.clone();
        if let Some(points) = &self.points {
            let shown = &recorded.transfer;
            let wished = TransferFunction::new(*shown.range(), shown.stated_unit_length(), points.clone())?;
            scene.transfer = wished.where_shown_by(shown)?;
        }
        if let Some(effects) = &self.effects {
            let range = recorded.transfer.range();
            let free = recorded.transfer.transparent_parts();
            for surface in &effects.isosurfaces {
                let at = range.unit_from_value(surface.value);
                let kept = recorded.effects.isosurfaces.iter().any(|s| s.value == surface.value);
                if !kept && free.iter().any(|[lo, hi]| *lo < at && at < *hi) {
                    let reason = format!("value {} lies where nothing was recorded", surface.value);
                    return Err(Invalid::new("effects.isosurfaces", reason));
                }
            }
            scene.effects = effects.clone();
        }
        scene.check()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Isosurface;
    use crate::{Camera, ScalarRange, Scale};
    use glam::DVec3;

    /// Values from 0 to 10, of which those below 5 are transparent.
    fn recorded() -> Scene {
        let range = ScalarRange::new(0.0, 10.0, Scale::Linear).unwrap();
        let point = |at: f64, opacity: f64| ControlPoint { at, color: [1.0; 3], opacity };
        let transfer = TransferFunction::new(range, None, vec![point(0.5, 0.0), point(1.0, 0.8)]).unwrap();
        let camera = Camera::new(DVec3::Z, DVec3::ZERO, DVec3::Y, 40.0).unwrap();
        Scene { transfer, camera, background: [0.0; 3], step_voxels: 0.5, effects: Effects::default() }
    }

    fn surface_at(value: f64) -> Effects {
        let surface = Isosurface { value, color: [1.0; 3], opacity: 1.0 };
        Effects { isosurfaces: vec![surface], ..Effects::default() }
    }

    #[test]
    fn nothing_asked_for_changes_nothing() {
        assert_eq!(Appearance::default().applied_to(&recorded()).unwrap(), recorded());
    }

    #[test]
    fn surfaces_lie_where_values_were_recorded() {
        let seen = |value: f64| Appearance { effects: Some(surface_at(value)), points: None };
        assert_eq!(seen(7.0).applied_to(&recorded()).unwrap().effects, surface_at(7.0));
        assert!(seen(3.0).applied_to(&recorded()).unwrap_err().to_string().contains("value 3"));
        // A surface that the scene has was recorded wherever it is.
        let with_surface = Scene { effects: surface_at(3.0), ..recorded() };
        assert_eq!(seen(3.0).applied_to(&with_surface).unwrap(), with_surface);
    }

    #[test]
    fn effects_that_cannot_be_drawn_are_refused_by_name() {
        let unlit = Effects { shadows: Some(0.5), ..Effects::default() };
        let appearance = Appearance { effects: Some(unlit), points: None };
        assert!(appearance.applied_to(&recorded()).unwrap_err().to_string().contains("effects.light"));
        assert!(serde_json::from_str::<Appearance>(r#"{"fog": 1}"#).unwrap_err().to_string().contains("fog"));
    }
}
