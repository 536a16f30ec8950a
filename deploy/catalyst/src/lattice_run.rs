//! A run whose domains are parts of one lattice: their values are handed over where they are.

use crate::conduit::{Element, NodeArray};
use crate::mesh::{Domain, EvenGrid, Geometry};
use crate::partition::{IndexBox, disjoint};
use crate::target::{DomainBounds, Extent};
use lamina_client::{Brick, VoxelSlice, dense, span};
use lamina_model::{Grid, VoxelType};

/// A point off the lattice of the run by more than this part of the spacing lies on another.
const ON_LATTICE: f64 = 1e-2;

/// The parts of the lattice that this rank hands over.
#[derive(Debug)]
pub(crate) struct LatticeRun {
    origin: [f64; 3],
    spacing: [f64; 3],
    /// This rank's domains as they were handed over at first, and the part of each that is its own; all, where none share points.
    parts: Option<Vec<(IndexBox, IndexBox)>>,
    voxel_type: VoxelType,
}

/// The extents, if all are of lattices of one spacing and of no finer level.
pub(crate) fn lattices(extents: &[Vec<Extent>]) -> Option<Vec<EvenGrid>> {
    let all = extents.iter().flatten().map(|extent| match extent.place {
        DomainBounds::EvenGrid { lattice, .. } if !extent.is_resampled => Some(lattice),
        _ => None,
    });
    let all = all.collect::<Option<Vec<EvenGrid>>>()?;
    let first = all.first()?.spacing;
    let alike = |lattice: &EvenGrid| {
        (0..3).all(|axis| {
            (lattice.spacing[axis] - first[axis]).abs() * lattice.dims[axis] as f64 <= ON_LATTICE * first[axis]
        })
    };
    all.iter().all(alike).then_some(all)
}

impl LatticeRun {
    /// Of the domains of all ranks, `before` of which are of the ranks before this one and `own` of this; with the grid of the run. Several
    /// fields are copied, to lie in memory alike.
    pub(crate) fn new(
        all: &[EvenGrid],
        before: usize,
        own: usize,
        voxel_type: VoxelType,
    ) -> Result<(Self, Grid), String> {
        let spacing = all[0].spacing;
        let origin = std::array::from_fn(|axis| all.iter().map(|l| l.origin[axis]).fold(f64::INFINITY, f64::min));
        let mut boxes = Vec::new();
        for lattice in all {
            boxes.push(index_box(lattice, origin, spacing)?);
        }
        let shares = disjoint(&boxes)?;
        let hull = IndexBox::around(&boxes).ok_or("no domain")?;
        let mine = before..before + own;
        let parts = boxes[mine.clone()].iter().copied().zip(shares[mine].iter().copied()).collect();
        let dims = hull.dims().map(|points| points as usize);
        let grid = EvenGrid { origin, spacing, dims }.grid()?;
        let parts = (boxes != shares).then_some(parts);
        Ok((Self { origin, spacing, parts, voxel_type }, grid))
    }

    /// Hands the step over: the field on its domains, and the `more` fields on the same.
    pub(crate) fn push(
        &self,
        domains: &[Domain],
        more: &[Vec<Domain>],
        hand_over: impl FnOnce(&[Brick<'_>]) -> Result<(), String>,
    ) -> Result<(), String> {
        let several = !more.is_empty();
        let mut whole = Vec::new();
        for domain in domains {
            whole.push(GridValues::of(domain)?);
        }
        let mut others = Vec::new();
        for domains in more {
            others.push(domains.iter().map(GridValues::of).collect::<Result<Vec<_>, _>>()?);
        }
        let copies = |all: &[GridValues<'_>]| -> Vec<Option<Vec<f64>>> {
            all.iter().map(|values| values.converted(self.voxel_type, several)).collect()
        };
        let (own, beside) = (copies(&whole), others.iter().map(|all| copies(all)).collect::<Vec<_>>());
        let (mut places, mut of_bricks) = (Vec::new(), Vec::new());
        for (n, (values, converted)) in whole.iter().zip(&own).enumerate() {
            let all = index_box(&values.lattice, self.origin, self.spacing)?;
            let part = match &self.parts {
                None => all,
                Some(parts) => {
                    let known = parts.iter().find(|(before, _)| *before == all);
                    known
                        .ok_or("domains that share points have changed since the first step; this step is not shown")?
                        .1
                }
            };
            if part.dims().iter().any(|points| *points <= 0) {
                continue;
            }
            let skipped = std::array::from_fn(|axis| (part.start[axis] - all.start[axis]) as usize);
            let dims = part.dims().map(|n| n as usize);
            let voxels = values.voxels(converted.as_deref(), skipped, dims, self.voxel_type)?;
            places.push((part.start.map(|n| n as usize), dims, voxels));
            let mut further = Vec::new();
            for (other, copies) in others.iter().zip(&beside) {
                let there = other.get(n).filter(|other| other.lattice == values.lattice);
                let there = there.ok_or("a further field lies on other points than the one that is shown")?;
                further.push(there.voxels(copies[n].as_deref(), skipped, dims, self.voxel_type)?.0);
            }
            of_bricks.push(further);
        }
        let mut bricks = Vec::new();
        for ((start, dims, (voxels, strides)), further) in places.into_iter().zip(&of_bricks) {
            bricks.push(Brick::new(start, dims, voxels).with_strides(strides).with_more_fields(further));
        }
        hand_over(&bricks)
    }
}

/// A domain that is a lattice.
struct GridValues<'a> {
    lattice: EvenGrid,
    domain: &'a Domain,
}

impl<'a> GridValues<'a> {
    fn of(domain: &'a Domain) -> Result<Self, String> {
        match &domain.geometry {
            Geometry::EvenGrid(lattice) => Ok(Self { lattice: *lattice, domain }),
            Geometry::Cells(_) => Err("the mesh was evenly spaced at the first step, and is no more".to_owned()),
        }
    }

    /// Values as double precision, where they cannot be handed over as they are, or are not to be.
    fn converted(&self, voxel_type: VoxelType, always: bool) -> Option<Vec<f64>> {
        let array = &self.domain.field.array;
        let aligned = array.stride_bytes.is_multiple_of(array.element.size_bytes())
            && (array.first as usize).is_multiple_of(array.element.size_bytes());
        if !always && aligned && array.element.voxel_type() == Some(voxel_type) {
            return None;
        }
        let [x, y, z] = self.lattice.dims;
        let mut values = Vec::with_capacity(x * y * z);
        for k in 0..z {
            for j in 0..y {
                values.extend((0..x).map(|i| self.domain.field.at([i, j, k])));
            }
        }
        Some(values)
    }

    /// The voxels of the box of `dims` points from point `skipped` on, and how far neighbors lie apart.
    fn voxels<'v>(
        &self,
        converted: Option<&'v [f64]>,
        skipped: [usize; 3],
        dims: [usize; 3],
        voxel_type: VoxelType,
    ) -> Result<(VoxelSlice<'v>, [usize; 3]), String>
    where
        'a: 'v,
    {
        let offset = |strides: [usize; 3]| skipped.iter().zip(strides).map(|(n, stride)| n * stride).sum::<usize>();
        let reach = |strides| span(dims, strides).map_err(|e| e.to_string());
        if let Some(values) = converted {
            if voxel_type != VoxelType::F64 {
                return Err("values are of another type than at the first step".to_owned());
            }
            let strides = dense(self.lattice.dims);
            return Ok((VoxelSlice::F64(&values[offset(strides)..][..reach(strides)?]), strides));
        }
        let field = &self.domain.field;
        let apart = field.array.stride_bytes / field.array.element.size_bytes();
        let strides = field.layout.strides.map(|stride| stride * apart);
        Ok((slice(&field.array, field.layout.first * apart + offset(strides), reach(strides)?), strides))
    }
}

/// `len` elements in memory from number `start` on: the mesh has checked that they lie within what Conduit says is there.
fn slice<'a>(array: &NodeArray, start: usize, len: usize) -> VoxelSlice<'a> {
    /// The same of one type.
    macro_rules! of {
        ($variant:ident, $scalar:ty) => {{
            // SAFETY: Conduit says that the elements lie there until the call ends; they are aligned, as was checked.
            VoxelSlice::$variant(unsafe { std::slice::from_raw_parts(array.first.cast::<$scalar>().add(start), len) })
        }};
    }
    match array.element {
        Element::U8 => of!(U8, u8),
        Element::U16 => of!(U16, u16),
        Element::I16 => of!(I16, i16),
        Element::F32 => of!(F32, f32),
        _ => of!(F64, f64),
    }
}

/// A domain's points on the lattice from `origin` on.
fn index_box(own: &EvenGrid, origin: [f64; 3], spacing: [f64; 3]) -> Result<IndexBox, String> {
    let mut start = [0; 3];
    for axis in 0..3 {
        let (step, of_own) = (spacing[axis], own.spacing[axis]);
        if (of_own - step).abs() * own.dims[axis] as f64 > ON_LATTICE * step {
            return Err(format!(
                "domains are spaced {of_own} and {step} apart along one axis, and were alike at the first step"
            ));
        }
        let at = (own.origin[axis] - origin[axis]) / step;
        if (at - at.round()).abs() > ON_LATTICE || at.abs() > 1e9 {
            let first = own.origin;
            return Err(format!(
                "a domain at {first:?} does not lie on the lattice from {origin:?}, {spacing:?} apart; state points to have it resampled"
            ));
        }
        start[axis] = at.round() as i64;
    }
    let end = std::array::from_fn(|axis| start[axis] + own.dims[axis] as i64);
    Ok(IndexBox { start, end })
}
