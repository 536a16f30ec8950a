//! Downsampling: reduced volumes with fewer sample points over the same box.
//!
//! The weights are Keys' cubic convolution (R. G.
//! Keys, "Cubic Convolution Interpolation for Digital Image Processing", IEEE Trans. ASSP 29, 1981) stretched to the new
//! spacing, so that frequencies above the new grid's limit are averaged out instead of aliased, and noise decreases.

use super::resample::{Taps, keys, shrink, tent, weights};
use super::stored::{Scalar as _, StoredVoxels, for_stored};
use crate::Field;
use glam::DVec3;
use lamina_model::{Grid, Invalid, ReducedVolume, Scene, VolumeParams, inpaint};
use rayon::prelude::*;

/// Largest distance of a value from the range, in ranges.
const FARTHEST: f32 = 8.0;

/// Reduces `field` to at most as many sample points per side as `params` allows. Fields with lighting keep all points, because
/// lighting is measured in voxels.
///
/// Voxels that are NaN or infinite are missing points. Of fewer points those are missing that have less than half of their
/// surroundings; the others are computed from values inpainted where voxels are missing.
///
/// # Errors
/// If a reduced volume cannot represent the field: colors come from a second field.
pub fn reduce(field: &Field, params: &VolumeParams) -> Result<ReducedVolume, Invalid> {
    check_reducible(field.scene())?;
    let (scene, grid) = (field.scene(), field.grid());
    let (dims, fewer) = (grid.dims(), fewer(grid, scene, params));
    let unit = unit_of(field);
    let units = if field.empty_voxels() > 0 && fewer != dims {
        let mut units: Vec<f32> = for_stored!(field.stored(), v => v.par_iter().map(|x| unit(x.wide())).collect());
        let shares = shrink(&units, is_there, dims, &taps(dims, fewer, tent));
        inpaint(&mut units, dims);
        let mut units = shrink(&units, |u| u, dims, &taps(dims, fewer, keys));
        drop_missing(&mut units, &shares);
        units
    } else {
        for_stored!(field.stored(), v => shrink(v, |x| unit(x.wide()), dims, &taps(dims, fewer, keys)))
    };
    reduced(grid, fewer, scene, params, units)
}

/// The reduced volume of `units`, `fewer` points over the box of `grid`.
pub(super) fn reduced(
    grid: &Grid,
    fewer: [usize; 3],
    scene: &Scene,
    params: &VolumeParams,
    units: Vec<f32>,
) -> Result<ReducedVolume, Invalid> {
    let dims = grid.dims();
    let spacing = DVec3::from_array(std::array::from_fn(|a| {
        // An axis with one sample point is drawn one spacing thick.
        let intervals = |n: usize| n.max(2) as f64 - 1.0;
        grid.spacing()[a] * intervals(dims[a]) / intervals(fewer[a])
    }));
    let transfer = scene.transfer.with_unit_length(scene.transfer.unit_length(grid));
    let scene = Scene { transfer, ..scene.clone() };
    ReducedVolume::new(Grid::new(fewer, spacing, grid.origin())?, scene, *params, units)
}

/// The most sample points per side that a reduced volume of `field` can have; 0 if it cannot be represented.
pub fn most_points(field: &Field) -> u32 {
    check_reducible(field.scene()).map_or(0, |()| field.grid().longest_side())
}

/// Refuses a scene that a reduced volume cannot be seen under.
pub(super) fn check_reducible(scene: &Scene) -> Result<(), Invalid> {
    let Some(second) = &scene.effects.color_field else { return Ok(()) };
    let reason = format!("a reduced volume holds one field, and colors come from \"{}\"; send VDIs", second.name);
    Err(Invalid::new("representation", reason))
}

/// Positions in the range of stored values, clamped so that outliers do not inflate the encoded size.
pub(super) fn unit_of(field: &Field) -> impl Fn(f64) -> f32 + Sync {
    let range = field.scene().transfer.range();
    let surfaces = field.scene().effects.isosurfaces.iter().map(|s| range.unit_from_value(s.value));
    let (least, most) =
        surfaces.fold((-FARTHEST, 1.0 + FARTHEST), |(least, most), s| (least.min(s - 1.0), most.max(s + 1.0)));
    let (scale, offset) = field.unit_from_stored();
    move |x| ((scale * x + offset) as f32).clamp(least, most)
}

/// Sample points per axis of the reduced volume of `grid` under `scene`.
pub(super) fn fewer(grid: &Grid, scene: &Scene, params: &VolumeParams) -> [usize; 3] {
    let effects = &scene.effects;
    let is_lit = effects.shading.is_some() || effects.shadows.is_some() || effects.ambient_occlusion.is_some();
    if is_lit { grid.dims() } else { reduced_dims(grid.dims(), params.longest_side()) }
}

/// The taps that take a grid of `dims` to `fewer` points.
pub(super) fn taps(dims: [usize; 3], fewer: [usize; 3], kernel: fn(f64) -> f64) -> [Taps; 3] {
    [0, 1, 2].map(|a| weights(dims[a], fewer[a], kernel))
}

/// Share of a new point's surroundings that has to be there for the point to be: half, less what rounding may take away.
const KEPT: f32 = 0.5 - 1e-4;

/// 1 for a value that is there.
pub(super) fn is_there(unit: f32) -> f32 {
    f32::from(u8::from(!unit.is_nan()))
}

/// NaN where less than [`KEPT`] of the surroundings is there.
pub(super) fn drop_missing(units: &mut [f32], shares: &[f32]) {
    units.iter_mut().zip(shares).filter(|(_, share)| **share < KEPT).for_each(|(unit, _)| *unit = f32::NAN);
}

/// Dimensions of a grid of at most `most` points per side: all sides are scaled by one factor, and sides of two points or more
/// keep at least two.
fn reduced_dims(dims: [usize; 3], most: u32) -> [usize; 3] {
    let longest = dims.into_iter().max().unwrap_or(1);
    let factor = (f64::from(most.max(2)) - 1.0) / (longest.max(2) as f64 - 1.0);
    dims.map(|n| if factor >= 1.0 { n } else { (((n - 1) as f64 * factor).round() as usize + 1).max(n.min(2)) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamina_model::{Camera, ControlPoint, ScalarRange, Scale, TransferFunction, Volume, Voxels};

    fn field(dims: [usize; 3], value: impl Fn([f64; 3]) -> f64) -> Field {
        let grid = Grid::new(dims, DVec3::new(1.0, 2.0, 0.5), DVec3::new(-3.0, 0.0, 7.0)).unwrap();
        let at = |n: usize| [n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]].map(|i| i as f64);
        let voxels = Voxels::F64((0..grid.voxels()).map(|n| value(at(n))).collect());
        let points = vec![
            ControlPoint { at: 0.0, color: [0.0; 3], opacity: 0.0 },
            ControlPoint { at: 1.0, color: [1.0; 3], opacity: 0.5 },
        ];
        let transfer = TransferFunction::new(ScalarRange::new(0.0, 100.0, Scale::Linear).unwrap(), None, points);
        let camera = Camera::new(DVec3::new(0.0, 0.0, 99.0), DVec3::ZERO, DVec3::Y, 30.0).unwrap();
        let scene = Scene {
            transfer: transfer.unwrap(),
            camera,
            background: [0.0; 3],
            step_voxels: 0.5,
            effects: Default::default(),
        };
        Field::new(Volume::new(grid, voxels).unwrap(), &scene)
    }

    fn params(r: u32) -> VolumeParams {
        VolumeParams::new(r, 0.01).unwrap()
    }

    #[test]
    fn the_box_stays_and_the_voxel_that_opacities_refer_to() {
        let f = field([17, 9, 5], |_| 50.0);
        let volume = reduce(&f, &params(9)).unwrap();
        assert_eq!(volume.grid().dims(), [9, 5, 3]);
        assert_eq!(volume.grid().bounds(), f.grid().bounds());
        assert_eq!(volume.scene().transfer.stated_unit_length(), Some(0.5));
        assert!(volume.units().iter().all(|u| (u - 0.5).abs() < 1e-6), "a constant stays");
        // More points than there are: all of them.
        assert_eq!(reduce(&f, &params(500)).unwrap().grid(), f.grid());
        // A slice and a pair stay what they are.
        for (dims, fewer) in
            [([1, 9, 9], [1, 5, 5]), ([9, 1, 9], [5, 1, 5]), ([9, 9, 1], [5, 5, 1]), ([1, 2, 9], [1, 2, 5])]
        {
            let volume = reduce(&field(dims, |_| 50.0), &params(5)).unwrap();
            assert_eq!(volume.grid().dims(), fewer);
            assert!(volume.units().iter().all(|u| (u - 0.5).abs() < 1e-6), "{dims:?}");
        }
        assert_eq!(reduced_dims([1, 2, 100], 10), [1, 2, 10]);
        assert_eq!(reduced_dims([64, 64, 64], 1), [2, 2, 2]);
    }

    #[test]
    fn what_the_new_grid_can_hold_stays_and_what_it_cannot_is_averaged_away() {
        // A parabola inside (Keys' kernel is exact up to squares where it is not cut off, but for the mean of stretching),
        // half the points: within a percent of the range.
        let f = field([33, 33, 33], |[x, y, z]| 0.02 * x * x + 0.5 * y + 1.2 * z);
        let volume = reduce(&f, &params(17)).unwrap();
        for (n, unit) in volume.units().iter().enumerate() {
            let [x, y, z] = [n % 17, n / 17 % 17, n / 289].map(|i| 2.0 * i as f64);
            if [x, y, z].iter().all(|c| (4.0..=28.0).contains(c)) {
                let exact = (0.02 * x * x + 0.5 * y + 1.2 * z) / 100.0;
                assert!((f64::from(*unit) - exact).abs() < 2e-3, "{unit} {exact}");
            }
        }
        // A ramp from end to end, the borders too; the stretched kernel, taken at whole points, is not quite exact.
        let f = field([33, 20, 9], |[x, y, z]| 0.9 * x + 2.0 * y + 1.2 * z);
        let volume = reduce(&f, &params(11)).unwrap();
        assert_eq!(volume.grid().dims(), [11, 7, 4]);
        for (n, unit) in volume.units().iter().enumerate() {
            let [x, y, z] = [n % 11, n / 11 % 7, n / 77].map(|i| i as f64);
            let exact = (0.9 * x * 3.2 + 2.0 * y * 19.0 / 6.0 + 1.2 * z * 8.0 / 3.0) / 100.0;
            assert!((f64::from(*unit) - exact).abs() < 1e-3, "{unit} {exact}");
        }
        // A checkerboard at the old grid's finest: its mean.
        let f = field([33, 33, 33], |[x, y, z]| if (x + y + z) % 2.0 == 0.0 { 100.0 } else { 0.0 });
        let volume = reduce(&f, &params(17)).unwrap();
        let middle = volume.units()[8 + 17 * 8 + 289 * 8];
        assert!((middle - 0.5).abs() < 1e-3, "{middle}");
    }

    #[test]
    fn missing_voxels_stay_missing_and_do_not_show_in_those_that_are_there() {
        // A ramp, with a wall of missing voxels from x = 21 on and one alone.
        let ramp = |[x, y, z]: [f64; 3]| 0.9 * x + 0.5 * y + 0.3 * z;
        let is_missing = |[x, y, z]: [f64; 3]| x >= 21.0 || [x, y, z] == [8.0, 8.0, 8.0];
        let f = field([33, 33, 33], |p| if is_missing(p) { f64::NAN } else { ramp(p) });
        let all = reduce(&f, &params(33)).unwrap();
        assert_eq!(
            all.units().iter().filter(|u| u.is_nan()).count() as u64,
            f.empty_voxels(),
            "all points: as they were"
        );
        let volume = reduce(&f, &params(17)).unwrap();
        for (n, unit) in volume.units().iter().enumerate() {
            let p = [n % 17, n / 17 % 17, n / 289].map(|i| 2.0 * i as f64);
            // The point at 20 has three quarters of what is around it; the one alone is a hole too small to keep.
            assert_eq!(unit.is_nan(), p[0] >= 22.0, "{p:?}: {unit}");
            // Inpainting continues a ramp but roughly.
            let near = if p[0] >= 18.0 { 0.02 } else { 4e-3 };
            assert!(unit.is_nan() || (f64::from(*unit) - ramp(p) / 100.0).abs() < near, "{p:?}: {unit}");
        }
    }

    #[test]
    fn nothing_is_a_value_it_does_not_have() {
        let f = field([4, 4, 4], |[x, ..]| 1e9 * (x - 1.0));
        let units = reduce(&f, &params(4)).unwrap().units().to_vec();
        assert_eq!(units[..4], [-8.0, 0.0, 9.0, 9.0]);
    }
}
