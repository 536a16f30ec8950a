//! A second field mapped to color.

use crate::corners::{self, Corner};
use crate::{Invalid, ScalarRange};
use serde::{Deserialize, Serialize};

/// Where the colors of a scene come from another field than its opacities: density shows where, temperature in which color.
///
/// The field is interpolated trilinearly like the first, after its range (the logarithm, if that is its scale). Where it is
/// not finite, the transfer function's color stays.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColorField {
    /// The field's name in the run, or of the array in a file.
    pub name: String,
    /// The scalars that map to 0 and 1.
    pub range: ScalarRange,
    /// Corners of the piecewise-linear map, by ascending position; constant beyond the first and last. Without: blue by gray
    /// to red.
    #[serde(default = "ColorField::cool_to_warm")]
    pub points: Vec<ColorPoint>,
}

/// One corner.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColorPoint {
    /// Position in the range, 0..1.
    pub at: f64,
    /// Red, green, blue, each 0..1.
    pub color: [f64; 3],
}

impl Corner<3> for ColorPoint {
    fn at(&self) -> f64 {
        self.at
    }
    fn values(&self) -> [f64; 3] {
        self.color
    }
}

impl ColorField {
    /// The most corners: kernels go through all of them.
    pub const MOST_POINTS: usize = 16;
    /// Corners nearer to each other than this are one in single precision.
    pub const NEAREST_POINTS: f64 = 1e-4;

    /// Blue by light gray to red, equally bright at both ends (Moreland, Diverging Color Maps for Scientific Visualization,
    /// 2009).
    pub fn cool_to_warm() -> Vec<ColorPoint> {
        let point = |at, color| ColorPoint { at, color };
        vec![point(0.0, [0.230, 0.299, 0.754]), point(0.5, [0.865, 0.865, 0.865]), point(1.0, [0.706, 0.016, 0.150])]
    }

    /// Passes a map that can be drawn.
    ///
    /// # Errors
    /// If it has no name, no point or too many, or one out of bounds or order.
    pub fn check(&self) -> Result<(), Invalid> {
        Self::check_name(&self.name)?;
        let bounds = (Self::MOST_POINTS, Self::NEAREST_POINTS);
        corners::check("effects.color_field.points", &self.points, bounds)
    }

    /// Passes a name that a second field may have.
    ///
    /// # Errors
    /// If it is empty or long.
    pub fn check_name(name: &str) -> Result<(), Invalid> {
        let fits = (1..=200).contains(&name.len());
        if fits { Ok(()) } else { Err(Invalid::new("color_field.name", "must have 1 to 200 bytes")) }
    }

    /// The color at position `u` of the range; of a field that has been checked.
    pub fn at(&self, u: f64) -> [f64; 3] {
        corners::interpolate(&self.points, 0, u)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scale;

    fn field(at: &[f64]) -> ColorField {
        let points = at.iter().map(|&at| ColorPoint { at, color: [at, 1.0 - at, 0.5] }).collect();
        ColorField { name: "t".into(), range: ScalarRange::new(0.0, 1.0, Scale::Linear).unwrap(), points }
    }

    #[test]
    fn colors_are_linear_between_corners_and_constant_beyond() {
        field(&[0.3, 0.3001]).check().unwrap();
        let f = field(&[0.25, 0.5, 1.0]);
        f.check().unwrap();
        for (u, red) in [(-1e30, 0.25), (0.25, 0.25), (0.375, 0.375), (0.5, 0.5), (0.875, 0.875), (7.0, 1.0)] {
            assert_eq!(f.at(u), [red, 1.0 - red, 0.5], "{u}");
        }
        assert_eq!(field(&[0.3]).at(0.9), field(&[0.3]).at(0.1));
    }

    #[test]
    fn maps_that_cannot_be_drawn_are_refused_by_name() {
        let thing = |f: ColorField| f.check().unwrap_err().thing;
        assert_eq!(thing(ColorField { name: String::new(), ..field(&[0.0]) }), "color_field.name");
        let many: Vec<f64> = (0..17).map(|n| f64::from(n) / 16.0).collect();
        for at in [&[][..], &many, &[0.5, 0.5], &[0.5, 0.4], &[-0.1], &[f64::NAN]] {
            assert_eq!(thing(field(at)), "effects.color_field.points", "{at:?}");
        }
        let text = r#"{"name": "t", "range": {"lo": 0, "hi": 1, "scale": "linear"}}"#;
        serde_json::from_str::<ColorField>(text).unwrap().check().unwrap();
    }
}
