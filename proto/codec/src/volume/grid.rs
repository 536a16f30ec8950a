//! The order of voxels: lattices of halving stride, and on each lattice the classes of points that are new to it.

/// Points of a class along each side of a block that one flag can declare empty of residuals.
pub const BLOCK: usize = 4;

/// Sizes of a volume or a part of it, x fastest.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Grid {
    /// Points along x, y, z.
    pub dims: [usize; 3],
}

/// The new points of a lattice whose coordinates on it are odd on the same axes.
#[derive(Debug, Clone, Copy)]
pub struct Class {
    /// Axes with odd coordinates.
    pub odd: [bool; 3],
    /// Number of the class within its level, 0..7.
    pub number: usize,
}

/// Classes of a level in coding order: one odd axis, then two, then three.
const CLASSES: [[bool; 3]; 7] = [
    [true, false, false],
    [false, true, false],
    [false, false, true],
    [true, true, false],
    [true, false, true],
    [false, true, true],
    [true, true, true],
];

impl Grid {
    /// Number of its points.
    pub fn count(&self) -> usize {
        self.dims.iter().product()
    }

    /// Index of the first point of a row.
    #[inline]
    pub fn row(&self, y: usize, z: usize) -> usize {
        (z * self.dims[1] + y) * self.dims[0]
    }

    /// Number of levels: with a stride of 2 to this power, the lattice is the first voxel alone.
    pub fn levels(&self) -> u32 {
        let longest = self.dims.iter().copied().max().unwrap_or(1);
        longest.next_power_of_two().trailing_zeros()
    }

    /// The lattice with the points of a level, 0 for the finest.
    pub fn lattice(&self, level: usize) -> Self {
        Self { dims: self.dims.map(|n| n.div_ceil(1 << level)) }
    }

    /// Points of a lattice with odd coordinates on the axes `odd` and even ones on the others.
    pub fn part(&self, odd: [bool; 3]) -> Self {
        Self { dims: std::array::from_fn(|a| if odd[a] { self.dims[a] / 2 } else { self.dims[a].div_ceil(2) }) }
    }

    /// Classes of a lattice that have points.
    pub fn classes(self) -> impl Iterator<Item = Class> {
        let classes = CLASSES.into_iter().enumerate().map(|(number, odd)| Class { odd, number });
        classes.filter(move |c| self.part(c.odd).count() > 0)
    }

    /// Blocks of a lattice.
    pub fn blocks(&self) -> Self {
        Self { dims: self.dims.map(|n| n.div_ceil(2 * BLOCK)) }
    }

    /// All y and z, row by row.
    pub fn rows(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let [_, ny, nz] = self.dims;
        (0..nz).flat_map(move |z| (0..ny).map(move |y| (y, z)))
    }
}

impl Class {
    /// Number of odd axes, 1..=3.
    pub fn odds(&self) -> usize {
        self.odd.iter().filter(|&&o| o).count()
    }

    /// Number of its part of a lattice, 1..8.
    pub fn part(&self) -> usize {
        part(self.odd)
    }
}

/// Number of the part of a lattice with these axes odd, 0..8.
pub fn part(odd: [bool; 3]) -> usize {
    (0..3).map(|a| usize::from(odd[a]) << a).sum()
}
