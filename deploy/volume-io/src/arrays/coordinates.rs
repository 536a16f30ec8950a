//! Where the points of an axis lie, and what attributes say.

use crate::missing::Packing;
use lamina_model::Voxels;

/// Points along one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Placement {
    /// From `first` on, `spacing` apart; `descends`, if they are stored from the last to the first.
    Even { first: f64, spacing: f64, descends: bool },
    /// Not evenly spaced.
    Uneven,
}

/// By how much of the spacing two neighbors may be nearer or farther.
const EVENNESS: f64 = 1e-3;

impl Placement {
    /// At 0, 1, 2 ..
    pub(super) const UNIT: Self = Self::even_from(0.0, 1.0);

    pub(super) const fn even_from(first: f64, spacing: f64) -> Self {
        Self::Even { first, spacing, descends: false }
    }

    pub(super) fn of(points: &[f64]) -> Self {
        let [first, .., last] = *points else { return Self::even_from(points.first().copied().unwrap_or(0.0), 1.0) };
        let spacing = (last - first) / (points.len() - 1) as f64;
        // Coordinates in single precision are rounded.
        let rounding = 2.0 * f64::from(f32::EPSILON) * first.abs().max(last.abs());
        let is_even = |pair: &[f64]| (pair[1] - pair[0] - spacing).abs() <= EVENNESS * spacing.abs() + rounding;
        if spacing == 0.0 || !spacing.is_finite() || !points.windows(2).all(is_even) {
            return Self::Uneven;
        }
        Self::Even { first: first.min(last), spacing: spacing.abs(), descends: spacing < 0.0 }
    }

    /// The first point and the spacing.
    pub(super) fn even(&self) -> Option<(f64, f64)> {
        match *self {
            Self::Even { first, spacing, .. } => Some((first, spacing)),
            Self::Uneven => None,
        }
    }

    pub(super) fn is_descending(&self) -> bool {
        matches!(self, Self::Even { descends: true, .. })
    }
}

/// Attributes of an array or a group.
pub(super) trait Attributes {
    /// The numbers of an attribute, none if it is absent or text.
    fn numbers(&self, name: &str) -> Vec<f64>;

    fn number(&self, name: &str) -> Option<f64> {
        self.numbers(name).first().copied()
    }

    /// The words of an attribute.
    fn text(&self, name: &str) -> Option<String>;

    /// What stored values stand for.
    fn packing(&self) -> Option<Packing> {
        Packing::new(self.number("scale_factor"), self.number("add_offset"))
    }
}

/// Coordinates as numbers, of those that an array with these attributes holds.
pub(super) fn coordinates(stored: &Voxels, attributes: &dyn Attributes) -> Vec<f64> {
    let packing = attributes.packing();
    let number = |value| packing.map_or(value, |packing| packing.unpacked(value));
    (0..stored.len()).map(|n| number(stored.get(n))).collect()
}

/// The time that attributes state.
pub(super) fn stated_time(attributes: &dyn Attributes) -> Option<f64> {
    ["time", "Time", "TIME"].iter().find_map(|name| attributes.number(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn even_points_are_told_from_uneven_ones() {
        assert_eq!(Placement::of(&[2.0, 2.5, 3.0]), Placement::even_from(2.0, 0.5));
        assert_eq!(Placement::of(&[90.0, 0.0, -90.0]), Placement::Even { first: -90.0, spacing: 90.0, descends: true });
        assert_eq!(Placement::of(&[7.0]), Placement::even_from(7.0, 1.0));
        let northing: Vec<f64> = (0..50).map(|n| f64::from(5e6f32 + 10.0 * n as f32)).collect();
        assert!(Placement::of(&northing).even().is_some());
        for uneven in
            [&[0.0, 1.0, 3.0][..], &[1.0, 1.0], &[0.0, f64::NAN, 2.0], &[0.0, f64::INFINITY], &[0.0, 2.0, 1.0]]
        {
            assert_eq!(Placement::of(uneven), Placement::Uneven, "{uneven:?}");
        }
    }
}
