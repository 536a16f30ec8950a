//! Each leaf of leaf.wgsl, evaluated on the device at the edges of what it takes, against Rust.

use crate::simd::DepthBins;
use lamina_compute::gpu::testing;
use lamina_model::composite::opacity_from_optical_depth;

const PROBE: &str = concat!(include_str!("../../kernel/leaf.wgsl"), include_str!("probe.wgsl"));

/// Leaves by their numbers in probe.wgsl.
#[derive(Clone, Copy)]
enum Leaf {
    Opacity,
    Cut,
    Bits,
    Way,
    AxisWalk,
    Share,
    PerChange,
}

type Case = [[f32; 4]; 2];

fn case<const N: usize>(numbers: [f32; N]) -> Case {
    let at = |n: usize| numbers.get(n).copied().unwrap_or(0.0);
    [[at(0), at(1), at(2), at(3)], [at(4), at(5), at(6), at(7)]]
}

/// The device's answers. `None` without a device.
fn probe(leaf: Leaf, cases: &[Case]) -> Option<Vec<[f32; 4]>> {
    let gpu = testing::gpu()?;
    let outcomes = testing::probe(&gpu, PROBE, leaf as u32 as f32, cases);
    Some(outcomes.into_iter().map(|[outcome]| outcome).collect())
}

#[test]
fn opacity_keeps_its_digits() {
    let depths = [0.0, 1e-30, 1e-9, 1e-4, 0.03, 0.24999, 0.25, 0.25001, 0.7, 1.0, 16.0, 79.9, 80.0, 1e4, 1e30];
    let Some(outcomes) = probe(Leaf::Opacity, &depths.map(|t| case([t]))) else { return };
    for (depth, [a, ..]) in depths.into_iter().zip(outcomes) {
        let expected = opacity_from_optical_depth(f64::from(depth));
        // Where the series ends, 1 - exp(-t) has lost two bits, and WGSL's exp may be off by 3.5 units in the last place.
        assert!((f64::from(a) - expected).abs() <= 2e-6 * expected, "{depth}: {a} for {expected}");
    }
}

#[test]
fn half_spaces_cut_the_end_they_are_at() {
    // Span, then a + b t >= 0, then the span expected.
    let cases = [
        ([-1.0, 5.0], -2.0, 1.0, Some([2.0, 5.0])),
        ([-1.0, 5.0], 2.0, -1.0, Some([-1.0, 2.0])),
        ([3.0, 5.0], -2.0, 1.0, Some([3.0, 5.0])),
        ([-1.0, 1.0], -2.0, 1.0, None),
        ([-1.0, 1.0], 0.5, 0.0, Some([-1.0, 1.0])),
        ([-1.0, 1.0], 0.0, 0.0, Some([-1.0, 1.0])),
        ([-1.0, 1.0], -0.5, 0.0, None),
        ([-1.0, 1.0], -0.5, 1e-13, None),
        ([-1.0, 1.0], 0.5, -1e-9, Some([-1.0, 1.0])),
    ];
    let Some(outcomes) = probe(Leaf::Cut, &cases.map(|([x, y], a, b, _)| case([x, y, a, b]))) else { return };
    for ((span, a, b, expected), [x, y, ..]) in cases.into_iter().zip(outcomes) {
        match expected {
            Some(expected) => assert_eq!([x, y], expected, "{span:?} {a} {b}"),
            None => assert!(y < x, "{span:?} {a} {b}: {x} {y}"),
        }
    }
}

#[test]
fn bits_are_the_masks_own() {
    let places = [-1e6, -0.5, 0.0, 0.99, 1.0, 30.9, 31.0, 31.9, 32.0, 33.0, 62.9, 63.0, 64.0, 1e9];
    let pairs = places.iter().flat_map(|&a| places.iter().filter(move |&&b| b >= a).map(move |&b| [a, b]));
    let pairs: Vec<_> = pairs.collect();
    let cases: Vec<_> = pairs.iter().map(|&p| case(p)).collect();
    let Some(outcomes) = probe(Leaf::Bits, &cases) else { return };
    for ([a, b], parts) in pairs.into_iter().zip(outcomes) {
        let [p, q, r, s] = parts.map(|part| part as u64);
        let expected = DepthBins::bits(DepthBins::bin(a), DepthBins::bin(b));
        assert_eq!(p | q << 32 | r << 16 | s << 48, expected, "{a} {b}");
    }
}

#[test]
fn the_way_is_perspective_correct() {
    let mut cases = Vec::new();
    for mu in [0.0, 1e-6, 0.25, 0.5, 0.999, 1.0_f32.next_down(), 1.0] {
        for [z0, z1] in [[1.0, 1.0], [1.0, 4.0], [4.0, 1.0], [1e-3, 2.0], [1e4, 10002.0]] {
            cases.push([mu, z0, z1]);
        }
    }
    let probed: Vec<_> = cases.iter().map(|&c| case(c)).collect();
    let Some(outcomes) = probe(Leaf::Way, &probed) else { return };
    for ([mu, z0, z1], [way, ..]) in cases.into_iter().zip(outcomes) {
        let [m, a, b] = [mu, z0, z1].map(f64::from);
        let expected = m * a / (b * (1.0 - m) + a * m);
        assert!((f64::from(way) - expected).abs() <= 1e-6 * expected, "{mu} {z0} {z1}: {way} for {expected}");
    }
}

#[test]
fn an_axis_starts_between_the_boundaries_around_mu() {
    let mut cases = Vec::new();
    for (start, change) in
        [(0.0, 40.0), (3.0, 0.7), (39.9, -39.9), (17.0, -5.0), (16.0, 16.0), (5.5, 0.0), (8.0, -1e-30)]
    {
        let per_change = if f32::abs(change) < 1e-30 { 1e30 } else { 1.0 / change };
        for shift in [0.0, 3.0, 5.0] {
            for mu in [0.0, 1e-7, 0.125, 0.2, 0.375, 0.999_999_94] {
                let hi = (39 >> shift as u32) as f32;
                cases.push([start, change, per_change, shift, mu, 0.0, hi, 0.0]);
            }
        }
    }
    let probed: Vec<_> = cases.iter().map(|&c| case(c)).collect();
    let Some(outcomes) = probe(Leaf::AxisWalk, &probed) else { return };
    for (c, [cell, boundary, next, last]) in cases.into_iter().zip(outcomes) {
        let [start, change, per_change, shift, mu, lo, hi, _] = c;
        let width = (1 << shift as u32) as f32;
        let (ahead, behind) =
            if change >= 0.0 { ((cell + 1.0) * width, cell * width) } else { (cell * width, (cell + 1.0) * width) };
        let place = |boundary: f32| (boundary - start) * per_change;
        let first = if change >= 0.0 { lo } else { hi };
        assert!((lo..=hi).contains(&cell) && boundary == ahead && last == lo + hi - first, "{c:?}: {cell} {boundary}");
        assert_eq!(next, place(ahead), "{c:?}");
        assert!(next > mu || cell == last, "{c:?}: cell {cell} was left at {next}");
        assert!(place(behind) <= mu || cell == first, "{c:?}: cell {cell} is entered at {}", place(behind));
    }
}

#[test]
fn shares_add_up_to_one() {
    // Start and end of a supersegment, of a stretch, and the share.
    let cases = [
        ([3.0, 7.0], [0.0, 10.0], 0.4),
        ([3.0, 7.0], [4.0, 6.0], 1.0),
        ([3.0, 7.0], [5.0, 9.0], 0.5),
        ([3.0, 7.0], [7.0, 9.0], 0.0),
        ([3.0, 7.0], [1.0, 3.0], 0.0),
        ([3.0, 7.0], [3.0, 3.0], 1.0),
        ([3.0, 7.0], [7.0, 7.0], 0.0),
        ([7.0, 9.0], [7.0, 7.0], 1.0),
        ([0.0, 9.0], [0.0, 0.0], 1.0),
        ([0.0, 9.0], [-1e-5, -1e-5], 0.0),
        ([0.0, 65_536.0], [65_535.99, 65_536.0], 1.0),
    ];
    let Some(outcomes) = probe(Leaf::Share, &cases.map(|([s, e], [n, f], _)| case([s, e, n, f]))) else { return };
    for ((segment, stretch, expected), [share, ..]) in cases.into_iter().zip(outcomes) {
        assert!((share - expected).abs() <= 1e-6, "{segment:?} {stretch:?}: {share} for {expected}");
    }
}

#[test]
fn no_change_is_never_divided_by() {
    let changes = [0.0, 1e-38, -1e-31, 1e-20, -0.5, 200.0];
    let Some(outcomes) = probe(Leaf::PerChange, &changes.map(|c| case([c]))) else { return };
    for (change, [inverse, ..]) in changes.into_iter().zip(outcomes) {
        let expected = if change.abs() < 1e-30 { 1e30 } else { 1.0 / change };
        assert!((inverse - expected).abs() <= 1e-6 * expected.abs(), "{change}: {inverse}");
    }
}
