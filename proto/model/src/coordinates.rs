//! Rectilinear grids: sample points at uneven positions along each axis, and their values at even ones.

use crate::{Grid, Invalid, Voxels};
use std::ops::Range;

/// Positions off an even spacing by less than this part of it are rounding.
const EVEN: f64 = 1e-6;

/// Positions of a grid's sample points along x, y and z, world units, ascending.
#[derive(Debug, Clone, PartialEq)]
pub struct Coordinates {
    axes: [Vec<f64>; 3],
    /// Where the even positions of each axis lie; `None` if each point is where it is to be.
    places: [Option<Vec<Place>>; 3],
}

/// Between which two of an axis's points an even position lies: the first, and how far towards the next, 0 to 1.
type Place = (usize, f64);

/// Ascending indexes of points along x, y and z; `None` for those of the part in question.
type Sources = [Option<Vec<usize>>; 3];

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
        let places = axes.each_ref().map(|positions| Some(places(positions)).filter(|places| !is_even(places)));
        Ok(Self { axes, places })
    }

    /// Along x, y and z.
    pub fn axes(&self) -> &[Vec<f64>; 3] {
        &self.axes
    }

    /// The grid of as many points an axis, evenly spaced from the first to the last.
    ///
    /// # Errors
    /// As [`Grid::new`].
    pub fn grid(&self) -> Result<Grid, Invalid> {
        let spacing = self.axes.each_ref().map(|positions| match &positions[..] {
            [first, .., last] => (last - first) / (positions.len() - 1) as f64,
            _ => 1.0,
        });
        Grid::new(self.axes.each_ref().map(Vec::len), spacing.into(), self.axes.each_ref().map(|p| p[0]).into())
    }

    /// True if all points already are where [`Coordinates::grid`] has them.
    pub fn are_even(&self) -> bool {
        self.places.iter().all(Option::is_none)
    }

    /// `voxels`, x fastest, at the points of [`Coordinates::grid`]: linear along each axis between the points around one, missing where
    /// one of those is. Double precision stays, all else becomes single.
    pub fn resample(&self, voxels: Voxels) -> Voxels {
        let whole = self.axes.each_ref().map(|positions| 0..positions.len());
        self.resample_from(voxels, &whole, &whole.clone().map(|of_axis| Some(of_axis.collect())))
    }

    /// The points that the even points `part` are made from: their ascending indexes along x, y and z, at most two for each of `part`;
    /// `None` along an axis that is even already, whose indexes are those of `part`.
    pub fn sources(&self, part: &[Range<usize>; 3]) -> Sources {
        std::array::from_fn(|axis| {
            let places = &self.places[axis].as_ref()?[part[axis].clone()];
            let mut sources: Vec<usize> = Vec::with_capacity(2 * places.len());
            for &(below, t) in places {
                // Places ascend: of two next to each other the first may be known already.
                let first = sources.last().map_or(below, |last| below.max(last + 1));
                sources.extend(first..below + 1 + usize::from(t > 0.0));
            }
            Some(sources)
        })
    }

    /// [`Coordinates::resample`] of the even points `part` alone, from the `voxels` at all combinations of their
    /// [`Coordinates::sources`], x fastest.
    pub fn resample_part(&self, voxels: Voxels, part: &[Range<usize>; 3]) -> Voxels {
        self.resample_from(voxels, part, &self.sources(part))
    }

    /// The even points `part` from the voxels at `sources`.
    fn resample_from(&self, voxels: Voxels, part: &[Range<usize>; 3], sources: &Sources) -> Voxels {
        let single = |a: f32, b: f32, t: f64| (f64::from(a) + (f64::from(b) - f64::from(a)) * t) as f32;
        let from = (part, sources);
        match voxels {
            Voxels::F64(values) => Voxels::F64(self.at_even(values, from, |a, b, t| a + (b - a) * t)),
            Voxels::F32(values) => Voxels::F32(self.at_even(values, from, single)),
            other => Voxels::F32(self.at_even((0..other.len()).map(|n| other.get(n) as f32).collect(), from, single)),
        }
    }

    fn at_even<T: Copy>(
        &self,
        mut values: Vec<T>,
        (part, sources): (&[Range<usize>; 3], &Sources),
        mix: impl Fn(T, T, f64) -> T,
    ) -> Vec<T> {
        // How far neighbors along the axis lie apart.
        let mut stride = 1;
        for axis in 0..3 {
            if let Some(places) = &self.places[axis] {
                let mut moved = Vec::with_capacity(values.len());
                let sources = sources[axis].as_deref().unwrap_or_default();
                let among = |below: usize| sources.partition_point(|source| *source < below);
                let places: Vec<Place> = places[part[axis].clone()].iter().map(|&(b, t)| (among(b), t)).collect();
                for block in values.chunks_exact((stride * sources.len()).max(1)) {
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
            stride *= part[axis].len();
        }
        values
    }
}

/// Where the even positions of an axis lie.
fn places(positions: &[f64]) -> Vec<Place> {
    let [first, .., last] = *positions else { return vec![(0, 0.0)] };
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
    fn parts_resampled_from_the_points_that_they_need_are_those_of_the_whole() {
        // Of x, some points lie between two even ones and are not needed.
        let x = vec![0.0, 1.0, 1.1, 1.2, 1.3, 1.4, 6.0, 7.0, 8.0];
        let z = (0..12).map(f64::from).collect();
        let coordinates = Coordinates::new([x, vec![0.0, 1.0, 1.5, 4.0], z]).unwrap();
        let dims = [9, 4, 12];
        let take = |from: &[f64], [xs, ys, zs]: &[Vec<usize>; 3]| -> Vec<f64> {
            let rows = zs.iter().flat_map(|z| ys.iter().map(move |y| (z * dims[1] + y) * dims[0]));
            rows.flat_map(|row| xs.iter().map(move |x| from[row + x])).collect()
        };
        let values: Vec<f64> = (0..9 * 4 * 12).map(|n| f64::from(n * n % 97)).collect();
        let Voxels::F64(whole) = coordinates.resample(Voxels::F64(values.clone())) else { panic!("type") };
        for part in [[0..9, 0..4, 0..12], [2..5, 1..2, 3..7], [8..9, 3..4, 11..12], [0..1, 0..4, 0..1]] {
            let sources = coordinates.sources(&part);
            let of_x = sources[0].as_ref().unwrap();
            assert!(sources[2].is_none() && of_x.len() <= 2 * part[0].len() && !of_x.contains(&3), "{sources:?}");
            let indexes = |axis: usize| sources[axis].clone().unwrap_or_else(|| part[axis].clone().collect());
            let needed = take(&values, &[0, 1, 2].map(indexes));
            let resampled = coordinates.resample_part(Voxels::F64(needed), &part);
            assert_eq!(resampled, Voxels::F64(take(&whole, &part.map(Iterator::collect))));
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
