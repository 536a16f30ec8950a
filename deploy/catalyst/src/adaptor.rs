//! A run: opened at the first step, when the domains of all ranks are known.

use crate::conduit::{Element, Node, NodeArray};
use crate::mesh::{self, Domain, Values};
use crate::options::CatalystOptions;
use crate::partition::{IndexBox, disjoint};
use crate::ranks::Ranks;
use glam::DVec3;
use lamina_client::{Brick, Client, ClientError, Receipt, RunOptions, VoxelSlice, dense, span};
use lamina_model::{Grid, SteeringRequest, VoxelType};

/// A point off the lattice of the run by more than this part of the spacing lies on another.
const ON_LATTICE: f64 = 1e-2;

/// The simulation as Catalyst sees it.
pub(crate) struct Adaptor {
    options: CatalystOptions,
    ranks: Ranks,
    run: Option<OpenRun>,
    /// The ranks know each other's domains: there is no second collective call.
    gathered: bool,
    /// Calls of `catalyst_execute`, which number steps that have no number.
    calls: u64,
    lost: u64,
    /// What people who watch want: `pause` holds until `resume`.
    paused: bool,
    stop: bool,
    numbers: Vec<(String, f64)>,
}

/// An open run.
struct OpenRun {
    client: Client,
    field: String,
    origin: [f64; 3],
    spacing: [f64; 3],
    /// This rank's domains as they were handed over at first, and the part of each that is its own; all, where none share points.
    parts: Option<Vec<(IndexBox, IndexBox)>>,
    voxel_type: VoxelType,
}

impl Adaptor {
    /// By the parameters of `catalyst_initialize`.
    pub(crate) fn new(params: &Node) -> Result<Self, String> {
        let (options, ranks) = (CatalystOptions::read(params), Ranks::of(params)?);
        let numbers = options.steering.iter().flatten().map(|number| (number.name.clone(), number.value)).collect();
        Ok(Self { options, ranks, run: None, gathered: false, calls: 0, lost: 0, paused: false, stop: false, numbers })
    }

    /// Hands the step over.
    pub(crate) fn execute(&mut self, params: &Node) -> Result<(), String> {
        let call = self.calls;
        self.calls += 1;
        let step = ["timestep", "cycle"].into_iter().find_map(|name| params.number(&format!("catalyst/state/{name}")));
        let step = step.filter(|step| *step >= 0.0).map_or(call, |step| step as u64);
        let time = params.number("catalyst/state/time").unwrap_or(step as f64);
        let channels = params.at("catalyst/channels").map(|node| node.children()).unwrap_or_default();
        let wanted = self.options.channel.as_deref();
        let channel = channels.iter().find(|(name, _)| wanted.is_none_or(|wanted| name == wanted));
        let found = match channel {
            Some((name, node)) => mesh::domains(node, name, self.options.field.as_deref()),
            None => {
                let names = channels.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ");
                Err(format!("no channel {}; there are: {names}", wanted.unwrap_or("at all")))
            }
        };
        if !self.gathered {
            // All ranks take part, also one whose own mesh cannot be shown: nobody waits for it.
            self.open(&found)?;
        }
        let (domains, ..) = found?;
        let of_more = |(_, field): &(String, String)| match channel {
            Some((name, node)) => Ok(mesh::domains(node, name, Some(field))?.0),
            None => Ok(Vec::new()),
        };
        let more = self.options.more_fields.iter().map(of_more).collect::<Result<Vec<_>, String>>();
        let run =
            self.run.as_mut().ok_or("this rank took no part when the run was opened, at the first step; see above")?;
        match more.and_then(|more| run.push(step, time, &domains, &more)) {
            Ok(()) => Ok(()),
            Err(error) => {
                self.lost += 1;
                Err(error)
            }
        }
    }

    /// Opens the run on the grid that holds the domains of all ranks. Collective, once.
    fn open(&mut self, found: &Result<(Vec<Domain>, Option<String>, usize), String>) -> Result<(), String> {
        let own: &[Domain] = found.as_ref().map_or(&[], |(domains, ..)| domains);
        let gathered = self.ranks.gather(&placed_bytes(own))?;
        let placed: Vec<Vec<Placed>> = gathered.iter().map(|bytes| read_placed(bytes)).collect();
        let all = || placed.iter().flatten();
        let Some(first) = all().next() else {
            found.as_ref().map_err(Clone::clone)?;
            return Err("no rank has a domain with the field yet".to_owned());
        };
        self.gathered = true;
        let (domains, field, finer) = found.as_ref().map_err(Clone::clone)?;
        if *finer > 0 && self.ranks.rank == 0 {
            eprintln!(
                "lamina: the coarsest level of the adaptive mesh is shown; {finer} finer domains of rank 0 are left out"
            );
        }
        let spacing = first.spacing;
        let origin = std::array::from_fn(|axis| all().map(|p| p.origin[axis]).fold(f64::INFINITY, f64::min));
        let mut boxes = Vec::new();
        for place in all() {
            boxes.push(index_box(place, origin, spacing)?);
        }
        let shares = disjoint(&boxes)?;
        let hull = IndexBox::around(&boxes).ok_or("no domain")?;
        let before: usize = placed[..self.ranks.rank as usize].iter().map(Vec::len).sum();
        let mine = before..before + domains.len();
        let parts = boxes[mine.clone()].iter().copied().zip(shares[mine].iter().copied()).collect();
        // Several fields are copied, to lie in memory alike.
        let several = !self.options.more_fields.is_empty();
        let voxel_type = if several { VoxelType::F64 } else { first.voxel_type };
        let dims = hull.dims().map(|points| points as usize);
        let grid = Grid::new(dims, DVec3::from(spacing), DVec3::from(origin)).map_err(|e| e.to_string())?;
        let field = field.clone().or_else(|| self.options.field.clone()).unwrap_or_else(|| "field".to_owned());
        let mut run = RunOptions {
            rank: self.ranks.rank,
            ranks: self.ranks.size,
            credentials: self.options.credentials.clone(),
            more_fields: self.options.more_fields.iter().map(|(name, _)| (name.clone(), VoxelType::F64)).collect(),
            shown: self.options.shown.clone(),
            steering: self.options.steering.clone().filter(|_| self.ranks.rank == 0),
            ..RunOptions::new(&self.options.generator, &self.options.name, &field, grid, voxel_type)
        };
        run.deadline = self.options.deadline.unwrap_or(run.deadline);
        let client = Client::connect(run).map_err(|e| e.to_string())?;
        let parts = (boxes != shares).then_some(parts);
        self.run = Some(OpenRun { client, field, origin, spacing, parts, voxel_type });
        Ok(())
    }

    /// What people who watch have asked for, into the node of `catalyst_results`.
    pub(crate) fn results(&mut self, results: &Node) {
        let requests = self.run.as_mut().map(|run| run.client.steering()).unwrap_or_default();
        for request in requests {
            match request.request {
                SteeringRequest::Pause => self.paused = true,
                SteeringRequest::Resume => self.paused = false,
                SteeringRequest::Stop => self.stop = true,
                SteeringRequest::Set { name, value } => {
                    if let Some(number) = self.numbers.iter_mut().find(|(known, _)| *known == name) {
                        number.1 = value;
                    }
                }
            }
        }
        results.set_number("lamina/steering/pause", f64::from(u8::from(self.paused)));
        results.set_number("lamina/steering/stop", f64::from(u8::from(self.stop)));
        for (name, value) in &self.numbers {
            results.set_number(&format!("lamina/steering/numbers/{name}"), *value);
        }
    }

    /// Ends the run, and says what was lost.
    pub(crate) fn finish(self) -> Result<(), String> {
        let Some(run) = self.run else { return Ok(()) };
        let summary = run.client.close();
        let lost = summary.lost.max(self.lost);
        if lost > 0 { Err(format!("{lost} of {} steps were lost", self.calls)) } else { Ok(()) }
    }
}

impl OpenRun {
    /// Hands the step over: the field on its domains, and the `more` fields on the same.
    fn push(&mut self, step: u64, time: f64, domains: &[Domain], more: &[Vec<Domain>]) -> Result<(), String> {
        let several = !more.is_empty();
        let copies = |domains: &[Domain]| -> Vec<Option<Vec<f64>>> {
            domains.iter().map(|d| converted(d, self.voxel_type, several)).collect()
        };
        let (own, others) = (copies(domains), more.iter().map(|domains| copies(domains)).collect::<Vec<_>>());
        let (mut places, mut of_bricks) = (Vec::new(), Vec::new());
        for (n, (domain, converted)) in domains.iter().zip(&own).enumerate() {
            let place = Placed::of(domain);
            let whole = index_box(&place, self.origin, self.spacing)?;
            let part = match &self.parts {
                None => whole,
                Some(parts) => {
                    let known = parts.iter().find(|(before, _)| *before == whole);
                    known
                        .ok_or("domains that share points have changed since the first step; this step is not shown")?
                        .1
                }
            };
            if part.dims().iter().any(|points| *points <= 0) {
                continue;
            }
            let skipped = std::array::from_fn(|axis| (part.start[axis] - whole.start[axis]) as usize);
            let dims = part.dims().map(|n| n as usize);
            places.push((
                part.start.map(|n| n as usize),
                dims,
                voxels(domain, converted.as_deref(), skipped, dims, self.voxel_type)?,
            ));
            let mut beside = Vec::new();
            for (other, copies) in more.iter().zip(&others) {
                let there = other.get(n).filter(|other| (other.dims, other.origin) == (domain.dims, domain.origin));
                let there = there.ok_or("a further field lies on other points than the one that is shown")?;
                beside.push(voxels(there, copies[n].as_deref(), skipped, dims, self.voxel_type)?.0);
            }
            of_bricks.push(beside);
        }
        let mut bricks = Vec::new();
        for ((start, dims, (voxels, strides)), beside) in places.into_iter().zip(&of_bricks) {
            bricks.push(Brick::new(start, dims, voxels).with_strides(strides).with_more_fields(beside));
        }
        match self.client.push_bricks(step, time, &bricks) {
            Ok(Receipt::Admitted(_) | Receipt::Dropped) => Ok(()),
            // The client says by itself, once, that its node is away, and tries again.
            Err(ClientError::Unreachable { .. }) => {
                Err(format!("{} is not shown: its node cannot be reached", self.field))
            }
            Err(error) => Err(format!("{}: {error}", self.field)),
        }
    }
}

/// Values as double precision, where they cannot be handed over as they are, or are not to be.
fn converted(domain: &Domain, voxel_type: VoxelType, always: bool) -> Option<Vec<f64>> {
    let Values::InPlace { array, first, strides } = &domain.values else { return None };
    let aligned = array.stride_bytes.is_multiple_of(array.element.size_bytes())
        && (array.first as usize).is_multiple_of(array.element.size_bytes());
    if !always && aligned && array.element.voxel_type() == Some(voxel_type) {
        return None;
    }
    let [x, y, z] = domain.dims;
    let mut values = Vec::with_capacity(x * y * z);
    for k in 0..z {
        for j in 0..y {
            for i in 0..x {
                values.push(array.get(first + i * strides[0] + j * strides[1] + k * strides[2]).unwrap_or(f64::NAN));
            }
        }
    }
    Some(values)
}

/// The voxels of the box of `dims` points from point `skipped` of the domain on, and how far neighbors lie apart.
fn voxels<'a>(
    domain: &'a Domain,
    converted: Option<&'a [f64]>,
    skipped: [usize; 3],
    dims: [usize; 3],
    voxel_type: VoxelType,
) -> Result<(VoxelSlice<'a>, [usize; 3]), String> {
    let offset = |strides: [usize; 3]| skipped.iter().zip(strides).map(|(n, stride)| n * stride).sum::<usize>();
    let reach = |strides| span(dims, strides).map_err(|e| e.to_string());
    let copied = match (&domain.values, converted) {
        (Values::Resampled(values), _) => Some(&values[..]),
        (_, converted) => converted,
    };
    if let Some(values) = copied {
        if voxel_type != VoxelType::F64 {
            return Err("values are of another type than at the first step".to_owned());
        }
        let strides = dense(domain.dims);
        return Ok((VoxelSlice::F64(&values[offset(strides)..][..reach(strides)?]), strides));
    }
    let Values::InPlace { array, first, strides } = &domain.values else { unreachable!("resampled values are copied") };
    let apart = array.stride_bytes / array.element.size_bytes();
    let strides = strides.map(|stride| stride * apart);
    Ok((slice(array, first * apart + offset(strides), reach(strides)?), strides))
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

/// Where a domain lies, as it is told to all ranks.
#[derive(Debug)]
struct Placed {
    origin: [f64; 3],
    spacing: [f64; 3],
    dims: [usize; 3],
    voxel_type: VoxelType,
}

impl Placed {
    fn of(domain: &Domain) -> Self {
        Self { origin: domain.origin, spacing: domain.spacing, dims: domain.dims, voxel_type: domain.voxel_type() }
    }
}

/// Types by the numbers that ranks tell each other.
const TYPES: [VoxelType; 5] = [VoxelType::U8, VoxelType::U16, VoxelType::I16, VoxelType::F32, VoxelType::F64];

/// Ten numbers a domain.
fn placed_bytes(domains: &[Domain]) -> Vec<u8> {
    let numbers = domains.iter().flat_map(|domain| {
        let voxel_type = TYPES.iter().position(|t| *t == domain.voxel_type()).unwrap_or(4) as f64;
        [domain.origin, domain.spacing, domain.dims.map(|d| d as f64)].concat().into_iter().chain([voxel_type])
    });
    numbers.flat_map(f64::to_le_bytes).collect()
}

fn read_placed(bytes: &[u8]) -> Vec<Placed> {
    let numbers: Vec<f64> = bytes.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
    let domain = |n: &[f64; 10]| Placed {
        origin: [n[0], n[1], n[2]],
        spacing: [n[3], n[4], n[5]],
        dims: [n[6] as usize, n[7] as usize, n[8] as usize],
        voxel_type: TYPES[(n[9] as usize).min(4)],
    };
    numbers.as_chunks().0.iter().map(domain).collect()
}

/// The domain's points on the lattice from `origin` on.
fn index_box(place: &Placed, origin: [f64; 3], spacing: [f64; 3]) -> Result<IndexBox, String> {
    let mut start = [0; 3];
    for axis in 0..3 {
        let (step, own) = (spacing[axis], place.spacing[axis]);
        if (own - step).abs() * place.dims[axis] as f64 > ON_LATTICE * step {
            return Err(format!("domains are spaced {own} and {step} apart along one axis; one spacing can be shown"));
        }
        let at = (place.origin[axis] - origin[axis]) / step;
        if (at - at.round()).abs() > ON_LATTICE || at.abs() > 1e9 {
            let first = place.origin;
            return Err(format!(
                "a domain at {first:?} does not lie on the lattice from {origin:?}, {spacing:?} apart"
            ));
        }
        start[axis] = at.round() as i64;
    }
    let end = std::array::from_fn(|axis| start[axis] + place.dims[axis] as i64);
    Ok(IndexBox { start, end })
}
