//! Light volume: transmittance towards the light and ambient openness, computed once per field and looked up by all kernels.
//!
//! Its grid has half the field's resolution, at most 129 points a side. Transmittance is swept slice by slice away from the
//! light: each point attenuates the interpolated transmittance of the slice before, by the trapezoidal rule. Openness is the
//! mean transmittance over two cells in all 26 directions. Shadows are as soft as the grid is coarse. Isosurfaces and clipped
//! parts cast no shadow.

use super::interpolate::trilinear;
use super::part::GridPart;
use super::part_sums::PartSums;
use glam::DVec3;
use lamina_model::{Grid, Invalid};
use rayon::prelude::*;
use std::ops::Range;

/// The most points per side.
const MAX_POINTS: usize = 129;
/// Tolerance, in cells, by which rounding may place a ray outside the box.
const ROUNDING: f64 = 1e-6;
/// Cells over which openness is measured.
const OCCLUSION_CELLS: i64 = 2;

/// Light on a coarse grid, x fastest.
#[derive(Debug)]
pub struct LightVolume {
    /// Points per side, 2 or more.
    pub dims: [usize; 3],
    /// Scale, then offset, from units of sample points to units of this grid. An axis with one sample point is drawn and lit
    /// from half a spacing before it to half a spacing behind it.
    pub scale: [f64; 3],
    pub offset: [f64; 3],
    /// Transmittance towards the light, if there are shadows.
    pub transmittance: Option<Vec<f32>>,
    /// Openness, if there is ambient occlusion.
    pub openness: Option<Vec<f32>>,
}

/// Extinction on the coarse grid.
struct CoarseGrid {
    dims: [usize; 3],
    spacing: DVec3,
    extinction: Vec<f32>,
}

/// The grid of a light volume: points per side, and scale and offset from units of sample points.
struct LightGrid {
    dims: [usize; 3],
    scale: [f64; 3],
    offset: [f64; 3],
}

impl LightGrid {
    fn of(grid: &Grid) -> Self {
        let dims = grid.dims().map(|n| ((n - 1).div_ceil(2) + 1).clamp(2, MAX_POINTS));
        let scale = std::array::from_fn(|a| (dims[a] - 1) as f64 / (grid.dims()[a] - 1).max(1) as f64);
        let offset = grid.dims().map(|n| if n == 1 { 0.5 } else { 0.0 });
        Self { dims, scale, offset }
    }

    /// Units of sample points in one of this grid.
    fn per_cell(&self) -> DVec3 {
        DVec3::from_array(self.scale.map(f64::recip))
    }
}

/// What `part` of `grid` gives to the mean extinction around the points of the light volume: of eight places a quarter of a cell away
/// from each, those in its own cells. `extinction` gives the part's at an index, per world length, and 0 outside of its cells.
pub(super) fn extinction_sums(grid: &Grid, part: &GridPart, extinction: impl Fn(DVec3) -> f64 + Sync) -> PartSums {
    let light = LightGrid::of(grid);
    let (per_cell, first) = (light.per_cell(), DVec3::from_array(light.offset));
    let most = 1e4 / grid.voxel_length();
    let reached = [0, 1, 2].map(|a| {
        let place = |cell: usize| cell as f64 * light.scale[a] + light.offset[a];
        let Range { start, end } = part.cells()[a].clone();
        // Places beyond the grid's ends are those at its ends.
        let least = if start == 0 { 0 } else { (place(start) - 0.25).floor() as usize };
        let end = if end + 1 >= grid.dims()[a] { light.dims[a] } else { (place(end) + 0.25).ceil() as usize + 1 };
        least..end.min(light.dims[a])
    });
    let (start, dims) = ([0, 1, 2].map(|a| reached[a].start), [0, 1, 2].map(|a| reached[a].len()));
    let mean = |p: DVec3| {
        let place = |n: u32| p + DVec3::from_array([0, 1, 2].map(|a| if n >> a & 1 == 0 { -0.25 } else { 0.25 }));
        (0..8).map(|n| extinction((place(n) - first) * per_cell).min(most)).sum::<f64>() / 8.0
    };
    let begin = DVec3::from_array(start.map(|c| c as f64));
    let point = |n: usize| begin + DVec3::from_array(coordinates(dims, n).map(|c| c as f64));
    let sums = (0..dims.iter().product()).into_par_iter().map(|n| mean(point(n)) as f32).collect();
    PartSums { start, dims, sums, shares: Vec::new() }
}

/// The extinction on the light volume's grid of a field on `grid` whose parts gave these sums.
///
/// # Errors
/// If the sums are of other points.
pub(super) fn added_up(grid: &Grid, sums: &[PartSums]) -> Result<Vec<f32>, Invalid> {
    let dims = LightGrid::of(grid).dims;
    let mut extinction = vec![0.0; dims.iter().product()];
    sums.iter().try_for_each(|part| part.add_to(dims, &mut extinction, &mut Vec::new()))?;
    Ok(extinction)
}

impl LightVolume {
    /// The light volume of a field on `grid` with this `extinction` on its points, with shadows of the light in direction `light` (unit
    /// vector towards it) if one is given, and openness if `occluded`.
    pub fn new(grid: &Grid, light: Option<DVec3>, occluded: bool, extinction: Vec<f32>) -> Self {
        let of_grid = LightGrid::of(grid);
        let spacing = grid.spacing() * of_grid.per_cell();
        let LightGrid { dims, scale, offset } = of_grid;
        let coarse = CoarseGrid { dims, spacing, extinction };
        let open = |n: usize| coarse.openness(coordinates(dims, n));
        let openness = occluded.then(|| (0..coarse.extinction.len()).into_par_iter().map(open).collect());
        let transmittance = light.map(|light| coarse.transmittance(light));
        Self { dims, scale, offset, transmittance, openness }
    }

    /// Interpolates `values`, transmittance or openness, at `index` in units of the field's sample points.
    pub fn at(&self, values: &[f32], index: DVec3) -> f64 {
        let index = index * DVec3::from_array(self.scale) + DVec3::from_array(self.offset);
        trilinear(self.dims, values, index)
    }
}

fn coordinates([nx, ny, _]: [usize; 3], n: usize) -> [i64; 3] {
    [n % nx, n / nx % ny, n / (nx * ny)].map(|c| c as i64)
}

impl CoarseGrid {
    /// Extinction at a point; 0 outside the grid.
    fn at(&self, p: [i64; 3]) -> f64 {
        let inside = (0..3).all(|a| (0..self.dims[a] as i64).contains(&p[a]));
        if inside { f64::from(self.extinction[self.number(p)]) } else { 0.0 }
    }

    fn number(&self, [x, y, z]: [i64; 3]) -> usize {
        (z as usize * self.dims[1] + y as usize) * self.dims[0] + x as usize
    }

    fn openness(&self, p: [i64; 3]) -> f32 {
        let mut sum = 0.0;
        for n in (0..27).filter(|&n| n != 13) {
            let d = [n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1];
            let length = (DVec3::from_array(d.map(|c| c as f64)) * self.spacing).length();
            let depth: f64 = (1..=OCCLUSION_CELLS).map(|k| self.at(std::array::from_fn(|a| p[a] + k * d[a]))).sum();
            sum += (-depth * length).exp();
        }
        (sum / 26.0) as f32
    }

    /// Transmittance, swept across the axis along which light travels fastest.
    fn transmittance(&self, light: DVec3) -> Vec<f32> {
        let cells = light / self.spacing;
        let speed = cells.abs();
        let axis = (0..3).max_by(|&a, &b| speed[a].total_cmp(&speed[b])).unwrap_or(2);
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        // Offset, in cells, from a point to where its light crosses the slice before.
        let back = cells / speed[axis];
        let length = (back * self.spacing).length();
        let [n, columns, rows] = [axis, u, v].map(|a| self.dims[a] as i64);
        let place = |s: i64, i: i64, j: i64| {
            let mut p = [0; 3];
            (p[axis], p[u], p[v]) = (s, i, j);
            p
        };
        let slices: Vec<i64> = if back[axis] > 0.0 { (0..n).rev().collect() } else { (0..n).collect() };
        let mut all = vec![1.0_f32; self.extinction.len()];
        for s in slices.into_iter().skip(1) {
            let before = s + back[axis].signum() as i64;
            let done = &all;
            let through = move |(i, j): (i64, i64)| {
                let (x, y) = (i as f64 + back[u], j as f64 + back[v]);
                // Light that enters through a side of the box is not attenuated.
                let (right, top) = ((columns - 1) as f64, (rows - 1) as f64);
                let outside = x < -ROUNDING || y < -ROUNDING || x > right + ROUNDING || y > top + ROUNDING;
                let (x, y) = (x.clamp(0.0, right), y.clamp(0.0, top));
                let (mut light, mut depth) = (0.0, 0.0);
                let (cx, cy) = (x.floor().min((columns - 2) as f64), y.floor().min((rows - 2) as f64));
                let (wx, wy) = (x - cx, y - cy);
                for (di, dj) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let w = (if di == 0 { 1.0 - wx } else { wx }) * (if dj == 0 { 1.0 - wy } else { wy });
                    if !outside && w > 0.0 {
                        let p = place(before, cx as i64 + di, cy as i64 + dj);
                        light += w * f64::from(done[self.number(p)]);
                        depth += w * self.at(p);
                    }
                }
                if outside {
                    light = 1.0;
                }
                (light * (-0.5 * length * (depth + self.at(place(s, i, j)))).exp()) as f32
            };
            let slice: Vec<f32> =
                (0..columns * rows).into_par_iter().map(|n| through((n % columns, n / columns))).collect();
            for (n, value) in slice.into_iter().enumerate() {
                let p = place(s, n as i64 % columns, n as i64 / columns);
                let number = self.number(p);
                all[number] = value;
            }
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of a homogeneous box lit from above, transmittance is exp(-kappa depth); closed in on all sides, openness is the mean
    /// over directions of exp(-kappa times two cells).
    #[test]
    fn a_homogeneous_box_has_closed_forms() {
        let grid = Grid::new([17, 9, 33], DVec3::new(0.5, 1.0, 0.25), DVec3::ZERO).unwrap();
        let lit = |light, occluded| {
            let sums = extinction_sums(&grid, &GridPart::whole(&grid), |_| 0.3);
            LightVolume::new(&grid, light, occluded, sums.sums)
        };
        let light = lit(Some(DVec3::Z), true);
        for k in 0..=32 {
            let depth = 0.25 * f64::from(32 - k);
            let t = light.at(light.transmittance.as_ref().unwrap(), DVec3::new(8.0, 4.0, f64::from(k)));
            // Linear between points half a unit apart: off by (0.3 / 2)^2 / 8 of the value at most.
            assert!((t / (-0.3 * depth).exp() - 1.0).abs() < 2.9e-3, "{k}: {t}");
        }
        let slanted = lit(Some(DVec3::new(3.0, 0.0, 4.0) / 5.0), false);
        assert!(slanted.openness.is_none());
        let t = slanted.at(slanted.transmittance.as_ref().unwrap(), DVec3::new(0.0, 4.0, 28.0));
        assert!((t - (-0.3 * 1.0 / 0.8_f64).exp()).abs() < 5e-3, "{t}");
        let cell = DVec3::new(1.0, 2.0, 0.5);
        let directions = (0..27)
            .filter(|&n| n != 13)
            .map(|n| DVec3::new((n % 3) as f64 - 1.0, (n / 3 % 3) as f64 - 1.0, (n / 9) as f64 - 1.0));
        let expected = directions.map(|d| (-0.3 * 2.0 * (d * cell).length()).exp()).sum::<f64>() / 26.0;
        let open = light.at(light.openness.as_ref().unwrap(), DVec3::new(8.0, 4.0, 16.0));
        assert!((open - expected).abs() < 1e-6, "{open} {expected}");
    }
}
