//! Estimation of motion by matching: coarse to fine over halved volumes, then by fractions of a point.
use super::{MotionField, PARTS, SPACING, Sampler};
use crate::volume::grid::Lattice;
use rayon::prelude::*;

/// Halvings of the volumes for the coarsest search.
const HALVINGS: usize = 2;
/// Displacements tried at the coarsest level, to either side, in its points.
const REACH: i32 = 2;
/// Half of the side of the window that is compared, in points.
const HALF_WINDOW: usize = SPACING * 3 / 4;
/// Points along an axis from one that is compared to the next.
const STRIDE: usize = 3;
/// Bits that a displacement takes which is not that of the control point before it.
const VECTOR_BITS: f32 = 12.0;
/// Differences below this share of a quantizer step count as none.
const NOISE: f32 = 0.25;

/// A volume, and halves of it, whose points are means of eight.
struct Pyramid(Vec<(Vec<f32>, Lattice)>);

impl Pyramid {
    fn new(values: Vec<f32>, dims: [usize; 3]) -> Self {
        let mut levels = vec![(values, Lattice { dims })];
        for _ in 0..HALVINGS {
            let halved = halved(&levels[levels.len() - 1]);
            levels.push(halved);
        }
        Self(levels)
    }

    fn level(&self, number: usize) -> Sampler<'_> {
        Sampler { values: &self.0[number].0, points: self.0[number].1 }
    }
}

fn halved((values, points): &(Vec<f32>, Lattice)) -> (Vec<f32>, Lattice) {
    let half = points.lattice(1);
    let plane = half.dims[0] * half.dims[1];
    let mut means = vec![0.0; half.count()];
    means.par_chunks_mut(plane).enumerate().for_each(|(z, means)| {
        for (n, mean) in means.iter_mut().enumerate() {
            let corner = |axis: usize, i: usize, odd: usize| (2 * i + odd).min(points.dims[axis] - 1);
            let (x, y) = (n % half.dims[0], n / half.dims[0]);
            let eight = (0..8)
                .map(|k| values[points.row(corner(1, y, k >> 1 & 1), corner(2, z, k >> 2)) + corner(0, x, k & 1)]);
            *mean = eight.sum::<f32>() / 8.0;
        }
    });
    (means, half)
}

/// The points compared around a control point, on one level.
struct Window<'a> {
    now: &'a Sampler<'a>,
    before: &'a Sampler<'a>,
    low: [usize; 3],
    high: [usize; 3],
    stride: usize,
    /// Smaller differences count as none: the volume before is known no better.
    noise: f32,
}

impl<'a> Window<'a> {
    fn new(
        now: &'a Sampler<'_>,
        before: &'a Sampler<'_>,
        center: [usize; 3],
        half: usize,
        stride: usize,
        noise: f32,
    ) -> Self {
        let low = center.map(|c| c.saturating_sub(half));
        let high = std::array::from_fn(|a| (center[a] + half).min(now.points.dims[a]));
        Self { now, before, low, high, stride, noise }
    }

    /// Sum of absolute differences where the volume before is displaced `by`.
    fn difference(&self, by: [f32; 3]) -> f32 {
        self.sum(by, |difference| difference)
    }

    /// The points along an axis whose displaced places lie inside, and how many more points are compared.
    fn inside(&self, axis: usize, by: f32) -> (impl Iterator<Item = usize> + Clone + use<>, [usize; 2]) {
        let (low, high, stride) = (self.low[axis], self.high[axis], self.stride);
        let last = (self.now.points.dims[axis] - 1) as f32;
        let skipped = ((-by - low as f32) / stride as f32).ceil().max(0.0) as usize;
        let end = high.min(((last - by).floor() + 1.0).max(0.0) as usize);
        let places = (low + skipped * stride..end).step_by(stride);
        (places.clone(), [places.len(), (high - low).div_ceil(stride)])
    }

    /// Sum of a measure of absolute differences, as if those points whose displaced places lie outside differed like the others; infinite if
    /// these are most.
    #[inline(always)]
    fn sum(&self, by: [f32; 3], measure: impl Fn(f32) -> f32) -> f32 {
        let [(xs, [nx, mx]), (ys, [ny, my]), (zs, [nz, mz])] = [0, 1, 2].map(|axis| self.inside(axis, by[axis]));
        let (inside, all) = (nx * ny * nz, mx * my * mz);
        if 2 * inside < all {
            return f32::INFINITY;
        }
        let excess = |now: f32, before: f32| ((now - before).abs() - self.noise).max(0.0);
        let points = self.now.points;
        let is_whole = by.iter().all(|v| v.fract() == 0.0);
        let moved = |axis: usize, i: usize| (i as i32 + by[axis] as i32) as usize;
        let mut sum = 0.0;
        for z in zs {
            for y in ys.clone() {
                let row = points.row(y, z);
                if is_whole {
                    let from = points.row(moved(1, y), moved(2, z));
                    for x in xs.clone() {
                        sum += measure(excess(self.now.values[row + x], self.before.values[from + moved(0, x)]));
                    }
                } else {
                    for x in xs.clone() {
                        let place = [x as f32 + by[0], y as f32 + by[1], z as f32 + by[2]];
                        sum += measure(excess(self.now.values[row + x], self.before.at(place)));
                    }
                }
            }
        }
        sum * (all as f32 / inside as f32)
    }

    /// About the bits that the differences of all points take, which are quantized by `step`.
    fn bits(&self, by: [f32; 3], step: f32) -> f32 {
        let weight = (self.stride * self.stride * self.stride) as f32;
        weight * self.sum(by, |difference| (1.0 + difference / step).log2())
    }

    /// The best displacement of all within `reach` points around `center`.
    fn best_of_all(&self, center: [f32; 3], reach: i32) -> [f32; 3] {
        let mut best = (self.difference(center), center);
        let range = -reach..=reach;
        for z in range.clone() {
            for y in range.clone() {
                for x in range.clone().filter(|&x| (x, y, z) != (0, 0, 0)) {
                    let by = [center[0] + x as f32, center[1] + y as f32, center[2] + z as f32];
                    let difference = self.difference(by);
                    if difference < best.0 {
                        best = (difference, by);
                    }
                }
            }
        }
        best.1
    }

    /// The best displacement of `center` and those `step` to either side of it, axis by axis.
    fn best_beside(&self, center: [f32; 3], step: f32) -> [f32; 3] {
        let mut best = (self.difference(center), center);
        for axis in 0..3 {
            let from = best.1;
            for step in [-step, step] {
                let mut by = from;
                by[axis] += step;
                let difference = self.difference(by);
                if difference < best.0 {
                    best = (difference, by);
                }
            }
        }
        best.1
    }
}

/// The motion to `now` from `before`, both of `dims` points, whose differences are quantized by twice `bound`.
pub(crate) fn estimate(before: Vec<f32>, now: Vec<f32>, dims: [usize; 3], bound: f32) -> MotionField {
    let step = 2.0 * bound;
    let (before, now) = rayon::join(|| Pyramid::new(before, dims), || Pyramid::new(now, dims));
    let (fine_before, fine_now) = (before.level(0), now.level(0));
    let mut motion = MotionField::still(dims);
    let control = motion.control;
    let center = |n: usize| {
        let [nx, ny, _] = control.dims;
        let places = [n % nx, n / nx % ny, n / nx / ny];
        std::array::from_fn(|a| (SPACING * places[a]).min(dims[a] - 1))
    };
    let window = |n: usize| Window::new(&fine_now, &fine_before, center(n), HALF_WINDOW, STRIDE, NOISE * step);
    let found = |n: usize| {
        let fine = window(n);
        if fine.bits([0.0; 3], step) <= VECTOR_BITS {
            return [0; 3];
        }
        let mut by = [0.0; 3];
        for level in (1..=HALVINGS).rev() {
            let (now, before) = (now.level(level), before.level(level));
            let center = center(n).map(|c| c >> level);
            let half = (HALF_WINDOW >> level).max(2);
            let stride = 1 + usize::from(level == 1);
            let window = Window::new(&now, &before, center, half, stride, NOISE * step / (1 << level) as f32);
            by = window.best_of_all(by, if level == HALVINGS { REACH } else { 1 }).map(|v| 2.0 * v);
        }
        by = fine.best_of_all(by, 1);
        for step in [0.5, 0.25] {
            by = fine.best_beside(by, step);
        }
        by.map(|v| (v * PARTS).round().clamp(-127.0, 127.0) as i8)
    };
    (0..control.count()).into_par_iter().map(found).collect_into_vec(&mut motion.vectors);
    // What a displacement saves has to be worth its bits.
    for n in 0..control.count() {
        let (own, expected) = (motion.vectors[n], motion.expected(n));
        let bits = |v: [i8; 3]| window(n).bits(v.map(|v| f32::from(v) / PARTS), step);
        if own != expected && bits(expected) <= bits(own) + VECTOR_BITS {
            motion.vectors[n] = expected;
        }
    }
    motion
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shift_of_many_points_and_a_half_is_found() {
        let dims = [64, 48, 40];
        // Waves of several lengths, so that no other shift looks alike.
        let at = |x: f32, y: f32, z: f32| {
            (0.31 * x).sin() + (0.27 * y + 0.1 * x).cos() + (0.36 * z - 0.05 * y).sin() + (0.011 * x * y / 8.0).sin()
        };
        let volume = |shift: [f32; 3]| -> Vec<f32> {
            (0..64 * 48 * 40)
                .map(|n| {
                    let p = [n % 64, n / 64 % 48, n / 3072].map(|c| c as f32);
                    at(p[0] + shift[0], p[1] + shift[1], p[2] + shift[2])
                })
                .collect()
        };
        let (before, now) = (volume([0.0; 3]), volume([5.5, -3.0, 2.25]));
        let motion = estimate(before.clone(), now.clone(), dims, 1e-3);
        let inner = motion.control.row(1, 1) + 2;
        assert_eq!(motion.vectors[inner], [22, -12, 9]);
        assert_eq!(estimate(before.clone(), before.clone(), dims, 1e-3), MotionField::still(dims));
        let error = |a: &[f32]| a.iter().zip(&now).map(|(a, b)| (a - b).abs()).sum::<f32>() / now.len() as f32;
        let (moved, still) = (error(&motion.moved(&before, dims)), error(&before));
        assert!(moved < 0.2 * still, "{moved} of {still}");
    }
}
