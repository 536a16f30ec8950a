//! Values of fields at the points of a lattice, from domains of any kind, and the parts of them that ranks hand to each other.
//!
//! A field of points is interpolated within its cell, a field of cells is that of the cell that holds the point (as ParaView's
//! "Resample To Image" has it). Each rank takes a slab of the lattice along z, and is sent the values in it.

use crate::cell_mesh::{CellMesh, CellPoints};
use crate::mesh::{Domain, EvenGrid, FieldValues, Geometry};
use glam::{DVec3, Vec3};
use std::ops::Range;

/// A point of the lattice in a cell of a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Located {
    place: u32,
    cell: u32,
    part: u32,
    at: Vec3,
}

/// The cells that the lattice's points lie in.
#[derive(Debug, Default)]
pub(crate) struct CellLocations {
    fingerprint: Option<u64>,
    located: Vec<Located>,
}

impl CellLocations {
    /// Finds them anew, if the mesh is not the one of the last call.
    fn update(&mut self, mesh: &CellMesh, lattice: &EvenGrid) {
        let fingerprint = Some(mesh.fingerprint());
        if self.fingerprint == fingerprint {
            return;
        }
        self.fingerprint = fingerprint;
        self.located.clear();
        let (origin, spacing) = (DVec3::from(lattice.origin), DVec3::from(lattice.spacing));
        let mut cell = CellPoints::default();
        for n in 0..mesh.cells() {
            if mesh.read(n, &mut cell).is_none() || mesh.place(&mut cell).is_none() {
                continue;
            }
            let Some(bounds) = cell.bounds() else { continue };
            let [low, high] = bounds.map(|corner| (corner - origin) / spacing);
            let range = |axis: usize| -> Range<usize> {
                let last = lattice.dims[axis] as f64 - 1.0;
                let first = (low[axis] - 1e-6).ceil().max(0.0);
                let end = (high[axis] + 1e-6).floor().min(last) + 1.0;
                if first < end { first as usize..end as usize } else { 0..0 }
            };
            for k in range(2) {
                for j in range(1) {
                    for i in range(0) {
                        let position = origin + DVec3::new(i as f64, j as f64, k as f64) * spacing;
                        if let Some((part, at)) = cell.locate(position) {
                            let place = (i + lattice.dims[0] * (j + lattice.dims[1] * k)) as u32;
                            self.located.push(Located { place, cell: n as u32, part, at: at.as_vec3() });
                        }
                    }
                }
            }
        }
        // A point on a face is in the first of its cells.
        self.located.sort_unstable_by_key(|located| (located.place, located.cell));
        self.located.dedup_by_key(|located| located.place);
    }
}

/// The lattice in slabs along z, one a rank.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RankSlabs {
    pub(crate) lattice: EvenGrid,
    pub(crate) ranks: u32,
}

impl RankSlabs {
    /// The layers of a rank's slab.
    pub(crate) fn layers(&self, rank: u32) -> Range<usize> {
        let first = |rank: u32| (self.lattice.dims[2] as u64 * u64::from(rank) / u64::from(self.ranks)) as usize;
        first(rank)..first(rank + 1)
    }

    /// Points of one layer.
    pub(crate) fn layer(&self) -> usize {
        self.lattice.dims[0] * self.lattice.dims[1]
    }
}

/// Values of one domain for the slab of one rank.
#[derive(Debug, Default)]
struct Samples {
    places: Vec<u32>,
    /// Of each field.
    values: Vec<Vec<f32>>,
}

/// The values of `domains` for the slab of each rank, as bytes; `more` are further fields on the same domains.
///
/// # Errors
/// If a further field lies on another domain.
pub(crate) fn sampled(
    domains: &[Domain],
    more: &[Vec<Domain>],
    locations: &mut Vec<CellLocations>,
    slabs: &RankSlabs,
) -> Result<Vec<Vec<u8>>, String> {
    let mut bytes = vec![Vec::new(); slabs.ranks as usize];
    locations.resize_with(domains.len(), CellLocations::default);
    for (n, (domain, locations)) in domains.iter().zip(locations).enumerate() {
        let beside: Option<Vec<&Domain>> = more.iter().map(|others| others.get(n)).collect();
        let beside = beside.filter(|beside| beside.iter().all(|other| alike(domain, other)));
        let beside = beside.ok_or("a further field lies on other points than the one that is shown")?;
        let fields: Vec<&FieldValues> =
            std::iter::once(&domain.field).chain(beside.iter().map(|other| &other.field)).collect();
        let mut samples: Vec<Samples> = Vec::new();
        samples.resize_with(bytes.len(), || Samples { values: vec![Vec::new(); fields.len()], ..Samples::default() });
        match &domain.geometry {
            Geometry::EvenGrid(lattice) => {
                sample_lattice(lattice, &fields, domain.ghosts.as_ref(), slabs, |rank, place, n, v| {
                    samples[rank].push(place, n, v)
                });
            }
            Geometry::Cells(mesh) => {
                locations.update(mesh, &slabs.lattice);
                let ghosts = domain.ghosts.as_ref();
                sample_cells(mesh, (&fields, ghosts), &locations.located, slabs, |rank, place, n, v| {
                    samples[rank].push(place, n, v);
                });
            }
        }
        for (samples, bytes) in samples.iter().zip(&mut bytes) {
            samples.write(domain.level.unwrap_or(0), bytes);
        }
    }
    Ok(bytes)
}

/// Whether both lie on the same points or cells.
fn alike(a: &Domain, b: &Domain) -> bool {
    match (&a.geometry, &b.geometry) {
        (Geometry::EvenGrid(a), Geometry::EvenGrid(b)) => a == b,
        (Geometry::Cells(a), Geometry::Cells(b)) => a.cells() == b.cells() && a.points.len() == b.points.len(),
        _ => false,
    }
}

/// Gives `push` the rank, the place in its slab, the field, and the value.
fn sample_cells(
    mesh: &CellMesh,
    (fields, ghosts): (&[&FieldValues], Option<&FieldValues>),
    located: &[Located],
    slabs: &RankSlabs,
    mut push: impl FnMut(usize, u32, usize, f64),
) {
    let mut cell = CellPoints::default();
    let mut rest = located;
    for rank in 0..slabs.ranks {
        let layers = slabs.layers(rank);
        let [first, end] = [layers.start, layers.end].map(|layer| (layer * slabs.layer()) as u64);
        let (own, after) = rest.split_at(rest.partition_point(|located| u64::from(located.place) < end));
        rest = after;
        for located in own {
            if ghosts.is_some_and(|ghosts| ghosts.of(located.cell as usize) != 0.0) {
                continue;
            }
            let place = located.place - first as u32;
            let read =
                fields.iter().all(|field| field.of_cells) || mesh.read(located.cell as usize, &mut cell).is_some();
            for (n, field) in fields.iter().enumerate().filter(|_| read) {
                let value = if field.of_cells {
                    field.of(located.cell as usize)
                } else {
                    cell.interpolate(located.part, located.at.as_dvec3(), |point| field.of(point))
                };
                push(rank as usize, place, n, value);
            }
        }
    }
}

/// As above, for values at the points or in the boxes of a lattice.
fn sample_lattice(
    own: &EvenGrid,
    fields: &[&FieldValues],
    ghosts: Option<&FieldValues>,
    slabs: &RankSlabs,
    mut push: impl FnMut(usize, u32, usize, f64),
) {
    let of_cells = fields[0].of_cells;
    // For each point of the lattice along an axis, the point below it in the domain, and how far it lies towards the next.
    let along: [Vec<Option<(usize, f64)>>; 3] = std::array::from_fn(|axis| {
        let last = own.dims[axis] as f64 - 1.0;
        let (step, first) = (slabs.lattice.spacing[axis], slabs.lattice.origin[axis]);
        let place = |n: usize| {
            let at = (first + n as f64 * step - own.origin[axis]) / own.spacing[axis];
            let beyond = if of_cells { 0.5 } else { 0.0 } + 1e-6;
            if !(at >= -beyond && at <= last + beyond) {
                return None;
            }
            if of_cells {
                return Some(((at + 0.5).floor().clamp(0.0, last) as usize, 0.0));
            }
            let below = at.floor().clamp(0.0, (last - 1.0).max(0.0));
            Some((below as usize, (at - below).clamp(0.0, 1.0)))
        };
        (0..slabs.lattice.dims[axis]).map(place).collect()
    });
    let inside = |axis: usize| {
        let first = along[axis].iter().position(Option::is_some).unwrap_or(0);
        first..first + along[axis].iter().flatten().count()
    };
    let (columns, rows) = (inside(0), inside(1));
    for rank in 0..slabs.ranks {
        let layers = slabs.layers(rank);
        for k in layers.clone() {
            let Some((z, tz)) = along[2][k] else { continue };
            for j in rows.clone() {
                let Some((y, ty)) = along[1][j] else { continue };
                for i in columns.clone() {
                    let Some((x, tx)) = along[0][i] else { continue };
                    if ghosts.is_some_and(|ghosts| ghosts.at([x, y, z]) != 0.0) {
                        continue;
                    }
                    let place = i + slabs.lattice.dims[0] * (j + slabs.lattice.dims[1] * (k - layers.start));
                    for (n, field) in fields.iter().enumerate() {
                        push(rank as usize, place as u32, n, linear(field, own.dims, [x, y, z], [tx, ty, tz]));
                    }
                }
            }
        }
    }
}

/// The value between a point and its next ones, `t` of the way on each axis.
fn linear(field: &FieldValues, dims: [usize; 3], below: [usize; 3], t: [f64; 3]) -> f64 {
    let mut sum = 0.0;
    for corner in 0..8_usize {
        let (mut weight, mut place) = (1.0, below);
        for axis in 0..3 {
            let upper = corner >> axis & 1 == 1;
            weight *= if upper { t[axis] } else { 1.0 - t[axis] };
            place[axis] = (below[axis] + usize::from(upper)).min(dims[axis] - 1);
        }
        // What has no weight has no say, also where it is missing.
        if weight > 0.0 {
            sum += weight * field.at(place);
        }
    }
    sum
}

impl Samples {
    fn push(&mut self, place: u32, field: usize, value: f64) {
        if field == 0 {
            self.places.push(place);
        }
        self.values[field].push(value as f32);
    }

    /// The level, how many, the places, and the values of each field.
    fn write(&self, level: u32, bytes: &mut Vec<u8>) {
        if self.places.is_empty() {
            return;
        }
        bytes.extend(level.to_le_bytes());
        bytes.extend((self.places.len() as u32).to_le_bytes());
        bytes.extend(self.places.iter().flat_map(|place| place.to_le_bytes()));
        for values in &self.values {
            bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        }
    }
}

/// A rank's slab: each field's values, NaN where no rank has any.
#[derive(Debug)]
pub(crate) struct Slab {
    pub(crate) fields: Vec<Vec<f32>>,
    /// One more than the level that a value is of; 0, where there is none.
    levels: Vec<u32>,
}

impl Slab {
    /// Without values.
    pub(crate) fn empty(points: usize, fields: usize) -> Self {
        Self { fields: vec![vec![f32::NAN; points]; fields], levels: vec![0; points] }
    }

    /// Takes in what a rank has sent: a finer level's values before a coarser one's, of two alike those that came first.
    pub(crate) fn take(&mut self, bytes: &[u8]) {
        let (words, _) = bytes.as_chunks::<4>();
        let mut rest = words;
        while let [level, count, after @ ..] = rest {
            let (level, count) = (u32::from_le_bytes(*level).saturating_add(1), u32::from_le_bytes(*count) as usize);
            let Some((places, values)) = after.split_at_checked(count) else { return };
            let Some((values, next)) = values.split_at_checked(count * self.fields.len()) else { return };
            rest = next;
            for (n, place) in places.iter().enumerate() {
                let place = u32::from_le_bytes(*place) as usize;
                let Some(held) = self.levels.get_mut(place).filter(|held| **held < level) else { continue };
                *held = level;
                for (field, slab) in self.fields.iter_mut().enumerate() {
                    slab[place] = f32::from_le_bytes(values[field * count + n]);
                }
            }
        }
    }
}
