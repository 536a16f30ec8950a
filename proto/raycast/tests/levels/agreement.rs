//! How near a fast level comes to the oracle, and how near it must.

use lamina_model::{Image, SquaredError, Supersegment, Vdi};

// What single precision and the table cost. A sample's position is off by some 1e-5 of a voxel, its scalar by 1e-6 of the
// range, the table's color by the square of a bin, 1e-6: together some 1e-5 of a channel, 100 dB. Where a kink of the
// transfer function lies inside a bin, or a ray just grazes a voxel that is not a number, single pixels differ by more.
pub(crate) const MIN_PSNR_DB: f64 = 90.0;
pub(crate) const MAX_CHANNEL: f32 = 0.02;
/// Share of supersegments that may be more or fewer, and of rays whose lists are cut elsewhere: where a sample's difference
/// comes within rounding of gamma, or of 0 opacity.
pub(crate) const MAX_COUNT: f64 = 0.005;
pub(crate) const MAX_RAYS: f64 = 0.01;
/// Optical depth of a whole ray, relative. Beside it what one sample in a bin with a kink is off by: a quarter of the bin
/// (1/1024) times the change of slope there (2.5 in opacity), times a step (0.43).
pub(crate) const MAX_DEPTH: f64 = 1e-3;
pub(crate) const MAX_DEPTH_ABSOLUTE: f64 = 3e-4;

/// How near a VDI comes to the oracle's.
#[derive(Debug, Default)]
pub(crate) struct Agreement {
    /// Supersegments of both.
    pub counts: [usize; 2],
    /// Share of rays whose lists start or end elsewhere.
    pub other_rays: f64,
    /// Greatest relative difference of a ray's optical depth, beyond the absolute one allowed.
    pub worst_depth: f64,
    /// Mean difference of optical depths, relative to their mean.
    pub mean_depth: f64,
    /// Greatest difference of color between supersegments that are alike and not nearly transparent.
    pub worst_color: f32,
}

pub(crate) fn agreement(ours: &Vdi, oracle: &Vdi) -> Agreement {
    let r = ours.resolution();
    let mut found = Agreement { counts: [ours, oracle].map(|v| v.segments().len()), ..Agreement::default() };
    let (mut differences, mut depths) = (0.0, 1e-30);
    for (i, j) in (0..r).flat_map(|j| (0..r).map(move |i| (i, j))) {
        let (a, b) = (ours.list(i, j), oracle.list(i, j));
        let steps = ours.header().ray_span(i, j).map_or(0, |(t_in, t_out)| ours.header().steps(t_out - t_in));
        assert!(a.iter().all(|s| s.end <= steps), "({i}, {j}) is longer than its {steps} steps: {a:?}");
        // Beyond 20 nothing is left of what lies behind.
        let sum = |list: &[Supersegment]| list.iter().map(|s| f64::from(s.optical_depth)).sum::<f64>().min(20.0);
        let (depth, difference) = (sum(b), (sum(a) - sum(b)).abs());
        (differences, depths) = (differences + difference, depths + depth);
        // A ray cut off a step earlier is one of the other rays.
        if a.last().map(|s| s.end) == b.last().map(|s| s.end) {
            found.worst_depth = found.worst_depth.max((difference - MAX_DEPTH_ABSOLUTE) / depth.max(1e-30));
        }
        if a.len() != b.len() || a.iter().zip(b).any(|(a, b)| (a.start, a.end) != (b.start, b.end)) {
            found.other_rays += 1.0 / f64::from(r * r);
            continue;
        }
        for (a, b) in a.iter().zip(b).filter(|(_, b)| b.optical_depth > 1e-3) {
            found.worst_color = (0..3).map(|c| (a.color[c] - b.color[c]).abs()).fold(found.worst_color, f32::max);
        }
    }
    found.mean_depth = differences / depths;
    found
}

/// Holds a VDI to the oracle's.
pub(crate) fn compare(name: &str, ours: &Vdi, oracle: &Vdi) {
    let found = agreement(ours, oracle);
    println!("{name}: {found:?}");
    let [n, m] = found.counts.map(|n| n as f64);
    assert!((n - m).abs() <= MAX_COUNT * m && found.other_rays < MAX_RAYS, "{name}: {found:?}");
    assert!(found.worst_depth < MAX_DEPTH && found.worst_color < MAX_CHANNEL, "{name}: {found:?}");
}

/// Holds a picture to the oracle's.
pub(crate) fn compare_pictures(name: &str, ours: &Image, oracle: &Image) {
    let channels = ours.pixels().as_flattened().iter().zip(oracle.pixels().as_flattened());
    let worst = channels.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    let mut error = SquaredError::default();
    error.add_all(ours.pixels(), oracle.pixels());
    let psnr = error.psnr_db();
    println!("{name}: {psnr:.1} dB, worst channel {worst:.1e}");
    assert!(psnr > MIN_PSNR_DB && worst < MAX_CHANNEL, "{name}: {psnr} dB, worst channel {worst}");
}
