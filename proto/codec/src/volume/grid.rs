//! Lattices of halving stride, and the classes of points that each lattice adds to the coarser one.

/// Points per side of a block of a class; one flag declares all residuals of a block zero.
pub(super) const BLOCK: usize = 4;

/// Dimensions of a volume or of a lattice of its points, x fastest.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Lattice {
    /// Number of points along x, y, z.
    pub dims: [usize; 3],
}

/// New points of a lattice that share the axes on which their coordinates are odd.
#[derive(Debug, Clone, Copy)]
pub(super) struct PointClass {
    /// Axes on which coordinates are odd.
    pub odd: [bool; 3],
    /// Index of the class within its level, 0..7.
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

impl Lattice {
    /// Number of points.
    pub(super) fn count(&self) -> usize {
        self.dims.iter().product()
    }

    /// Index of the first point of row (`y`, `z`).
    #[inline]
    pub(super) fn row(&self, y: usize, z: usize) -> usize {
        (z * self.dims[1] + y) * self.dims[0]
    }

    /// Number of levels: at stride 2^levels the lattice is the first voxel alone.
    pub(super) fn levels(&self) -> u32 {
        let longest = self.dims.iter().copied().max().unwrap_or(1);
        longest.next_power_of_two().trailing_zeros()
    }

    /// The lattice of stride 2^`level`; level 0 is the volume itself.
    pub(super) fn lattice(&self, level: usize) -> Self {
        Self { dims: self.dims.map(|n| n.div_ceil(1 << level)) }
    }

    /// Dimensions of the part whose coordinates are odd on the axes `odd` and even on the others.
    pub(super) fn part(&self, odd: [bool; 3]) -> Self {
        Self { dims: std::array::from_fn(|a| if odd[a] { self.dims[a] / 2 } else { self.dims[a].div_ceil(2) }) }
    }

    /// Classes of this lattice that are not empty.
    pub(super) fn classes(self) -> impl Iterator<Item = PointClass> {
        let classes = CLASSES.into_iter().enumerate().map(|(number, odd)| PointClass { odd, number });
        classes.filter(move |c| self.part(c.odd).count() > 0)
    }

    /// Number of blocks along each axis.
    pub(super) fn blocks(&self) -> Self {
        Self { dims: self.dims.map(|n| n.div_ceil(2 * BLOCK)) }
    }

    /// All (y, z), y fastest.
    pub(super) fn rows(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let [_, ny, nz] = self.dims;
        (0..nz).flat_map(move |z| (0..ny).map(move |y| (y, z)))
    }
}

impl PointClass {
    /// Number of odd axes, 1..=3.
    pub(super) fn odd_axes(&self) -> usize {
        self.odd.iter().filter(|&&o| o).count()
    }

    /// Index of its part of the lattice, 1..8.
    pub(super) fn part(&self) -> usize {
        part(self.odd)
    }
}

/// Index, 0..8, of the part whose coordinates are odd on the axes `odd`.
pub(super) fn part(odd: [bool; 3]) -> usize {
    (0..3).map(|a| usize::from(odd[a]) << a).sum()
}
