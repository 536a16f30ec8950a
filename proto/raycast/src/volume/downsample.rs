//! Downsampling: reduced volumes with fewer sample points over the same box.
//!
//! A new point is a weighted sum of the old ones around it, separably per axis. The weights are Keys' cubic convolution (R. G.
//! Keys, "Cubic Convolution Interpolation for Digital Image Processing", IEEE Trans. ASSP 29, 1981) stretched to the new
//! spacing, so that frequencies above the new grid's limit are averaged out instead of aliased, and noise decreases.

use super::stored::{Scalar, StoredVoxels, for_stored};
use crate::Field;
use glam::DVec3;
use lamina_model::{Grid, Invalid, ReducedVolume, Scene, VolumeParams};
use rayon::prelude::*;

/// Largest distance of a value from the range, in ranges. Values beyond are clamped, so that outliers do not inflate the
/// encoded size.
const FARTHEST: f32 = 8.0;

/// Reduces `field` to at most as many sample points per side as `params` allows. Fields with lighting keep all points, because
/// lighting is measured in voxels.
///
/// # Errors
/// If a reduced volume cannot represent the field: voxels are NaN or infinite, or colors come from a second field.
pub fn reduce(field: &Field, params: &VolumeParams) -> Result<ReducedVolume, Invalid> {
    check_reducible(field)?;
    let (grid, dims) = (field.grid(), field.grid().dims());
    let (scale, offset) = field.unit_from_stored();
    let (least, most) = ends(field);
    let unit = |x: f64| ((scale * x + offset) as f32).clamp(least, most);
    let fewer = if lit(field) { dims } else { reduced_dims(dims, params.longest_side()) };
    let slices = for_stored!(field.stored(), v => shrink_slices(v, |x| unit(x.wide()), dims, fewer));
    let units = shrink_along_z(slices, dims, fewer);
    let spacing = DVec3::from_array(std::array::from_fn(|a| {
        // An axis with one sample point is drawn one spacing thick.
        let intervals = |n: usize| n.max(2) as f64 - 1.0;
        grid.spacing()[a] * intervals(dims[a]) / intervals(fewer[a])
    }));
    let transfer = field.scene().transfer.with_unit_length(field.unit_length());
    let scene = Scene { transfer, ..field.scene().clone() };
    ReducedVolume::new(Grid::new(fewer, spacing, grid.origin())?, scene, *params, units)
}

/// The most sample points per side that a reduced volume of `field` can have; 0 if it cannot be represented.
pub fn most_points(field: &Field) -> u32 {
    check_reducible(field).map_or(0, |()| field.grid().longest_side())
}

fn check_reducible(field: &Field) -> Result<(), Invalid> {
    if !field.grid_part().is_whole() {
        return Err(Invalid::new("representation", "a reduced volume needs the whole field; send VDIs"));
    }
    let reason = match (field.empty_voxels(), &field.scene().effects.color_field) {
        (0, None) => return Ok(()),
        (0, Some(second)) => {
            format!("a reduced volume holds one field, and colors come from \"{}\"; send VDIs", second.name)
        }
        (empty, _) => format!("{empty} voxels are NaN or infinite, which a reduced volume cannot hold; send VDIs"),
    };
    Err(Invalid::new("representation", reason))
}

/// Bounds to which values are clamped.
fn ends(field: &Field) -> (f32, f32) {
    let range = field.scene().transfer.range();
    let surfaces = field.scene().effects.isosurfaces.iter().map(|s| range.unit_from_value(s.value));
    surfaces.fold((-FARTHEST, 1.0 + FARTHEST), |(least, most), s| (least.min(s - 1.0), most.max(s + 1.0)))
}

fn lit(field: &Field) -> bool {
    let effects = &field.scene().effects;
    effects.shading.is_some() || effects.shadows.is_some() || effects.ambient_occlusion.is_some()
}

/// Dimensions of a grid of at most `most` points per side: all sides are scaled by one factor, and sides of two points or more
/// keep at least two.
fn reduced_dims(dims: [usize; 3], most: u32) -> [usize; 3] {
    let longest = dims.into_iter().max().unwrap_or(1);
    let factor = (f64::from(most.max(2)) - 1.0) / (longest.max(2) as f64 - 1.0);
    dims.map(|n| if factor >= 1.0 { n } else { (((n - 1) as f64 * factor).round() as usize + 1).max(n.min(2)) })
}

/// Keys' kernel, a = -1/2.
fn keys(x: f64) -> f64 {
    let x = x.abs();
    if x < 1.0 {
        (1.5 * x - 2.5) * x * x + 1.0
    } else if x < 2.0 {
        ((-0.5 * x + 2.5) * x - 4.0) * x + 2.0
    } else {
        0.0
    }
}

/// For each of `to` points along an axis of `from` points, its first source point and the weights from there on. Beyond an end,
/// values are extrapolated by point reflection at the end, so that ramps stay exact.
fn weights(from: usize, to: usize) -> Vec<(usize, Vec<f32>)> {
    if from == to {
        return (0..to).map(|i| (i, vec![1.0])).collect();
    }
    let (stretch, end) = ((from - 1) as f64 / (to.max(2) - 1) as f64, from as i64 - 1);
    let of = |i: usize| {
        let at = i as f64 * stretch;
        let reached = (at - 2.0 * stretch).ceil() as i64..=(at + 2.0 * stretch).floor() as i64;
        let raw: Vec<(i64, f64)> = reached.map(|k| (k, keys((k as f64 - at) / stretch))).collect();
        let sum: f64 = raw.iter().map(|(_, w)| w).sum();
        let mut whole = vec![0.0; from];
        for (k, w) in raw {
            let nearest = k.clamp(0, end);
            if k == nearest {
                whole[k as usize] += w / sum;
            } else {
                whole[nearest as usize] += 2.0 * w / sum;
                whole[(2 * nearest - k).clamp(0, end) as usize] -= w / sum;
            }
        }
        let first = whole.iter().position(|w| *w != 0.0).unwrap_or(0);
        let last = whole.iter().rposition(|w| *w != 0.0).unwrap_or(0);
        (first, whole[first..=last].iter().map(|w| *w as f32).collect())
    };
    (0..to).map(of).collect()
}

/// Rows filtered at once.
const ROWS: usize = 8;

/// Reduces x and y of `voxels`, a grid of `dims`, to the dimensions `fewer`, and maps scalars by `unit`. Works slice by slice,
/// so that the volume is read once and only the reduced one is written.
fn shrink_slices<V: Scalar>(
    voxels: &[V],
    unit: impl Fn(V) -> f32 + Sync,
    [nx, ny, nz]: [usize; 3],
    [fx, fy, _]: [usize; 3],
) -> Vec<f32> {
    let (along_x, along_y) = (weights(nx, fx), weights(ny, fy));
    let mut out = vec![0.0; fx * fy * nz];
    let init = || (vec![[0.0; ROWS]; nx], vec![0.0; fx * ny]);
    let slices = out.par_chunks_exact_mut(fx * fy).zip(voxels.par_chunks_exact(nx * ny));
    slices.for_each_init(init, |(across, narrow), (out, voxels)| {
        for (rows, narrow) in voxels.chunks(ROWS * nx).zip(narrow.chunks_mut(ROWS * fx)) {
            for (lane, row) in rows.chunks_exact(nx).enumerate() {
                across.iter_mut().zip(row).for_each(|(a, &v)| a[lane] = unit(v));
            }
            for (x, (first, weights)) in along_x.iter().enumerate() {
                let mut sums = [0.0; ROWS];
                for (column, w) in across[*first..].iter().zip(weights) {
                    sums.iter_mut().zip(column).for_each(|(s, v)| *s += w * v);
                }
                narrow[x..].iter_mut().step_by(fx).zip(sums).for_each(|(n, s)| *n = s);
            }
        }
        for (out, (first, weights)) in out.chunks_exact_mut(fx).zip(&along_y) {
            weighted_sum(out, &narrow[first * fx..], weights);
        }
    });
    out
}

/// Reduces z of `values`, whose x and y are reduced already.
fn shrink_along_z(values: Vec<f32>, dims: [usize; 3], fewer: [usize; 3]) -> Vec<f32> {
    if fewer[2] == dims[2] {
        return values;
    }
    let (weights, row) = (weights(dims[2], fewer[2]), fewer[0]);
    let slice = row * fewer[1];
    let mut out = vec![0.0; slice * fewer[2]];
    out.par_chunks_exact_mut(slice).zip(&weights).for_each(|(out, (first, weights))| {
        weighted_sum(out, &values[first * slice..], weights);
    });
    out
}

/// Weighted sum of the consecutive runs of `values`, each as long as `out`.
fn weighted_sum(out: &mut [f32], values: &[f32], weights: &[f32]) {
    out.fill(0.0);
    for (values, w) in values.chunks_exact(out.len()).zip(weights) {
        out.iter_mut().zip(values).for_each(|(o, v)| *o += w * v);
    }
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
    fn nothing_is_a_value_it_does_not_have() {
        let f = field([4, 4, 4], |[x, ..]| if x == 1.0 { f64::NAN } else { 1e30 * x });
        assert_eq!(reduce(&f, &params(4)).unwrap_err().thing, "representation");
        let f = field([4, 4, 4], |[x, ..]| 1e9 * (x - 1.0));
        let units = reduce(&f, &params(4)).unwrap().units().to_vec();
        assert_eq!(units[..4], [-8.0, 0.0, 9.0, 9.0]);
    }
}
