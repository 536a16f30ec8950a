//! Reduction of a field in parts: each holder of a part sums what its own points give to the reduced volume's, and the sums of all
//! parts are added up.

use super::downsample::{check_reducible, drop_missing, fewer, is_there, reduced, taps, unit_of};
use super::part_sums::PartSums;
use super::resample::{Taps, keys, shrink, tent, within};
use super::stored::{Scalar as _, StoredVoxels, for_stored};
use crate::Field;
use lamina_model::{Grid, Invalid, ReducedVolume, Scene, VolumeParams, inpaint};
use rayon::prelude::*;
use std::ops::Range;

impl PartSums {
    /// The sums of `part`; `is_masked` says that voxels of the whole field are missing.
    ///
    /// # Errors
    /// If a reduced volume cannot represent the field: colors come from a second field.
    pub fn of(part: &Field, params: &VolumeParams, is_masked: bool) -> Result<Self, Invalid> {
        check_reducible(part.scene())?;
        let (grid, stored) = (part.grid(), part.grid_part());
        let (whole, fewer) = (grid.dims(), fewer(grid, part.scene(), params));
        let unit = unit_of(part);
        let mut units: Vec<f32> = for_stored!(part.stored(), v => v.par_iter().map(|x| unit(x.wide())).collect());
        let (is_masked, from) = (is_masked && fewer != whole, stored.dims());
        let own = [0, 1, 2].map(|a| {
            // A cell's points are those at its lower end; the grid's last points belong to its last cells.
            let Range { start, end } = stored.cells()[a].clone();
            let end = if end + 1 >= whole[a] { whole[a] } else { end };
            start - stored.start()[a]..end - stored.start()[a]
        });
        let at_home = [0, 1, 2].map(|a| own[a].start + stored.start()[a]..own[a].end + stored.start()[a]);
        let dims = [0, 1, 2].map(|a| own[a].len());
        let reach = |kernel| {
            let of_whole = taps(whole, fewer, kernel);
            let reached: [(Range<usize>, Taps); 3] = [0, 1, 2].map(|a| within(&of_whole[a], &at_home[a]));
            let boxed = [0, 1, 2].map(|a| reached[a].0.clone());
            (boxed, reached.map(|(_, taps)| taps))
        };
        let (boxed, by_keys) = reach(keys);
        let mut shares = Vec::new();
        if is_masked {
            let (narrow, by_tent) = reach(tent);
            let there = shrink(&cut(&units, from, &own), is_there, dims, &by_tent);
            shares = widened(&there, &narrow, &boxed);
            inpaint(&mut units, from);
        }
        let sums = shrink(&cut(&units, from, &own), |u| u, dims, &by_keys);
        let (start, dims) = ([0, 1, 2].map(|a| boxed[a].start), [0, 1, 2].map(|a| boxed[a].len()));
        Ok(Self { start, dims, sums, shares })
    }
}

/// The points of `own` of a grid of `dims`, x fastest.
fn cut(values: &[f32], [nx, ny, _]: [usize; 3], own: &[Range<usize>; 3]) -> Vec<f32> {
    let rows = own[2].clone().flat_map(|z| own[1].clone().map(move |y| (z * ny + y) * nx));
    rows.flat_map(|row| &values[row + own[0].start..row + own[0].end]).copied().collect()
}

/// `values`, of the points of `narrow`, among those of `wide`, which holds it; 0 elsewhere.
fn widened(values: &[f32], narrow: &[Range<usize>; 3], wide: &[Range<usize>; 3]) -> Vec<f32> {
    let mut out = vec![0.0; wide.iter().map(Range::len).product()];
    let (mut rows, [nx, ny, _]) = (values.chunks_exact(narrow[0].len().max(1)), [0, 1, 2].map(|a| wide[a].len()));
    for z in narrow[2].clone() {
        for y in narrow[1].clone() {
            let at = ((z - wide[2].start) * ny + y - wide[1].start) * nx + narrow[0].start - wide[0].start;
            if let Some(row) = rows.next() {
                out[at..at + row.len()].copy_from_slice(row);
            }
        }
    }
    out
}

/// Adds up what all parts of a field give.
#[derive(Debug)]
pub struct PartReduction {
    fewer: [usize; 3],
    sums: Vec<f32>,
    shares: Vec<f32>,
}

impl PartReduction {
    /// For the field on `grid` under `scene`.
    pub fn new(grid: &Grid, scene: &Scene, params: &VolumeParams) -> Self {
        let fewer = fewer(grid, scene, params);
        Self { fewer, sums: vec![0.0; fewer.iter().product()], shares: Vec::new() }
    }

    /// Adds a part.
    ///
    /// # Errors
    /// If its box does not lie in the reduced volume, or it has other numbers of values.
    pub fn add(&mut self, part: &PartSums) -> Result<(), Invalid> {
        part.add_to(self.fewer, &mut self.sums, &mut self.shares)
    }

    /// The reduced volume of all parts.
    ///
    /// # Errors
    /// If it cannot be seen under `scene`: colors come from a second field.
    pub fn finish(mut self, grid: &Grid, scene: &Scene, params: &VolumeParams) -> Result<ReducedVolume, Invalid> {
        check_reducible(scene)?;
        drop_missing(&mut self.sums, &self.shares);
        reduced(grid, self.fewer, scene, params, self.sums)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{GridPart, reduce};
    use glam::DVec3;
    use lamina_model::{Volume, Voxels, suggest::suggest};

    const DIMS: [usize; 3] = [25, 18, 21];

    fn value([x, y, z]: [usize; 3], with_holes: bool) -> f32 {
        if with_holes && (x > 19 || (y < 4 && z > 12)) {
            return f32::NAN;
        }
        (0.3 * x as f32).sin() + 0.05 * y as f32 + (0.2 * z as f32 + 0.1 * x as f32).cos()
    }

    fn points(start: [usize; 3], dims: [usize; 3], with_holes: bool) -> Volume {
        let grid = Grid::new(dims, DVec3::ONE, DVec3::ZERO).unwrap();
        let values = (0..grid.voxels()).map(|n| {
            let p = [n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]];
            value([0, 1, 2].map(|a| start[a] + p[a]), with_holes)
        });
        Volume::new(grid, Voxels::F32(values.collect())).unwrap()
    }

    #[test]
    fn parts_add_up_to_the_whole() {
        // Slabs, blocks of uneven sizes, and one that is a plane.
        let cut = |n: usize, at: &[usize]| {
            let ends: Vec<usize> = [&[0], at, &[n]].concat();
            ends.windows(2).map(|w| w[0]..w[1]).collect::<Vec<_>>()
        };
        let layouts = [[&[][..], &[], &[7]], [&[9], &[5], &[20]], [&[3, 24], &[], &[1, 2, 11]]];
        for with_holes in [false, true] {
            let whole = points([0; 3], DIMS, with_holes);
            let scene = suggest(&[&whole]).unwrap();
            let (grid, field) = (*whole.grid(), Field::new(whole, &scene));
            for (layout, longest) in layouts.iter().flat_map(|l| [25, 17, 6].map(|longest| (l, longest))) {
                let params = VolumeParams::new(longest, 0.01).unwrap();
                let alone = reduce(&field, &params).unwrap();
                let mut together = PartReduction::new(&grid, &scene, &params);
                let [xs, ys, zs] = [0, 1, 2].map(|a| cut(DIMS[a], layout[a]));
                let mut add = |x: &Range<usize>, y: &Range<usize>, z: &Range<usize>| {
                    let (start, dims) = ([x.start, y.start, z.start], [x.len(), y.len(), z.len()]);
                    let Some(part) = GridPart::of_points(&grid, start, dims, 4).unwrap() else { return };
                    let stored = points(part.start(), part.dims(), with_holes);
                    let part = Field::part(stored, (grid, part), &scene).unwrap();
                    together.add(&PartSums::of(&part, &params, with_holes).unwrap()).unwrap();
                };
                zs.iter().for_each(|z| ys.iter().for_each(|y| xs.iter().for_each(|x| add(x, y, z))));
                let together = together.finish(&grid, &scene, &params).unwrap();
                assert_eq!((together.grid(), together.scene()), (alone.grid(), alone.scene()));
                for (n, (a, b)) in alone.units().iter().zip(together.units()).enumerate() {
                    assert_eq!(a.is_nan(), b.is_nan(), "{layout:?} {longest}: point {n}");
                    // Inpainting sees no farther than a part's ghost points.
                    let near = if with_holes { 0.08 } else { 2e-6 };
                    assert!(a.is_nan() || (a - b).abs() <= near, "{layout:?} {longest}: point {n}: {a} {b}");
                }
            }
        }
    }

    #[test]
    fn sums_of_other_points_are_refused() {
        let whole = points([0; 3], DIMS, false);
        let (grid, scene) = (*whole.grid(), suggest(&[&whole]).unwrap());
        let params = VolumeParams::new(6, 0.01).unwrap();
        let mut all = PartReduction::new(&grid, &scene, &params);
        let sums = |start, dims, count| PartSums { start, dims, sums: vec![0.0; count], shares: Vec::new() };
        for bad in [sums([0; 3], [7, 1, 1], 7), sums([usize::MAX, 0, 0], [1; 3], 1), sums([0; 3], [2; 3], 7)] {
            assert!(all.add(&bad).is_err(), "{bad:?}");
        }
        assert!(all.add(&sums([0; 3], [2; 3], 8)).is_ok());
    }
}
