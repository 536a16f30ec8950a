//! The lattice on which a mesh is shown that is none itself: as many sample points as the mesh has cells, those of the finest level of an
//! adaptive mesh, or as many as are stated.

use crate::mesh::{Domain, EvenGrid, Geometry};
use lamina_model::VoxelType;

/// Fewest and most sample points where none are stated.
const FEWEST: f64 = 32_768.0;
const MOST: f64 = 4_194_304.0;
/// Most that may be stated: places are numbers of 32 bits.
const STATED_MOST: f64 = 2_147_483_648.0;
/// Types by the numbers that ranks tell each other.
const TYPES: [VoxelType; 5] = [VoxelType::U8, VoxelType::U16, VoxelType::I16, VoxelType::F32, VoxelType::F64];

/// Where a domain lies, as it is told to all ranks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Extent {
    pub(crate) place: DomainBounds,
    pub(crate) voxel_type: VoxelType,
    /// It has a level, or ghost cells that are marked: its values are not handed over as they are.
    pub(crate) is_resampled: bool,
}

/// Of a lattice, or of a mesh of cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum DomainBounds {
    EvenGrid { lattice: EvenGrid, of_cells: bool },
    Box { lower: [f64; 3], upper: [f64; 3], cells: f64, of_cells: bool },
}

impl Extent {
    /// None, where no point of the domain is anywhere.
    pub(crate) fn of(domain: &Domain) -> Option<Self> {
        let place = match &domain.geometry {
            Geometry::EvenGrid(lattice) => {
                DomainBounds::EvenGrid { lattice: *lattice, of_cells: domain.field.of_cells }
            }
            Geometry::Cells(mesh) => {
                let [lower, upper] = mesh.points.bounds()?.map(Into::into);
                DomainBounds::Box { lower, upper, cells: mesh.cells() as f64, of_cells: domain.field.of_cells }
            }
        };
        let is_resampled = domain.level.is_some() || domain.ghosts.is_some();
        Some(Self { place, voxel_type: domain.voxel_type(), is_resampled })
    }

    /// Twelve numbers.
    pub(crate) fn to_bytes(self) -> Vec<u8> {
        let (kind, numbers) = match self.place {
            DomainBounds::EvenGrid { lattice: EvenGrid { origin, spacing, dims }, of_cells } => {
                (f64::from(u8::from(of_cells)), [origin, spacing, dims.map(|d| d as f64)])
            }
            DomainBounds::Box { lower, upper, cells, of_cells } => {
                (2.0, [lower, upper, [cells, f64::from(u8::from(of_cells)), 0.0]])
            }
        };
        let voxel_type = TYPES.iter().position(|t| *t == self.voxel_type).unwrap_or(4) as f64;
        let all = [kind, voxel_type, f64::from(u8::from(self.is_resampled))].into_iter().chain(numbers.concat());
        all.flat_map(f64::to_le_bytes).collect()
    }

    /// The extents that were written one after the other.
    pub(crate) fn read_all(bytes: &[u8]) -> Vec<Self> {
        let numbers: Vec<f64> = bytes.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
        let one = |n: &[f64; 12]| {
            let [a, b, c] = [3, 6, 9].map(|first| [n[first], n[first + 1], n[first + 2]]);
            let place = if n[0] < 2.0 {
                let lattice = EvenGrid { origin: a, spacing: b, dims: c.map(|d| d as usize) };
                DomainBounds::EvenGrid { lattice, of_cells: n[0] == 1.0 }
            } else {
                DomainBounds::Box { lower: a, upper: b, cells: c[0], of_cells: c[1] == 1.0 }
            };
            Self { place, voxel_type: TYPES[(n[1] as usize).min(4)], is_resampled: n[2] == 1.0 }
        };
        numbers.as_chunks().0.iter().map(one).collect()
    }

    /// The box it fills: cells reach beyond their centers.
    fn bounds(&self) -> [[f64; 3]; 2] {
        match self.place {
            DomainBounds::Box { lower, upper, .. } => [lower, upper],
            DomainBounds::EvenGrid { lattice: EvenGrid { origin, spacing, dims }, of_cells } => {
                let beyond = if of_cells { 0.5 } else { 0.0 };
                let end = |axis: usize, n: f64| origin[axis] + n * spacing[axis];
                let lower = std::array::from_fn(|axis| end(axis, -beyond));
                [lower, std::array::from_fn(|axis| end(axis, dims[axis] as f64 - 1.0 + beyond))]
            }
        }
    }
}

/// What the user states: sample points per axis, or along the longest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum StatedPoints {
    Longest(usize),
    Each([usize; 3]),
}

impl StatedPoints {
    /// `128`, or `96 48 48`, apart by blanks, commas or `x`.
    ///
    /// # Errors
    /// If it is neither, or fewer than 2 or more than 4096 along an axis.
    pub(crate) fn parse(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<usize>, _> =
            text.split([' ', ',', 'x']).filter(|part| !part.is_empty()).map(str::parse).collect();
        let numbers = numbers.unwrap_or_default();
        let stated = match numbers[..] {
            [longest] => Some(Self::Longest(longest)),
            [x, y, z] => Some(Self::Each([x, y, z])),
            _ => None,
        };
        stated.filter(|_| numbers.iter().all(|n| (2..=4096).contains(n))).ok_or_else(|| {
            format!("points \"{text}\": state how many along the longest axis, or along each of three, from 2 to 4096")
        })
    }
}

/// The lattice for domains of these extents, the same on all ranks.
///
/// # Errors
/// If they fill no volume.
pub(crate) fn lattice(extents: &[Extent], stated: Option<StatedPoints>) -> Result<EvenGrid, String> {
    let lattice = chosen(extents, stated)?;
    let points: f64 = lattice.dims.iter().map(|d| *d as f64).product();
    if points > STATED_MOST {
        return Err(format!("{:?} are {points} points; at most {STATED_MOST} are shown: state fewer", lattice.dims));
    }
    Ok(lattice)
}

fn chosen(extents: &[Extent], stated: Option<StatedPoints>) -> Result<EvenGrid, String> {
    let (mut lower, mut upper) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for extent in extents {
        let [low, high] = extent.bounds();
        for axis in 0..3 {
            lower[axis] = lower[axis].min(low[axis]);
            upper[axis] = upper[axis].max(high[axis]);
        }
    }
    let size: [f64; 3] = std::array::from_fn(|axis| upper[axis] - lower[axis]);
    if size.iter().any(|length| !length.is_finite() || *length <= 0.0) {
        return Err(format!("the mesh from {lower:?} to {upper:?} is no volume"));
    }
    // Points for values of cells are in the middle of boxes that fill the mesh; those for values of points reach to its ends.
    let of_cells = extents.iter().any(|extent| match extent.place {
        DomainBounds::EvenGrid { of_cells, .. } | DomainBounds::Box { of_cells, .. } => of_cells,
    });
    let ends = usize::from(!of_cells);
    let divided = |steps: [usize; 3]| {
        let spacing: [f64; 3] = std::array::from_fn(|axis| size[axis] / steps[axis] as f64);
        let first = if of_cells { 0.5 } else { 0.0 };
        let origin = std::array::from_fn(|axis| lower[axis] + first * spacing[axis]);
        EvenGrid { origin, spacing, dims: steps.map(|n| n + ends) }
    };
    let cubic = |edge: f64| divided(size.map(|length| ((length / edge).round().max(1.0) as usize).min(4096)));
    match stated {
        Some(StatedPoints::Each(dims)) => return Ok(divided(dims.map(|n| n - ends))),
        Some(StatedPoints::Longest(points)) => {
            return Ok(cubic(size.into_iter().fold(0.0, f64::max) / (points - ends) as f64));
        }
        None => {}
    }
    let lattices: Option<Vec<EvenGrid>> = extents
        .iter()
        .map(|extent| match extent.place {
            DomainBounds::EvenGrid { lattice, .. } => Some(lattice),
            DomainBounds::Box { .. } => None,
        })
        .collect();
    if let Some(lattices) = lattices {
        return Ok(finest(&lattices, of_cells, lower, size));
    }
    let cells: f64 = extents
        .iter()
        .map(|extent| match extent.place {
            DomainBounds::Box { cells, .. } => cells,
            DomainBounds::EvenGrid { lattice, .. } => lattice.dims.iter().map(|d| *d as f64).product(),
        })
        .sum();
    Ok(cubic((size.iter().product::<f64>() / cells.clamp(FEWEST, MOST)).cbrt()))
}

/// The lattice of the finest level over the whole mesh, coarser by twos where that has too many points.
fn finest(lattices: &[EvenGrid], of_cells: bool, lower: [f64; 3], size: [f64; 3]) -> EvenGrid {
    let mut spacing = [f64::INFINITY; 3];
    for lattice in lattices {
        for (least, own) in spacing.iter_mut().zip(lattice.spacing) {
            *least = least.min(own);
        }
    }
    loop {
        let dims: [usize; 3] = std::array::from_fn(|axis| {
            let steps = (size[axis] / spacing[axis]).round() as usize;
            (steps + usize::from(!of_cells)).max(1)
        });
        if dims.iter().map(|d| *d as f64).product::<f64>() <= MOST {
            let first = if of_cells { 0.5 } else { 0.0 };
            return EvenGrid { origin: std::array::from_fn(|axis| lower[axis] + first * spacing[axis]), spacing, dims };
        }
        spacing = spacing.map(|step| 2.0 * step);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of_lattice(origin: [f64; 3], step: f64, dims: [usize; 3], of_cells: bool, is_resampled: bool) -> Extent {
        let lattice = EvenGrid { origin, spacing: [step; 3], dims };
        Extent { place: DomainBounds::EvenGrid { lattice, of_cells }, voxel_type: VoxelType::F32, is_resampled }
    }

    fn of_box(upper: [f64; 3], cells: f64) -> Extent {
        let place = DomainBounds::Box { lower: [0.0; 3], upper, cells, of_cells: true };
        Extent { place, voxel_type: VoxelType::F64, is_resampled: false }
    }

    #[test]
    fn an_adaptive_mesh_is_shown_on_its_finest_level() {
        // 8 cells of 1.0 a side, and 4 of 0.5 within.
        let coarse = of_lattice([0.5; 3], 1.0, [8; 3], true, true);
        let fine = of_lattice([2.25; 3], 0.5, [4; 3], true, true);
        let shown = lattice(&[coarse, fine], None).unwrap();
        assert_eq!(shown, EvenGrid { origin: [0.25; 3], spacing: [0.5; 3], dims: [16; 3] });
        let of_points =
            [of_lattice([0.0; 3], 1.0, [9; 3], false, true), of_lattice([2.0; 3], 0.5, [5; 3], false, true)];
        let shown = lattice(&of_points, None).unwrap();
        assert_eq!(shown, EvenGrid { origin: [0.0; 3], spacing: [0.5; 3], dims: [17; 3] });
    }

    #[test]
    fn a_finest_level_of_too_many_points_is_shown_coarser() {
        let fine = of_lattice([0.5; 3], 1.0, [512; 3], true, true);
        let shown = lattice(&[fine], None).unwrap();
        assert_eq!(shown, EvenGrid { origin: [2.0; 3], spacing: [4.0; 3], dims: [128; 3] });
    }

    #[test]
    fn cells_are_shown_on_as_many_points_and_a_stated_number_is_kept() {
        let mesh = of_box([4.0, 2.0, 1.0], 64_000.0);
        let shown = lattice(&[mesh], None).unwrap();
        assert_eq!(shown.dims, [80, 40, 20]);
        let shown = lattice(&[mesh], Some(StatedPoints::Longest(16))).unwrap();
        assert_eq!(shown, EvenGrid { origin: [0.125; 3], spacing: [0.25; 3], dims: [16, 8, 4] });
        let shown = lattice(&[mesh], Some(StatedPoints::Each([4, 4, 4]))).unwrap();
        assert_eq!(shown.spacing, [1.0, 0.5, 0.25]);
        let place = DomainBounds::Box { lower: [0.0; 3], upper: [4.0, 2.0, 1.0], cells: 64_000.0, of_cells: false };
        let of_points = Extent { place, ..mesh };
        let shown = lattice(&[of_points], None).unwrap();
        assert_eq!(shown, EvenGrid { origin: [0.0; 3], spacing: [0.05; 3], dims: [81, 41, 21] });
        assert_eq!(lattice(&[of_points], Some(StatedPoints::Longest(17))).unwrap().dims, [17, 9, 5]);
        assert!(lattice(&[of_box([1.0, 1.0, 0.0], 5.0)], None).unwrap_err().contains("no volume"));
    }

    #[test]
    fn extents_are_read_as_they_were_written() {
        let all = [of_lattice([0.5, 1.0, -2.0], 0.25, [3, 4, 5], true, true), of_box([1.0, 2.0, 3.0], 7.0)];
        let bytes: Vec<u8> = all.iter().flat_map(|extent| extent.to_bytes()).collect();
        assert_eq!(Extent::read_all(&bytes), all);
    }

    #[test]
    fn stated_points_are_one_number_or_three() {
        assert_eq!(StatedPoints::parse("128"), Ok(StatedPoints::Longest(128)));
        assert_eq!(StatedPoints::parse("96 x 48, 32"), Ok(StatedPoints::Each([96, 48, 32])));
        let stated = Some(StatedPoints::Longest(4096));
        assert!(lattice(&[of_box([1.0; 3], 5.0)], stated).unwrap_err().contains("at most 2147483648"));
        for wrong in ["", "1", "96 48", "1e9", "5000", "-3 4 5", "a b c"] {
            assert!(StatedPoints::parse(wrong).unwrap_err().contains("longest axis"), "{wrong}");
        }
    }
}
