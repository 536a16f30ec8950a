//! A volume in the making, lattice by lattice. The points of a lattice lie in eight parts, by which of their
//! coordinates are odd, so that the neighbours of all points of a row are rows as well.
use super::grid::{Class, Grid, part};
use super::predict::WEIGHTS;

/// What is known of the volume.
#[derive(Debug)]
pub struct Field {
    /// Parts of the present lattice; the first is the whole lattice before.
    pub parts: [Part; 8],
    /// Sizes of the present lattice.
    pub lattice: Grid,
    /// All values lie within.
    pub range: [f32; 2],
}

/// Points with the same axes odd.
#[derive(Debug, Default)]
pub struct Part {
    /// Its sizes.
    pub grid: Grid,
    /// Values as a decoder has them; 0 where not yet met.
    pub values: Vec<f32>,
    /// Residuals in quantiser steps, saturated; 0 where not yet met.
    pub marks: Vec<i8>,
}

/// What holds for all points of a level.
#[derive(Debug, Clone)]
pub struct Level {
    /// 0 for the finest level.
    pub number: usize,
    /// Distance of reconstruction points.
    pub step: f32,
    /// One over the step.
    pub scale: f32,
    /// How far the reconstruction points other than 0 are moved towards 0.
    pub bias: f32,
    /// Weights of the prediction by class.
    pub weights: [[f32; WEIGHTS]; 7],
}

/// `value` within a range; its least where it is no number.
#[inline(always)]
pub fn within([low, high]: [f32; 2], value: f32) -> f32 {
    // Not by `max` and `min`: which of -0 and 0 they give is up to the machine.
    if value >= low { if value <= high { value } else { high } } else { low }
}

impl Part {
    fn new(grid: Grid) -> Self {
        Self { grid, values: vec![0.0; grid.count()], marks: vec![0; grid.count()] }
    }

    /// Values of the row at y, z.
    #[inline]
    pub fn row(&self, [y, z]: [usize; 2]) -> &[f32] {
        self.values.get(self.grid.row(y, z)..).map_or(&[], |values| &values[..self.grid.dims[0]])
    }

    /// Marks of the row at y, z.
    #[inline]
    pub fn marks(&self, [y, z]: [usize; 2]) -> &[i8] {
        self.marks.get(self.grid.row(y, z)..).map_or(&[], |marks| &marks[..self.grid.dims[0]])
    }
}

impl Field {
    /// The lattice of the first voxel alone.
    pub fn new(first: f32, range: [f32; 2]) -> Self {
        let lattice = Grid { dims: [1; 3] };
        let mut parts: [Part; 8] = Default::default();
        parts[0] = Part { grid: lattice, values: vec![first], marks: vec![0] };
        Self { parts, lattice, range }
    }

    /// Makes room for the new points of the next lattice.
    pub fn begin(&mut self, lattice: Grid) {
        self.lattice = lattice;
        for class in lattice.classes() {
            self.parts[class.part()] = Part::new(lattice.part(class.odd));
        }
    }

    /// Takes a class out, to change it; it is put back by its number.
    pub fn take(&mut self, class: Class) -> Part {
        std::mem::take(&mut self.parts[class.part()])
    }

    /// Joins the parts into the first part of the next lattice, with marks if there is another.
    pub fn end(&mut self, marks: bool) {
        let parts = std::mem::take(&mut self.parts);
        let grid = self.lattice;
        let mut values = vec![0.0; grid.count()];
        let mut joined = vec![0; if marks { grid.count() } else { 0 }];
        for (y, z) in grid.rows() {
            let [even, odd] = [false, true].map(|x| &parts[part([x, y % 2 == 1, z % 2 == 1])]);
            let (at, n) = (grid.row(y, z), grid.dims[0]);
            let place = [y / 2, z / 2];
            interleave(&mut values[at..at + n], even.row(place), odd.row(place));
            if marks {
                interleave(&mut joined[at..at + n], even.marks(place), odd.marks(place));
            }
        }
        self.parts[0] = Part { grid, values, marks: joined };
    }
}

/// One of each in turn; there are as many even ones as odd ones or one more.
fn interleave<T: Copy>(to: &mut [T], even: &[T], odd: &[T]) {
    for (to, (&e, &o)) in to.chunks_exact_mut(2).zip(even.iter().zip(odd)) {
        (to[0], to[1]) = (e, o);
    }
    if let (Some(to), Some(&e), true) = (to.last_mut(), even.last(), even.len() > odd.len()) {
        *to = e;
    }
}
