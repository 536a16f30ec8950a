//! The transfer function as a table over its range: what the fast levels look up, on the CPU and on the GPU.
//!
//! Entries are equally spaced and interpolated linearly. Between two control points every column is smooth, so the error
//! is of second order in the spacing; in a bin that holds a control point the kink, or the jump of two points at one
//! position, is rounded off over that bin. The table is made fine enough for the closest pair of control points.

use lamina_compute::simd::{Floats, Lanes};
use lamina_model::TransferFunction;
use lamina_model::composite::opacity_from_optical_depth;

/// Rows of [`TransferTable::unit`] and [`TransferTable::step`].
#[derive(Debug, Clone)]
pub struct TransferTable {
    /// Red, green, blue and opacity of one step, premultiplied. `below` + `bins` + 1 rows.
    pub step: Vec<[f32; 4]>,
    /// Red, green, blue and opacity of one unit length, premultiplied; then the optical depth of one step and the ratio of
    /// a step's opacity to that of a unit length; then two zeros. As many rows.
    pub unit: Vec<[f32; 8]>,
    /// Rows before that of position 0: one where points at 0 make a jump, for what lies below the range.
    pub below: u32,
    /// Steps in a unit length.
    pub unit_steps: f32,
    /// Outside these rows, ends included, all is transparent.
    pub visible: [f32; 2],
}

/// The least number of bins: 32 KB of rows, in reach of a core's first cache.
const MIN_BINS: usize = 1024;
/// The greatest number of bins.
const MAX_BINS: usize = 1 << 16;
/// Stands for an infinite optical depth: opaque, and still a number that can be interpolated.
pub const OPAQUE: f64 = 1e4;

impl TransferTable {
    /// The table of `transfer` for steps of `step_length` where opacities refer to `unit_length`.
    pub fn new(transfer: &TransferFunction, unit_length: f64, step_length: f64) -> Self {
        let bins = bins(transfer);
        let units = step_length / unit_length;
        let below = u32::from(transfer.at(-1.0) != transfer.at(0.0));
        let beside = (0..below).map(|_| -1.0);
        let rows = beside.chain((0..=bins).map(|n| (n as f64 / bins as f64) as f32)).map(|u| {
            let c = transfer.classify(u, unit_length);
            let optical_depth = (c.extinction * step_length).min(OPAQUE);
            let step = opacity_from_optical_depth(optical_depth);
            // A transparent row takes the limit, so that bins at the rim of the visible interpolate towards it.
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

    /// Whether something may show at a position given in rows. NaN never does.
    #[inline(always)]
    pub fn shown<L: Lanes>(&self, at: L::F) -> L::M {
        L::F::splat(self.visible[0]).le(at) & at.le(L::F::splat(self.visible[1]))
    }

    /// Intervals of the range.
    pub fn bins(&self) -> usize {
        self.step.len() - 1 - self.below as usize
    }
}

/// Four bins or more between any two control points that are apart, within bounds; two nearer than the finest bin are a jump.
fn bins(transfer: &TransferFunction) -> usize {
    let gaps = transfer.points().windows(2).map(|w| w[1].at - w[0].at);
    let least = gaps.filter(|&g| g * MAX_BINS as f64 > 1.0).fold(1.0, f64::min);
    ((4.0 / least) as usize).clamp(MIN_BINS, MAX_BINS).next_power_of_two()
}

/// The transfer function integrated over its range: what a step shows whose scalar runs from one end to the other in a line.
#[derive(Debug)]
pub struct Integral {
    /// Sums of optical depth x (red, green, blue, 1) of a whole step, row by row from the first; in units of rows.
    pub sums: Vec<[f64; 4]>,
    /// The summands below and above the range.
    pub ends: [[f64; 4]; 2],
}

impl Integral {
    /// For steps of `step_length` where opacities refer to `unit_length`; as many rows as [`TransferTable::new`] makes.
    pub fn new(transfer: &TransferFunction, unit_length: f64, step_length: f64) -> Self {
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

    /// Intervals of the range.
    pub fn bins(&self) -> usize {
        self.sums.len() - 1
    }

    /// Straight colour and optical depth of a whole step between two positions in the range that are apart.
    pub fn between(&self, from: f64, to: f64) -> ([f64; 3], f64) {
        let bins = self.bins() as f64;
        let (a, b) = (self.at(from * bins), self.at(to * bins));
        let [r, g, b, depth] = std::array::from_fn(|c| (b[c] - a[c]) / ((to - from) * bins));
        if depth > 0.0 { ([r / depth, g / depth, b / depth], depth) } else { ([0.0; 3], 0.0) }
    }

    /// As single precision can add them up: per row its sum, what that was rounded by, and what is added up to the next row.
    pub fn split(&self) -> Vec<[[f32; 4]; 3]> {
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
