//! Lookup table of the transfer function, for the fast levels on processor and GPU; and its integral, for pre-integration.
//!
//! Rows are equally spaced over the range and interpolated linearly. Between two control points every column is smooth, so the
//! error is of second order in the spacing; in a bin that holds a control point the kink, or the jump of two points at one
//! position, is smoothed over that bin. The table resolves the closest pair of control points.

use lamina_compute::simd::{Lanes, SimdF32};
use lamina_model::TransferFunction;
use lamina_model::composite::opacity_from_optical_depth;

/// The transfer function for one step length, as rows over its range.
#[derive(Debug, Clone)]
pub(crate) struct TransferLut {
    /// Red, green, blue and opacity of one step, premultiplied. `below` + `bins` + 1 rows.
    pub step: Vec<[f32; 4]>,
    /// Red, green, blue and opacity of one unit length, premultiplied; then the optical depth of one step, and the ratio of a
    /// step's opacity to that of a unit length; then two zeros. As many rows as `step`.
    pub unit: Vec<[f32; 8]>,
    /// Rows before that of position 0: one if control points at 0 make a jump, for values below the range.
    pub below: u32,
    /// Number of steps in a unit length.
    pub unit_steps: f32,
    /// First and last row, as positions, between which the function is not transparent.
    pub visible: [f32; 2],
}

/// Least number of bins: 32 KB of rows, which fit a first-level cache.
const MIN_BINS: usize = 1024;
/// The greatest number of bins.
const MAX_BINS: usize = 1 << 16;
/// Finite stand-in for an infinite optical depth: opaque, but still usable in interpolation.
pub(crate) const OPAQUE: f64 = 1e4;

impl TransferLut {
    /// The table of `transfer` for steps of `step_length`, where opacities refer to `unit_length` (world units).
    pub(crate) fn new(transfer: &TransferFunction, unit_length: f64, step_length: f64) -> Self {
        let bins = bins(transfer);
        let units = step_length / unit_length;
        let below = u32::from(transfer.at(-1.0) != transfer.at(0.0));
        let beside = (0..below).map(|_| -1.0);
        let rows = beside.chain((0..=bins).map(|n| (n as f64 / bins as f64) as f32)).map(|u| {
            let c = transfer.classify(u, unit_length);
            let optical_depth = (c.extinction * step_length).min(OPAQUE);
            let step = opacity_from_optical_depth(optical_depth);
            // Use the limit in transparent rows, so that bins at the edge of the visible range interpolate towards it.
            let ratio = if c.opacity > 0.0 { step / c.opacity } else { units };
            let [r, g, b] = c.color.map(|x| (x * c.opacity) as f32);
            let step_row = c.color.map(|x| (x * step) as f32);
            (
                [step_row[0], step_row[1], step_row[2], step as f32],
                [r, g, b, c.opacity as f32, optical_depth as f32, ratio as f32, 0.0, 0.0],
            )
        });
        let (step, unit) = rows.unzip();
        let visible = transfer.visible_hull().map(|u| u * bins as f32 + below as f32);
        Self { step, unit, below, unit_steps: (1.0 / units) as f32, visible }
    }

    /// Lanes whose position, in rows, may be visible. NaN is not.
    #[inline(always)]
    pub(crate) fn shown<L: Lanes>(&self, at: L::F) -> L::M {
        L::F::splat(self.visible[0]).le(at) & at.le(L::F::splat(self.visible[1]))
    }

    /// Number of intervals of the range.
    pub(crate) fn bins(&self) -> usize {
        self.step.len() - 1 - self.below as usize
    }
}

/// Number of bins: four or more between any two distinct control points, within bounds; closer ones count as a jump.
fn bins(transfer: &TransferFunction) -> usize {
    let gaps = transfer.points().windows(2).map(|w| w[1].at - w[0].at);
    let least = gaps.filter(|&g| g * MAX_BINS as f64 > 1.0).fold(1.0, f64::min);
    ((4.0 / least) as usize).clamp(MIN_BINS, MAX_BINS).next_power_of_two()
}

/// Integral of the transfer function over its range: color and optical depth of a step along which the scalar is linear.
#[derive(Debug)]
pub(crate) struct PreintegrationTable {
    /// Prefix sums of optical depth x (red, green, blue, 1) of a whole step, per row; in units of rows.
    pub sums: Vec<[f64; 4]>,
    /// The integrand below and above the range.
    pub ends: [[f64; 4]; 2],
}

impl PreintegrationTable {
    /// The integral for steps of `step_length`, where opacities refer to `unit_length`; as many rows as [`TransferLut::new`].
    pub(crate) fn new(transfer: &TransferFunction, unit_length: f64, step_length: f64) -> Self {
        let bins = bins(transfer);
        let summand = |at: f64| {
            let c = transfer.classify(at as f32, unit_length);
            let depth = (c.extinction * step_length).min(OPAQUE);
            [depth * c.color[0], depth * c.color[1], depth * c.color[2], depth]
        };
        let (mut sums, mut sum, mut last) = (vec![[0.0; 4]], [0.0; 4], summand(0.0));
        for n in 1..=bins {
            let next = summand(n as f64 / bins as f64);
            sum = std::array::from_fn(|c| sum[c] + 0.5 * (last[c] + next[c]));
            sums.push(sum);
            last = next;
        }
        Self { sums, ends: [summand(-1.0), last] }
    }

    /// Number of intervals of the range.
    pub(crate) fn bins(&self) -> usize {
        self.sums.len() - 1
    }

    /// Straight color and optical depth of a whole step between two distinct positions in the range.
    pub(crate) fn between(&self, from: f64, to: f64) -> ([f64; 3], f64) {
        let bins = self.bins() as f64;
        let (a, b) = (self.at(from * bins), self.at(to * bins));
        let [r, g, b, depth] = std::array::from_fn(|c| (b[c] - a[c]) / ((to - from) * bins));
        if depth > 0.0 { ([r / depth, g / depth, b / depth], depth) } else { ([0.0; 3], 0.0) }
    }

    /// The sums in single precision: per row its rounded sum, the rounding error, and the difference to the next row.
    pub(crate) fn split(&self) -> Vec<[[f32; 4]; 3]> {
        let next = self.sums.iter().skip(1).chain(self.sums.last());
        let row = |(sum, next): (&[f64; 4], &[f64; 4])| {
            let rounded = sum.map(|x| x as f32);
            let rest = std::array::from_fn(|c| (sum[c] - f64::from(rounded[c])) as f32);
            [rounded, rest, std::array::from_fn(|c| (next[c] - sum[c]) as f32)]
        };
        self.sums.iter().zip(next).map(row).collect()
    }

    fn at(&self, row: f64) -> [f64; 4] {
        let (x, last) = (row.clamp(0.0, self.bins() as f64), self.bins() - 1);
        let n = (x as usize).min(last);
        let (w, beyond) = (x - n as f64, row - x);
        let end = self.ends[usize::from(beyond > 0.0)];
        std::array::from_fn(|c| self.sums[n][c] + w * (self.sums[n + 1][c] - self.sums[n][c]) + beyond * end[c])
    }
}
