//! Prediction of points from the points already known: the mean of the nearest neighbors along the odd axes, corrected by
//! weighted differences whose weights are fitted to the volume. Whole rows are predicted at a time.
use super::grid::{PointClass, part};
use super::multigrid::{LatticePart, LevelParams, MultigridField, WEIGHTS, within};

/// A weight is a multiple of 1 / SCALE.
pub(super) const SCALE: f32 = 64.0;

/// Terms of the prediction of one point.
#[derive(Debug, Clone, Copy)]
pub(super) struct PredictionTerms {
    /// Mean of the nearest neighbors.
    pub base: f32,
    /// Differences, one for each weight.
    pub terms: [f32; WEIGHTS],
    /// Disagreement between axes, or between near and far neighbors.
    pub bend: f32,
}

/// Number of weights of a class with `odd_axes` odd axes.
pub(super) const fn weights(odd_axes: usize) -> usize {
    [0, 2, 4, 7][odd_axes]
}

/// Weights where none were fitted, in 1 / SCALE: cubic interpolation along each axis, (-1, 9, 9, -1) / 16, averaged.
pub(super) const fn cubic(odd_axes: usize) -> [i8; WEIGHTS] {
    match odd_axes {
        1 => [-8, 0, 0, 0, 0, 0, 0],
        2 => [-4, -4, 0, 0, 0, 0, 0],
        _ => [-3, -3, -3, 0, 0, 0, 0],
    }
}

impl PredictionTerms {
    /// Base plus weighted terms.
    #[inline(always)]
    pub(super) fn value<const K: usize>(&self, weights: &[f32; WEIGHTS]) -> f32 {
        let mut sum = self.base;
        for (term, weight) in self.terms.iter().zip(weights).take(self::weights(K)) {
            sum += weight * term;
        }
        sum
    }
}

/// Means of the neighbors of a row of points, and their predictions.
#[derive(Debug, Default)]
pub(super) struct PredictionRow {
    /// Per odd axis: mean of the two nearest points along it.
    near: [Vec<f32>; 3],
    /// Per odd axis: mean of the points three times as far, or the nearest ones where the volume ends in between.
    far: [Vec<f32>; 3],
    /// Further means, by class: diagonal neighbors, or points on even axes.
    more: [Vec<f32>; 5],
    /// Largest difference between the two nearest neighbors along an axis.
    slope: Vec<f32>,
    /// Predictions.
    pub expected: Vec<f32>,
    /// Packed context bits: see `surroundings`.
    pub surroundings: Vec<u16>,
}

/// The larger number; the second if either is NaN.
#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// Means of two rows, element by element.
fn mean(to: &mut [f32], [a, b]: [&[f32]; 2]) {
    to.iter_mut().zip(a.iter().zip(b)).for_each(|(to, (a, b))| *to = (a + b) * 0.5);
}

/// Means of four rows, pair by pair.
fn mean4(to: &mut [f32], [a, b, c, d]: [&[f32]; 4]) {
    let pairs = a.iter().zip(b).zip(c.iter().zip(d));
    to.iter_mut().zip(pairs).for_each(|(to, ((a, b), (c, d)))| *to = ((a + b) * 0.5 + (c + d) * 0.5) * 0.5);
}

/// The neighbors at the end of a row, where the second one may be missing.
fn last(row: &[f32]) -> [f32; 2] {
    row.last().map_or([0.0; 2], |&v| [v, v])
}

/// Means of successive points within a row.
fn mean_x(to: &mut [f32], row: &[f32]) {
    let next = row.get(1..).unwrap_or(&[]);
    mean(to, [row, next]);
    if let (Some(to), [a, b]) = (to.get_mut(next.len()), last(row)) {
        *to = (a + b) * 0.5;
    }
}

/// Means of successive points within the means of two rows.
fn mean4_x(to: &mut [f32], [a, b]: [&[f32]; 2]) {
    let (c, d) = (a.get(1..).unwrap_or(&[]), b.get(1..).unwrap_or(&[]));
    mean4(to, [a, b, c, d]);
    if let (Some(to), [a, _], [b, _]) = (to.get_mut(c.len()), last(a), last(b)) {
        *to = ((a + b) * 0.5 + (a + b) * 0.5) * 0.5;
    }
}

/// Means of points three times as far apart within a row; `near` at its ends.
fn far_x(to: &mut [f32], row: &[f32], near: &[f32]) {
    to.copy_from_slice(near);
    if let (Some(to), Some(next)) = (to.get_mut(1..), row.get(3..)) {
        mean(to, [row, next]);
    }
}

/// Means of the points before and after each point, within the means of two rows; the point itself at an end.
fn even_neighbors_x(to: &mut [f32], rows: [&[f32]; 2]) {
    let at = |i: usize| {
        let (before, after) = (i.saturating_sub(1), (i + 1).min(rows[0].len() - 1));
        let [a, b] = rows.map(|row| (row[before] + row[after]) * 0.5);
        (a + b) * 0.5
    };
    let n = to.len();
    to[0] = at(0);
    to[n - 1] = at(n - 1);
    let [a, b] = rows;
    if let (Some(to), Some(c), Some(d)) = (to.get_mut(1..), a.get(2..), b.get(2..)) {
        mean4(to, [a, c, b, d]);
    }
}

/// Raises `to` to the absolute difference of two rows.
fn raise(to: &mut [f32], a: &[f32], b: &[f32]) {
    to.iter_mut().zip(a.iter().zip(b)).for_each(|(to, (a, b))| *to = larger((b - a).abs(), *to));
}

/// Indices, along an odd axis of `n` points, of the nearest neighbors of point `i`.
fn near_indices(i: usize, n: usize) -> [usize; 2] {
    [i, if i + 1 < n { i + 1 } else { i }]
}

/// Indices of those three times as far.
fn far_indices(i: usize, n: usize) -> [usize; 2] {
    if i >= 1 && i + 2 < n { [i - 1, i + 2] } else { near_indices(i, n) }
}

/// Indices, along an even axis, of the points beside point `i`.
fn even_neighbors(i: usize, n: usize) -> [usize; 2] {
    [i.saturating_sub(1), (i + 1).min(n - 1)]
}

/// Four rows of a part: all pairs of `ys` and `zs`, ordered by the `outer` axis first.
fn four(part: &LatticePart, ys: [usize; 2], zs: [usize; 2], outer: usize) -> [&[f32]; 4] {
    let [[a, b], [c, d]] = ys.map(|y| zs.map(|z| part.row([y, z])));
    if outer == 1 { [a, b, c, d] } else { [a, c, b, d] }
}

/// Two rows of a part: at the indices `places` along `axis`.
fn two(part: &LatticePart, axis: usize, [y, z]: [usize; 2], block_range: [usize; 2]) -> [&[f32]; 2] {
    block_range.map(|i| if axis == 1 { part.row([i, z]) } else { part.row([y, i]) })
}

impl PredictionRow {
    /// Computes the means for row (`y`, `z`) of `class`; with `SLOPE` also the differences of nearest neighbors.
    pub(super) fn compute_means<const SLOPE: bool>(
        &mut self,
        field: &MultigridField,
        class: PointClass,
        y: usize,
        z: usize,
    ) {
        let n = field.lattice.part(class.odd).dims[0];
        let rows = self.near.iter_mut().chain(&mut self.far).chain(&mut self.more);
        rows.chain([&mut self.slope, &mut self.expected]).for_each(|row| row.resize(n, 0.0));
        self.surroundings.resize(n, 0);
        if SLOPE {
            self.slope.fill(0.0);
        }
        let axes = (0..3).filter(|&a| class.odd[a]);
        for (number, axis) in axes.enumerate() {
            self.means_along::<SLOPE>(field, class, number, axis, [y, z]);
        }
        match class.odd_axes() {
            1 => self.even_axis_means(field, class, [y, z]),
            2 => self.diagonal_mean(field, class, [y, z]),
            _ => self.edge_and_corner_means(field, [y, z]),
        }
    }

    /// Near and far means along the odd `axis`.
    fn means_along<const SLOPE: bool>(
        &mut self,
        field: &MultigridField,
        class: PointClass,
        number: usize,
        axis: usize,
        [y, z]: [usize; 2],
    ) {
        let from = &field.parts[class.part() ^ 1 << axis];
        let (to, slope) = (&mut self.near[number], &mut self.slope);
        if axis == 0 {
            let row = from.row([y, z]);
            mean_x(to, row);
            far_x(&mut self.far[number], row, to);
            if SLOPE {
                raise(slope, row, row.get(1..).unwrap_or(&[]));
            }
            return;
        }
        let (i, n) = ([y, z][axis - 1], from.grid.dims[axis]);
        let rows = two(from, axis, [y, z], near_indices(i, n));
        mean(to, rows);
        mean(&mut self.far[number], two(from, axis, [y, z], far_indices(i, n)));
        if SLOPE {
            raise(slope, rows[0], rows[1]);
        }
    }

    /// One odd axis: means of the points beside along each even axis, twice as far.
    fn even_axis_means(&mut self, field: &MultigridField, class: PointClass, [y, z]: [usize; 2]) {
        let [first, second, ..] = &mut self.more;
        let from = &field.parts[0];
        let [_, ny, nz] = from.grid.dims;
        let (ys, zs) = (even_neighbors(y, ny), even_neighbors(z, nz));
        match class.odd {
            [true, _, _] => {
                mean4_x(first, two(from, 1, [y, z], ys));
                mean4_x(second, two(from, 2, [y, z], zs));
            }
            [_, true, _] => {
                even_neighbors_x(first, two(from, 1, [y, z], near_indices(y, ny)));
                mean4(second, four(from, near_indices(y, ny), zs, 1));
            }
            _ => {
                even_neighbors_x(first, two(from, 2, [y, z], near_indices(z, nz)));
                mean4(second, four(from, ys, near_indices(z, nz), 2));
            }
        }
    }

    /// Two odd axes: mean of the four diagonal neighbors.
    fn diagonal_mean(&mut self, field: &MultigridField, class: PointClass, [y, z]: [usize; 2]) {
        let (from, to) = (&field.parts[0], &mut self.more[0]);
        let [_, ny, nz] = from.grid.dims;
        match class.odd {
            [true, true, _] => mean4_x(to, two(from, 1, [y, z], near_indices(y, ny))),
            [true, _, _] => mean4_x(to, two(from, 2, [y, z], near_indices(z, nz))),
            _ => mean4(to, four(from, near_indices(y, ny), near_indices(z, nz), 1)),
        }
    }

    /// Three odd axes: means of the twelve edge neighbors by pair of axes, and of the corner neighbors by z.
    fn edge_and_corner_means(&mut self, field: &MultigridField, [y, z]: [usize; 2]) {
        let [xy, xz, yz, below, above] = &mut self.more;
        let edges = |x, y, z| &field.parts[part([x, y, z])];
        let [_, ny, nz] = field.parts[0].grid.dims;
        let (ys, zs) = (near_indices(y, ny), near_indices(z, nz));
        mean4_x(xy, two(edges(false, false, true), 1, [y, z], ys));
        mean4_x(xz, two(edges(false, true, false), 2, [y, z], zs));
        mean4(yz, four(edges(true, false, false), ys, zs, 1));
        mean4_x(below, two(&field.parts[0], 1, [y, zs[0]], ys));
        mean4_x(above, two(&field.parts[0], 1, [y, zs[1]], ys));
    }

    /// Passes index, terms and slope of each point to `see`.
    #[inline(always)]
    pub(super) fn features<const K: usize>(&self, mut see: impl FnMut(usize, &PredictionTerms, f32)) {
        let n = self.slope.len();
        let [n0, n1, n2] = self.near.each_ref().map(|r| &r[..n]);
        let [f0, f1, f2] = self.far.each_ref().map(|r| &r[..n]);
        let [m0, m1, m2, m3, m4] = self.more.each_ref().map(|r| &r[..n]);
        let slope = &self.slope[..n];
        for i in 0..n {
            let more = [m0[i], m1[i], m2[i], m3[i], m4[i]];
            let features = features::<K>([n0[i], n1[i], n2[i]], [f0[i], f1[i], f2[i]], more);
            see(i, &features, slope[i]);
        }
    }

    /// Computes predictions; with `SLOPE` also the context bits.
    pub(super) fn predict<const SLOPE: bool>(&mut self, range: [f32; 2], level: &LevelParams, class: PointClass) {
        match class.odd_axes() {
            1 => self.predict_with::<1, SLOPE>(range, level, class),
            2 => self.predict_with::<2, SLOPE>(range, level, class),
            _ => self.predict_with::<3, SLOPE>(range, level, class),
        }
    }

    fn predict_with<const K: usize, const SLOPE: bool>(
        &mut self,
        range: [f32; 2],
        level: &LevelParams,
        class: PointClass,
    ) {
        let (mut expected, mut around) = (std::mem::take(&mut self.expected), std::mem::take(&mut self.surroundings));
        let weights = level.weights[class.number];
        let scale = level.scale;
        let n = self.slope.len();
        {
            let (expected, around) = (&mut expected[..n], &mut around[..n]);
            self.features::<K>(|i, features, slope| {
                expected[i] = within(range, features.value::<K>(&weights));
                if SLOPE {
                    around[i] = surroundings(slope * scale, features.bend * scale, features.terms[0] * scale);
                }
            });
        }
        (self.expected, self.surroundings) = (expected, around);
    }
}

/// Context bits of a point: half octaves of `slope` in bits 0 to 3, of `bend` in bits 4 to 7, then the sign of `rise`: 0, 1,
/// 2 for negative, about zero, positive. All arguments are in quantizer steps.
#[inline(always)]
fn surroundings(slope: f32, bend: f32, rise: f32) -> u16 {
    let rise = rise * 16.0;
    let sign = 1 + u32::from(rise >= 1.0) - u32::from(rise <= -1.0);
    (octaves(slope) | octaves(bend) << 4 | sign << 8) as u16
}

/// Number of half octaves of |`x`| above 1/32, 0..16.
#[inline(always)]
pub(super) fn octaves(x: f32) -> u32 {
    let halves = (x.abs().to_bits() >> 22) as i32 - (2 * (127 - 5) - 1);
    halves.clamp(0, 15) as u32
}

/// Prediction terms from the means of one point.
#[inline(always)]
fn features<const K: usize>(near: [f32; 3], far: [f32; 3], more: [f32; 5]) -> PredictionTerms {
    let mut terms = [0.0; WEIGHTS];
    for a in 0..K {
        terms[a] = far[a] - near[a];
    }
    let mut bend = 0.0;
    let base = match K {
        1 => {
            terms[1] = (more[0] + more[1]) * 0.5 - near[0];
            bend = larger(terms[0].abs(), terms[1].abs());
            near[0]
        }
        2 => {
            let base = (near[0] + near[1]) * 0.5;
            terms[2] = near[0] - base;
            terms[3] = more[0] - base;
            bend = larger(terms[2].abs(), terms[3].abs());
            base
        }
        3 => {
            let base = (near[0] + near[1] + near[2]) * (1.0 / 3.0);
            terms[3] = near[0] - base;
            terms[4] = near[1] - base;
            terms[5] = (more[0] + more[1] + more[2]) * (1.0 / 3.0) - base;
            terms[6] = (more[3] + more[4]) * 0.5 - base;
            let apart = larger(larger(terms[3].abs(), terms[4].abs()), (near[2] - base).abs());
            bend = larger(apart, terms[5].abs());
            base
        }
        _ => 0.0,
    };
    PredictionTerms { base, terms, bend }
}
