//! Each leaf of leaf.wgsl, evaluated on the device at the edges of what it takes, against Rust.

use super::open;
use crate::volume::occupancy::BRICK;
use glam::{DVec3, Vec3};
use lamina_compute::gpu::testing;
use lamina_model::composite::opacity_from_optical_depth;
use lamina_model::{Aabb, Ray, vdi};

const PROBE: &str = concat!(include_str!("../../kernel/leaf.wgsl"), include_str!("probe.wgsl"));

/// Leaves by their numbers in probe.wgsl.
#[derive(Clone, Copy)]
enum Leaf {
    Opacity,
    Steps,
    Row,
    Clip,
    Cell,
    Brick,
    Jump,
}

type Case = [[f32; 4]; 4];

fn xyz(v: impl Into<[f32; 3]>) -> [f32; 4] {
    let [x, y, z] = v.into();
    [x, y, z, 0.0]
}

fn x(x: f32) -> Case {
    [[x, 0.0, 0.0, 0.0], [0.0; 4], [0.0; 4], [0.0; 4]]
}

/// The device's answers: two vectors a case. `None` without a device.
fn probe(leaf: Leaf, cases: &[Case]) -> Option<Vec<[[f32; 4]; 2]>> {
    let (gpu, _) = open()?;
    Some(testing::probe(&gpu, PROBE, leaf as u32 as f32, cases))
}

#[test]
fn opacity_keeps_its_digits() {
    let depths = [0.0, 1e-30, 1e-9, 1e-4, 0.03, 0.24999, 0.25, 0.25001, 0.7, 1.0, 16.0, 80.0, 1e4, 3e38];
    let Some(outcomes) = probe(Leaf::Opacity, &depths.map(x)) else { return };
    for (depth, [a, _]) in depths.into_iter().zip(outcomes) {
        let expected = opacity_from_optical_depth(f64::from(depth));
        // Where the series ends, 1 - exp(-t) has lost two bits, and WGSL's exp may be off by 3.5 units in the last place.
        assert!((f64::from(a[0]) - expected).abs() <= 2e-6 * expected, "{depth}: {} for {expected}", a[0]);
    }
}

#[test]
fn steps_are_the_decoders() {
    let lengths = [0.0, 1e-5, 2e-4, 0.5, 0.9999, 1.0, 1.00005, 1.001, 2.0, 63.9, 64.0, 64.01, 1e4, 1048576.0];
    let Some(outcomes) = probe(Leaf::Steps, &lengths.map(x)) else { return };
    for (length, [a, _]) in lengths.into_iter().zip(outcomes) {
        // The kernels pass over rests of up to 1e-4 that the decoder counts: never more steps than it.
        let (least, most) = (vdi::steps((f64::from(length) - 1.1e-4).max(0.0), 1.0), vdi::steps(length.into(), 1.0));
        assert!((least..=most).contains(&(a[0] as u32)), "{length}: {} in {least}..={most}", a[0]);
    }
}

#[test]
fn rows_lie_in_the_table() {
    let bins = 1024.0;
    let below = 1.0_f32.next_down();
    let positions = [-1e37, -1.0, -0.0, 0.0, 1e-6, 0.5, 0.5 - 1e-7, 1023.0 / 1024.0, below, 1.0, 1.5, 3e38];
    for beside in [0, 1] {
        let Some(outcomes) = probe(Leaf::Row, &positions.map(|u| [[u, bins, beside as f32, 0.0]; 4])) else { return };
        for (u, [a, _]) in positions.into_iter().zip(outcomes) {
            let at = (u.clamp(-1.0, 1.0) * bins + beside as f32).max(0.0);
            let row = (at as u32).min(1023 + beside) as f32;
            assert_eq!([a[0], a[1]], [row, at - row], "{u}, {beside} rows below");
        }
    }
}

#[test]
fn rays_are_clipped_as_the_decoder_does() {
    let (low, high) = (Vec3::new(0.0, -0.5, 0.0), Vec3::new(16.0, 0.5, 8.0));
    let rays = [
        ([-5.0, 0.1, 4.0], [1.0, 0.0, 0.0]),
        ([-5.0, 0.5, 4.0], [1.0, 0.0, 0.0]),
        ([-5.0, 0.6, 4.0], [1.0, 0.0, 0.0]),
        ([3.0, 0.0, 4.0], [0.3, 0.01, -0.2]),
        ([3.0, 0.0, 4.0], [-0.3, 1e-20, 0.2]),
        ([20.0, 0.0, 4.0], [1.0, 0.0, 0.0]),
        ([-1.0, -0.5, -1.0], [1.0, 0.0, 1.0]),
        ([0.0, 0.0, 0.0], [0.5, 0.0, 0.25]),
        ([16.0, 0.5, 8.0], [-0.25, -0.004, -0.1]),
        ([-100.0, 3.0, 4.0], [0.9, -0.0268, 0.001]),
    ];
    let cases = rays.map(|(o, d)| [xyz(o), xyz(d), xyz(low), xyz(high)]);
    let Some(outcomes) = probe(Leaf::Clip, &cases) else { return };
    let bounds = Aabb::new(low.as_dvec3(), high.as_dvec3()).unwrap();
    for ((o, d), [a, _]) in rays.into_iter().zip(outcomes) {
        // The kernels take a direction this slow for none.
        let direction = Vec3::from(d).map(|d| if d.abs() < 1e-12 { 0.0 } else { d }).as_dvec3();
        let expected = bounds.clip(&Ray { origin: Vec3::from(o).as_dvec3(), direction });
        let (t_in, t_out) = (f64::from(a[0]), f64::from(a[1]));
        match expected {
            Some((e_in, e_out)) => {
                let near = |t: f64, e: f64| (t - e).abs() <= 1e-5 * e.abs().max(1.0);
                assert!(near(t_in, e_in) && near(t_out, e_out), "{o:?} {d:?}: {a:?} for {expected:?}");
            }
            None => assert!(t_out <= t_in, "{o:?} {d:?}: {a:?}"),
        }
    }
}

#[test]
fn cells_lie_in_the_grid_and_so_do_their_weights() {
    let last = Vec3::new(16.0, 0.0, 1.0);
    let sides = [-0.5, -1e-6, -0.0, 0.0, 0.25, 0.9999, 1.0, 1.0001, 3.75, 15.0, 15.99, 16.0, 16.0001];
    let Some(outcomes) = probe(Leaf::Cell, &sides.map(|s| [xyz([s; 3]), xyz(last), [0.0; 4], [0.0; 4]])) else {
        return;
    };
    for (s, [base, weight]) in sides.into_iter().zip(outcomes) {
        for axis in 0..3 {
            let cell = (s.max(0.0) as u32).min((last[axis] as u32).saturating_sub(1)) as f32;
            let expected = [cell, (s.max(0.0) - cell).min(1.0)];
            assert_eq!([base[axis], weight[axis]], expected, "{s} on axis {axis}");
        }
    }
}

#[test]
fn bricks_lie_in_the_map() {
    let bricks = Vec3::new(4.0, 1.0, 2.0);
    let sides = [-0.5, -0.0, 0.0, 3.9999, 4.0, 7.9999, 8.0, 15.9999, 16.0, 16.0001];
    let Some(outcomes) = probe(Leaf::Brick, &sides.map(|s| [xyz([s; 3]), xyz(bricks), [0.0; 4], [0.0; 4]])) else {
        return;
    };
    for (s, [a, _]) in sides.into_iter().zip(outcomes) {
        for axis in 0..3 {
            // As SkipMap::is_visible.
            let expected = (s.max(0.0) as usize / BRICK).min(bricks[axis] as usize - 1);
            assert_eq!(a[axis] as usize, expected, "{s} on axis {axis}");
        }
    }
}

/// The brick that a sample counts for.
fn brick_of(index: DVec3, bricks: [u32; 3]) -> [u32; 3] {
    [0, 1, 2].map(|a| (index[a].max(0.0) as u32 / BRICK as u32).min(bricks[a] - 1))
}

#[test]
fn a_jump_passes_over_empty_samples_only_and_over_nearly_all() {
    let bricks = [6_u32, 5, 1];
    let mut cases = Vec::new();
    let starts = [[8.0, 9.5, 1.0], [12.0, 8.0, 0.0], [15.999, 4.001, 3.9], [23.9, 0.01, -0.4], [0.0, 19.9, 4.3]];
    let ways = [
        [0.37, 0.0, 0.0],
        [-0.37, 0.0, 0.0],
        [0.21, -0.3, 0.01],
        [-0.001, 0.002, -0.003],
        [64.0, 0.0, 1e-13],
        [-0.5, -0.5, 0.0],
        [0.0, 0.0, 0.0],
    ];
    for (start, way) in starts.iter().flat_map(|s| ways.iter().map(move |w| (s, w))) {
        for distance in [1.0, 2.0, 3.0, 15.0] {
            let brick = brick_of(Vec3::from(*start).as_dvec3(), bricks).map(|b| b as f32);
            cases.push([
                xyz(*start),
                xyz(*way),
                [brick[0], brick[1], brick[2], distance],
                xyz(bricks.map(|b| b as f32)),
            ]);
        }
    }
    let Some(outcomes) = probe(Leaf::Jump, &cases) else { return };
    for (case, [a, _]) in cases.iter().zip(outcomes) {
        let vector = |v: [f32; 4]| DVec3::new(v[0].into(), v[1].into(), v[2].into());
        let (start, way) = (vector(case[0]), vector(case[1]));
        let home = brick_of(start, bricks);
        // Single precision may put a sample on the far side of a boundary that it lies on.
        let outside = |n: u32, slack: f64| {
            let at = brick_of(start + f64::from(n) * way - slack * way.normalize_or_zero(), bricks);
            (0..3).any(|x| at[x].abs_diff(home[x]) >= case[2][3] as u32)
        };
        const FAR: u32 = 50_000;
        let least = (1..FAR).find(|&n| outside(n, -1e-5)).unwrap_or(FAR);
        let most = (1..FAR).find(|&n| outside(n, 1e-5)).unwrap_or(1 << 30);
        let jump = (a[0].min(1e9) as u32).max(1);
        assert!(least <= jump && jump <= most, "{case:?}: {jump} in {least}..={most}");
    }
}
