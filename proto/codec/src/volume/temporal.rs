//! Prediction in time: from a volume that resembles this one, such as the step before with its motion compensated.
//!
//! Each point's prediction from its neighbors is corrected by a share of what the same prediction would have missed in the volume before: neighbors
//! and change in time are weighed against each other, class by class.
use super::grid::{Lattice, PointClass};
use super::multigrid::{LatticePart, LevelParams, MultigridField, within};
use super::predict::{PredictionRow, SCALE, octaves};
use super::regression::sampled_rows;

/// Octaves of a correction that are told apart.
pub(super) const OCTAVES: usize = 16;

/// The volume before, lattice by lattice.
#[derive(Debug)]
pub(super) struct Before<'a> {
    pub values: &'a [f32],
    pub voxels: Lattice,
}

impl Before<'_> {
    /// Its points on level `number`, all known.
    pub(super) fn level(&self, number: usize) -> MultigridField {
        let lattice = self.voxels.lattice(number);
        let parts = std::array::from_fn(|part| {
            let odd: [bool; 3] = std::array::from_fn(|axis| part >> axis & 1 == 1);
            self.part(lattice.part(odd), odd, number)
        });
        // Predictions from it are not clamped: it has another range.
        MultigridField { parts, lattice, range: [f32::MIN, f32::MAX] }
    }

    fn part(&self, grid: Lattice, odd: [bool; 3], number: usize) -> LatticePart {
        let place = |axis: usize, i: usize| (2 * i + usize::from(odd[axis])) << number;
        let mut values = Vec::with_capacity(grid.count());
        for (y, z) in grid.rows() {
            let row = self.voxels.row(place(1, y), place(2, z)) + place(0, 0);
            values.extend((0..grid.dims[0]).map(|x| self.values[row + (x << (number + 1))]));
        }
        LatticePart { grid, values, residuals: Vec::new() }
    }
}

/// What the volume before adds to the prediction of a row.
#[derive(Debug, Default)]
pub(super) struct TemporalRow {
    row: PredictionRow,
    /// What the prediction from neighbors would have missed in the volume before.
    missed: Vec<f32>,
    /// Half octaves of it, in quantizer steps, below [`OCTAVES`].
    pub octaves: Vec<u8>,
}

impl TemporalRow {
    /// Computes it for row (`y`, `z`) of `class`.
    pub(super) fn compute(
        &mut self,
        before: &MultigridField,
        level: &LevelParams,
        class: PointClass,
        [y, z]: [usize; 2],
    ) {
        self.row.compute_means::<false>(before, class, y, z);
        self.row.predict::<false>(before.range, level, class);
        let there = before.parts[class.part()].row([y, z]);
        self.missed.clear();
        self.missed.extend(there.iter().zip(&self.row.expected).map(|(there, expected)| there - expected));
        self.octaves.clear();
        self.octaves.extend(self.missed.iter().map(|missed| octaves(missed * level.scale) as u8));
    }

    /// Corrects the predictions of a row, which lie in `range`.
    pub(super) fn correct(&self, expected: &mut [f32], weight: f32, range: [f32; 2]) {
        for (expected, missed) in expected.iter_mut().zip(&self.missed) {
            *expected = within(range, *expected + weight * missed);
        }
    }
}

/// The weight, in 1 / [`SCALE`], by which the volume before corrects the predictions of `class`. `wanted` gives the value of a point, or `None` where
/// it is invisible.
pub(super) fn fit(
    [field, before]: [&MultigridField; 2],
    level: &LevelParams,
    class: PointClass,
    wanted: impl Fn([usize; 3]) -> Option<f32>,
) -> i8 {
    let (mut row, mut past) = (PredictionRow::default(), TemporalRow::default());
    let (mut squares, mut products) = (0.0, 0.0);
    for (y, z) in sampled_rows(field.lattice.part(class.odd)) {
        row.compute_means::<false>(field, class, y, z);
        row.predict::<false>(field.range, level, class);
        past.compute(before, level, class, [y, z]);
        for (x, (expected, missed)) in row.expected.iter().zip(&past.missed).enumerate() {
            if let Some(wanted) = wanted([x, y, z]) {
                let (error, missed) = (f64::from(wanted - expected), f64::from(*missed));
                // As for the weights of neighbors: large errors count less.
                let weight = 1.0 / (error * error + f64::from(level.step) * f64::from(level.step));
                squares += weight * missed * missed;
                products += weight * missed * error;
            }
        }
    }
    if squares > 0.0 { (products / squares * f64::from(SCALE)).round().clamp(-127.0, 127.0) as i8 } else { 0 }
}
