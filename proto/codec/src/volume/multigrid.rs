//! Multigrid state of a volume while it is coded, lattice by lattice. The points of a lattice are stored in eight parts, by
//! which of their coordinates are odd, so that the neighbors of all points of a row form rows as well.
use super::grid::{Lattice, PointClass, part};

/// Largest number of weights of a class.
pub(super) const WEIGHTS: usize = 7;

/// The part of the volume known so far.
#[derive(Debug)]
pub(super) struct MultigridField {
    /// Parts of the current lattice; the first one is the whole coarser lattice.
    pub parts: [LatticePart; 8],
    /// Dimensions of the current lattice.
    pub lattice: Lattice,
    /// Least and largest value of the volume.
    pub range: [f32; 2],
}

/// Points whose coordinates are odd on the same axes.
#[derive(Debug, Default)]
pub(super) struct LatticePart {
    /// Dimensions.
    pub grid: Lattice,
    /// Values as a decoder reconstructs them; 0 where not yet coded.
    pub values: Vec<f32>,
    /// Residuals in quantizer steps, saturated to -127..=127; 0 where not yet coded.
    pub residuals: Vec<i8>,
}

/// Parameters of a level.
#[derive(Debug, Clone)]
pub(super) struct LevelParams {
    /// 0 for the finest level.
    pub number: usize,
    /// All values are integers, and predictions are rounded to the nearest, halves to even.
    pub integers: bool,
    /// Quantizer step: distance between reconstruction points.
    pub step: f32,
    /// 1 / step.
    pub scale: f32,
    /// Distance by which reconstruction points other than 0 are moved towards 0.
    pub bias: f32,
    /// Prediction weights by class.
    pub weights: [[f32; WEIGHTS]; 7],
    /// By class, the share by which the volume before corrects predictions, if there is one.
    pub temporal: [f32; 7],
}

impl LevelParams {
    /// Predictions as values are told apart.
    #[inline]
    pub(super) fn round(&self, expected: &mut [f32]) {
        if self.integers {
            expected.iter_mut().for_each(|value| *value = value.round_ties_even());
        }
    }
}

/// `value` clamped to a range; NaN gives the least value.
#[inline(always)]
pub(super) fn within([low, high]: [f32; 2], value: f32) -> f32 {
    // Not by `max` and `min`, whose choice between -0 and 0 depends on the machine.
    if value >= low { if value <= high { value } else { high } } else { low }
}

impl LatticePart {
    fn new(grid: Lattice) -> Self {
        Self { grid, values: vec![0.0; grid.count()], residuals: vec![0; grid.count()] }
    }

    /// Values of row (y, z).
    #[inline]
    pub(super) fn row(&self, [y, z]: [usize; 2]) -> &[f32] {
        self.values.get(self.grid.row(y, z)..).map_or(&[], |values| &values[..self.grid.dims[0]])
    }

    /// Residuals of row (y, z).
    #[inline]
    pub(super) fn residuals(&self, [y, z]: [usize; 2]) -> &[i8] {
        self.residuals.get(self.grid.row(y, z)..).map_or(&[], |residuals| &residuals[..self.grid.dims[0]])
    }
}

impl MultigridField {
    /// The lattice that consists of the first voxel alone.
    pub(super) fn new(first: f32, range: [f32; 2]) -> Self {
        let lattice = Lattice { dims: [1; 3] };
        let mut parts: [LatticePart; 8] = Default::default();
        parts[0] = LatticePart { grid: lattice, values: vec![first], residuals: vec![0] };
        Self { parts, lattice, range }
    }

    /// Allocates the new points of the next finer lattice.
    pub(super) fn begin(&mut self, lattice: Lattice) {
        self.lattice = lattice;
        for class in lattice.classes() {
            self.parts[class.part()] = LatticePart::new(lattice.part(class.odd));
        }
    }

    /// Moves the part of a class out, to be changed; the caller puts it back.
    pub(super) fn take(&mut self, class: PointClass) -> LatticePart {
        std::mem::take(&mut self.parts[class.part()])
    }

    /// Interleaves all parts into the first part of the next finer lattice, and residuals if `residuals`.
    pub(super) fn end(&mut self, residuals: bool) {
        let parts = std::mem::take(&mut self.parts);
        let grid = self.lattice;
        let mut values = vec![0.0; grid.count()];
        let mut joined = vec![0; if residuals { grid.count() } else { 0 }];
        for (y, z) in grid.rows() {
            let [even, odd] = [false, true].map(|x| &parts[part([x, y % 2 == 1, z % 2 == 1])]);
            let (at, n) = (grid.row(y, z), grid.dims[0]);
            let place = [y / 2, z / 2];
            interleave(&mut values[at..at + n], even.row(place), odd.row(place));
            if residuals {
                interleave(&mut joined[at..at + n], even.residuals(place), odd.residuals(place));
            }
        }
        self.parts[0] = LatticePart { grid, values, residuals: joined };
    }
}

/// Interleaves two rows; there are as many even points as odd ones, or one more.
fn interleave<T: Copy>(to: &mut [T], even: &[T], odd: &[T]) {
    for (to, (&e, &o)) in to.chunks_exact_mut(2).zip(even.iter().zip(odd)) {
        (to[0], to[1]) = (e, o);
    }
    if let (Some(to), Some(&e), true) = (to.last_mut(), even.last(), even.len() > odd.len()) {
        *to = e;
    }
}
