//! Rectilinear grids: sample points at uneven positions along each axis, and their values at even ones.

use crate::{Grid, Invalid, Voxels};

/// Positions off an even spacing by less than this part of it are rounding.
const EVEN: f64 = 1e-6;

/// Positions of a grid's sample points along x, y and z, world units, ascending.
#[derive(Debug, Clone, PartialEq)]
pub struct Coordinates([Vec<f64>; 3]);

/// Between which two of an axis's points an even position lies: the first, and how far towards the next, 0 to 1.
type Place = (usize, f64);

impl Coordinates {
    /// Those of sample points at `axes`.
    ///
    /// # Errors
    /// If an axis has no point, or its positions are not finite and ascending.
    pub fn new(axes: [Vec<f64>; 3]) -> Result<Self, Invalid> {
        for (name, positions) in ["x", "y", "z"].into_iter().zip(&axes) {
            let wrong = positions.iter().zip(positions.iter().skip(1)).position(|(a, b)| a >= b);
            if positions.is_empty() || !positions.iter().all(|p| p.is_finite()) {
                let reason = format!("{} positions along {name}; one or more are needed, all finite", positions.len());
                return Err(Invalid::new("coordinates", reason));
            }
            if let Some(n) = wrong {
                let reason = format!(
                    "{} is followed by {} along {name}; positions ascend: hand over axes that descend from their end",
                    positions[n],
                    positions[n + 1]
                );
                return Err(Invalid::new("coordinates", reason));
            }
        }
        Ok(Self(axes))
    }

    /// Along x, y and z.
    pub fn axes(&self) -> &[Vec<f64>; 3] {
        &self.0
    }

    /// The grid of as many points an axis, evenly spaced from the first to the last.
    ///
    /// # Errors
    /// As [`Grid::new`].
    pub fn grid(&self) -> Result<Grid, Invalid> {
        let spacing = self.0.each_ref().map(|positions| match &positions[..] {
            [first, .., last] => (last - first) / (positions.len() - 1) as f64,
            _ => 1.0,
        });
        Grid::new(self.0.each_ref().map(Vec::len), spacing.into(), self.0.each_ref().map(|p| p[0]).into())
    }

    /// True if all points already are where [`Coordinates::grid`] has them.
    pub fn are_even(&self) -> bool {
        (0..3).all(|axis| is_even(&self.places(axis)))
    }

    /// `voxels`, x fastest, at the points of [`Coordinates::grid`]: linear along each axis between the points around one, missing where
    /// one of those is. Double precision stays, all else becomes single.
    pub fn resample(&self, voxels: Voxels) -> Voxels {
        let single = |a: f32, b: f32, t: f64| (f64::from(a) + (f64::from(b) - f64::from(a)) * t) as f32;
        match voxels {
            Voxels::F64(values) => Voxels::F64(self.at_even(values, |a, b, t| a + (b - a) * t)),
            Voxels::F32(values) => Voxels::F32(self.at_even(values, single)),
            other => Voxels::F32(self.at_even((0..other.len()).map(|n| other.get(n) as f32).collect(), single)),
        }
    }

    fn at_even<T: Copy>(&self, mut values: Vec<T>, mix: impl Fn(T, T, f64) -> T) -> Vec<T> {
        // How far neighbors along the axis lie apart.
        let mut stride = 1;
        for axis in 0..3 {
            let (places, points) = (self.places(axis), self.0[axis].len());
            if !is_even(&places) {
                let mut moved = Vec::with_capacity(values.len());
                for block in values.chunks_exact(stride * points) {
                    for &(below, t) in &places {
                        let at = below * stride;
                        let (here, next) = (&block[at..at + stride], block[at..].get(stride..2 * stride));
                        match next.filter(|_| t > 0.0) {
                            None => moved.extend_from_slice(here),
                            Some(next) if t >= 1.0 => moved.extend_from_slice(next),
                            Some(next) => moved.extend(here.iter().zip(next).map(|(&a, &b)| mix(a, b, t))),
                        }
                    }
                }
                values = moved;
            }
            stride *= points;
        }
        values
    }

    /// Where the even positions of an axis lie.
    fn places(&self, axis: usize) -> Vec<Place> {
        let positions = &self.0[axis];
        let [first, .., last] = positions[..] else { return vec![(0, 0.0)] };
        let parts = (positions.len() - 1) as f64;
        let place = |n: usize| {
            let at = first + (last - first) * (n as f64 / parts);
            let below = (positions.partition_point(|p| *p <= at).max(1) - 1).min(positions.len() - 2);
            let t = (at - positions[below]) / (positions[below + 1] - positions[below]);
            // At a point its value is as it was.
            let t = if t < EVEN {
                0.0
            } else if t > 1.0 - EVEN {
                1.0
            } else {
                t
            };
            if t >= 1.0 && below + 2 < positions.len() { (below + 1, 0.0) } else { (below, t) }
        };
        (0..positions.len()).map(place).collect()
    }
}

/// True if each point of an axis is where it is.
fn is_even(places: &[Place]) -> bool {
    places.iter().enumerate().all(|(n, &(below, t))| below as f64 + t == n as f64)
}

impl Grid {
    /// The positions of its points along x, y and z.
    pub fn coordinates(&self) -> [Vec<f64>; 3] {
        let position = |axis: usize, n: usize| self.origin()[axis] + n as f64 * self.spacing()[axis];
        std::array::from_fn(|axis| (0..self.dims()[axis]).map(|n| position(axis, n)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// Denser towards both ends, as in a channel.
    fn channel(n: usize) -> Vec<f64> {
        (0..n).map(|i| 2.0 + (std::f64::consts::PI * (i as f64 / (n - 1) as f64 - 0.5)).sin()).collect()
    }

    fn axes() -> [Vec<f64>; 3] {
        [channel(9), vec![0.0, 1.0, 1.5, 4.0], vec![-1.0, 0.0, 1.0]]
    }

    fn sampled(axes: &[Vec<f64>; 3], f: impl Fn(f64, f64, f64) -> f64) -> Vec<f64> {
        let [xs, ys, zs] = axes;
        zs.iter().flat_map(|z| ys.iter().flat_map(|y| xs.iter().map(|x| f(*x, *y, *z)))).collect()
    }

    #[test]
    fn what_is_linear_along_each_axis_is_exact_at_even_points() {
        let linear = |x: f64, y: f64, z: f64| 1.0 + x * y - 2.0 * y * z + 3.0 * x * y * z;
        let coordinates = Coordinates::new(axes()).unwrap();
        let grid = coordinates.grid().unwrap();
        assert_eq!((grid.dims(), grid.origin()), ([9, 4, 3], DVec3::new(1.0, 0.0, -1.0)));
        assert!((grid.spacing() - DVec3::new(0.25, 4.0 / 3.0, 1.0)).length() < 1e-12);
        let Voxels::F64(even) = coordinates.resample(Voxels::F64(sampled(&axes(), linear))) else { panic!("type") };
        let expected = sampled(&grid.coordinates(), linear);
        assert_eq!(even.len(), expected.len());
        for (a, b) in even.iter().zip(&expected) {
            assert!((a - b).abs() < 1e-9, "{a}, not {b}");
        }
    }

    #[test]
    fn a_missing_point_is_missing_between_its_neighbors_alone() {
        let coordinates = Coordinates::new([vec![0.0, 1.0, 4.0, 5.0, 6.0, 7.0, 8.0], vec![0.0], vec![3.0]]).unwrap();
        // Even points are 4/3 apart: two lie between 1 and 4, none where the missing one is, at 7.
        let values = Voxels::F32(vec![0.0, 1.0, 4.0, 5.0, 6.0, f32::NAN, 8.0]);
        let Voxels::F32(even) = coordinates.resample(values) else { panic!("another type") };
        let missing: Vec<bool> = even.iter().map(|v| v.is_nan()).collect();
        assert_eq!(missing, [false, false, false, false, false, true, false], "{even:?}");
        let integers = coordinates.resample(Voxels::U8(vec![0, 3, 12, 15, 18, 21, 24]));
        let Voxels::F32(even) = integers else { panic!("another type") };
        assert!(even.iter().enumerate().all(|(n, v)| (v - 4.0 * n as f32).abs() < 1e-5), "{even:?}");
    }

    #[test]
    fn even_points_keep_their_values_and_wrong_ones_are_refused() {
        let even = Grid::new([5, 1, 7], DVec3::new(0.1, 1.0, 1e-3), DVec3::new(1e3, 2.0, -5.0)).unwrap();
        let coordinates = Coordinates::new(even.coordinates()).unwrap();
        assert!(coordinates.are_even() && !Coordinates::new(axes()).unwrap().are_even());
        let values = Voxels::F64((0..35).map(f64::from).collect());
        assert_eq!(coordinates.resample(values.clone()), values);
        for (x, words) in [
            (vec![], "0 positions along x"),
            (vec![0.0, f64::NAN], "finite"),
            (vec![0.0, 2.0, 2.0], "2 is followed by 2 along x"),
            (vec![1.0, 0.0], "descend"),
        ] {
            let refused = Coordinates::new([x, vec![0.0], vec![0.0]]).unwrap_err().to_string();
            assert!(refused.contains(words), "{refused}");
        }
    }
}
