//! A transfer function and camera that suit data nobody described.
//!
//! Opacity grows with the distance from the most common value, to both sides, so that surroundings vanish and what
//! differs shows. Ends are percentiles, so that single hot voxels change nothing; data over decades goes by logarithm.

use crate::{
    Aabb, Camera, ColorField, ControlPoint, Effects, Invalid, ScalarRange, Scale, Scene, TransferFunction, VdiParams,
    Volume, Voxels,
};
use glam::DVec3;

/// Values looked at per volume.
const MAX_VALUES: usize = 1 << 18;
/// Optical depth aimed at for the average straight way through the whole volume.
const MEAN_OPTICAL_DEPTH: f64 = 1.0;

/// A scene for volumes of one series: the range holds on all of them.
///
/// # Errors
/// If `volumes` is empty.
pub fn suggest(volumes: &[&Volume]) -> Result<Scene, Invalid> {
    let first = first_of(volumes)?;
    Ok(Scene {
        transfer: suggest_transfer(volumes)?,
        camera: suggest_camera(&first.grid().bounds())?,
        background: [0.0; 3],
        step_voxels: VdiParams::DEFAULT_STEP_VOXELS,
        effects: suggest_effects(volumes)?,
    })
}

/// The first of `volumes`.
///
/// # Errors
/// If there is none.
pub fn first_of<'a>(volumes: &[&'a Volume]) -> Result<&'a Volume, Invalid> {
    volumes.first().copied().ok_or_else(|| Invalid::new("series", "is empty; nothing to choose a scene for"))
}

/// Colors over the range of the second field, where the volumes have one; nothing else.
///
/// # Errors
/// Never for volumes that are there.
pub fn suggest_effects(volumes: &[&Volume]) -> Result<Effects, Invalid> {
    let fields: Vec<(&str, &Voxels)> = volumes.iter().filter_map(|v| v.color_field()).collect();
    let Some(&(name, _)) = fields.first() else { return Ok(Effects::default()) };
    let range = suggest_range(&finite_values(fields.iter().map(|(_, voxels)| *voxels)))?;
    let color_field = ColorField { name: name.to_owned(), range, points: ColorField::cool_to_warm() };
    Ok(Effects { color_field: Some(color_field), ..Effects::default() })
}

/// A camera on +z that sees all of `bounds` from every rotation about +y (35 degrees of view).
///
/// # Errors
/// If the box is too far from the origin for its size.
pub fn suggest_camera(bounds: &Aabb) -> Result<Camera, Invalid> {
    let half = 0.5 * bounds.size();
    let fov_y_deg: f64 = 35.0;
    let (sin, cos) = (0.5 * fov_y_deg.to_radians()).sin_cos();
    // Turning the box sweeps a cylinder: its side must fit the width, its rim the height.
    let radius = half.x.hypot(half.z);
    let distance = (radius / sin).max(radius + half.y * cos / sin);
    Camera::new(bounds.center() + distance * DVec3::Z, bounds.center(), DVec3::Y, fov_y_deg)
}

fn mean_side_voxels(volume: &Volume) -> f64 {
    volume.grid().dims().iter().map(|&d| d as f64).product::<f64>().cbrt()
}

fn finite_values<'a>(volumes: impl Iterator<Item = &'a Voxels>) -> Vec<f64> {
    let mut values = Vec::new();
    for v in volumes {
        // An odd stride does not fall into step with the grid's even sides.
        let stride = (v.len() / MAX_VALUES) | 1;
        values.reserve(v.len().div_ceil(stride));
        values.extend((0..v.len()).step_by(stride).map(|i| v.get(i)).filter(|x| x.is_finite()));
    }
    values.sort_unstable_by(f64::total_cmp);
    values
}

fn percentile(sorted: &[f64], share: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * share).round() as usize]
}

/// A transfer function for volumes of one series.
///
/// # Errors
/// If `volumes` is empty.
pub fn suggest_transfer(volumes: &[&Volume]) -> Result<TransferFunction, Invalid> {
    let side_voxels = mean_side_voxels(first_of(volumes)?);
    let sorted = &finite_values(volumes.iter().map(|v| v.voxels()))[..];
    let range = suggest_range(sorted)?;
    let units: Vec<f64> = sorted.iter().map(|&v| f64::from(range.unit_from_value(v)).clamp(0.0, 1.0)).collect();
    let common = most_common(&units);
    let shape = |strength: f64| -> Vec<ControlPoint> {
        let mut points = Vec::new();
        let mut push = |at: f64, color: [f64; 3], share: f64| {
            points.push(ControlPoint { at: at.clamp(0.0, 1.0), color, opacity: (strength * share).clamp(0.0, 0.95) });
        };
        // Half of the way from the common value to an end stays nearly clear; a side too narrow to show has no points.
        if common > 0.1 {
            push(0.0, [0.62, 0.90, 1.0], 1.0);
            push(0.5 * common, [0.16, 0.45, 0.95], 0.25);
            push(0.85 * common, [0.10, 0.16, 0.55], 0.0);
        }
        push(common, [0.10, 0.10, 0.35], 0.0);
        if common < 0.9 {
            let up = |w: f64| common + w * (1.0 - common);
            push(up(0.15), [0.20, 0.10, 0.45], 0.0);
            push(up(0.5), [0.86, 0.27, 0.22], 0.25);
            push(up(0.8), [0.99, 0.72, 0.25], 0.6);
            push(1.0, [1.0, 0.97, 0.82], 1.0);
        }
        points
    };
    // Choose the strength for which the mean extinction along the volume's side gives the optical depth aimed at.
    let mean_opacity = |strength: f64| {
        let tf = TransferFunction::new(range, None, shape(strength))?;
        let sum: f64 = units.iter().map(|&u| tf.at(u as f32).1).sum();
        Ok::<f64, Invalid>(sum / units.len() as f64)
    };
    let at_full = mean_opacity(0.5)?;
    let strength = if at_full > 0.0 { 0.5 * MEAN_OPTICAL_DEPTH / (at_full * side_voxels) } else { 0.5 };
    TransferFunction::new(range, None, shape(strength.clamp(0.02, 0.8)))
}

fn suggest_range(sorted: &[f64]) -> Result<ScalarRange, Invalid> {
    let Some((&min, &max)) = sorted.first().zip(sorted.last()) else {
        return ScalarRange::new(0.0, 1.0, Scale::Linear);
    };
    let (mut lo, mut hi) = (percentile(sorted, 0.001), percentile(sorted, 0.999));
    if lo == hi {
        (lo, hi) = (min, max);
    }
    if lo == hi {
        // A constant field: any range around it will do.
        let margin = if lo == 0.0 { 1.0 } else { 0.5 * lo.abs() };
        return ScalarRange::new(lo - margin, hi + margin, Scale::Linear);
    }
    let scale = if lo > 0.0 && hi / lo >= 100.0 { Scale::Log10 } else { Scale::Linear };
    ScalarRange::new(lo, hi, scale)
}

/// The center of the fullest of 128 bins.
fn most_common(units: &[f64]) -> f64 {
    const BINS: usize = 128;
    let mut count = [0u32; BINS];
    for &u in units {
        count[((u * BINS as f64) as usize).min(BINS - 1)] += 1;
    }
    let fullest = (0..BINS).max_by_key(|&b| (count[b], BINS - b)).unwrap_or(0);
    // Ends stand for themselves: a field clamped at 0 has its common value at 0, not half a bin above.
    match fullest {
        0 => 0.0,
        b if b == BINS - 1 => 1.0,
        b => (b as f64 + 0.5) / BINS as f64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Grid;

    fn volume(f: impl Fn(usize) -> f32) -> Volume {
        let grid = Grid::new([16; 3], DVec3::ONE, DVec3::ZERO).unwrap();
        Volume::new(grid, Voxels::F32((0..4096).map(f).collect())).unwrap()
    }

    #[test]
    fn one_hot_voxel_does_not_move_the_range_and_decades_turn_it_logarithmic() {
        let s = suggest(&[&volume(|i| if i == 7 { 1e9 } else { (i % 100) as f32 - 50.0 })]).unwrap();
        assert!(s.transfer.range().hi() < 60.0);
        assert_eq!(s.transfer.range().scale(), Scale::Linear);
        let s = suggest(&[&volume(|i| 10f32.powf((i % 41) as f32 / 10.0 - 2.0))]).unwrap();
        assert_eq!(s.transfer.range().scale(), Scale::Log10);
    }

    #[test]
    fn the_most_common_value_is_transparent_and_both_sides_show() {
        let s = suggest(&[&volume(|i| match i % 10 {
            0 => -4.0,
            1 => 3.0,
            _ => 0.0,
        })])
        .unwrap();
        let opacity = |v: f64| s.transfer.at(s.transfer.range().unit_from_value(v)).1;
        assert_eq!(opacity(0.0), 0.0);
        assert!(opacity(-4.0) > 0.01 && opacity(3.0) > 0.01);
    }

    #[test]
    fn a_second_field_gives_the_colors() {
        let v = volume(|i| i as f32);
        let second = Voxels::F32((0..4096).map(|i| 300.0 + i as f32 / 4.096).collect());
        let scene = suggest(&[&v.clone().with_color_field("temperature", second).unwrap()]).unwrap();
        let colors = scene.effects.color_field.as_ref().unwrap();
        assert!(colors.name == "temperature" && colors.range.lo() < 302.0 && colors.range.hi() > 1298.0);
        let other = v.clone().with_color_field("pressure", Voxels::U8(vec![0; 4096])).unwrap();
        assert_eq!(suggest(&[&other]).unwrap().effects.color_field.unwrap().name, "pressure");
        assert!(suggest(&[&v]).unwrap().effects.color_field.is_none());
    }

    #[test]
    fn constant_empty_and_infinite_fields_get_a_scene_too() {
        for f in [0.0, -3.5, f32::NAN, f32::INFINITY, 1e-40] {
            suggest(&[&volume(|_| f)]).unwrap();
        }
        assert!(suggest(&[]).is_err());
    }

    #[test]
    fn the_camera_sees_every_corner_from_every_side() {
        let b = Aabb::new(DVec3::new(0.0, 0.0, 0.0), DVec3::new(4.0, 9.0, 1.0)).unwrap();
        let c = suggest_camera(&b).unwrap();
        for angle in 0..36 {
            let c = c.rotated_about_y(f64::from(angle) * 10.0).unwrap();
            for corner in 0..8 {
                let pick = |axis: usize| if corner >> axis & 1 == 1 { b.max[axis] } else { b.min[axis] };
                let v = c.view_from_world(DVec3::new(pick(0), pick(1), pick(2)));
                let limit = c.tan_half_fov() * v.z * (1.0 + 1e-9);
                assert!(v.z > 0.0 && v.x.abs() <= limit && v.y.abs() <= limit);
            }
        }
    }
}
