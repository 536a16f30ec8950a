//! A run: opened at the first step, when the domains of all ranks are known.

use crate::conduit::Node;
use crate::guard::caught;
use crate::lattice_run::{LatticeRun, lattices};
use crate::mesh::Domain;
use crate::options::CatalystOptions;
use crate::ranks::Ranks;
use crate::resampled_run::ResampledRun;
use crate::target::{self, Extent, StatedPoints};
use lamina_client::{Brick, Client, ClientError, Receipt, RunOptions};
use lamina_model::{Grid, SteeringRequest, VoxelType};

/// Domains of a mesh with a field, and the field's name; the first field, where none is named.
pub(crate) type Found = Result<(Vec<Domain>, Option<String>), String>;

/// Reads the domains of a channel, the first if none is stated, with a field.
pub(crate) type DomainReader<'a> = dyn Fn(Option<&str>, Option<&str>) -> Found + 'a;

/// What the simulation says of a step.
#[derive(Debug)]
pub(crate) struct StepState {
    /// Its number, where it has one.
    pub(crate) step: Option<f64>,
    /// Simulation time.
    pub(crate) time: Option<f64>,
    /// Numbers beside the fields, by name.
    pub(crate) diagnostics: Vec<(String, f64)>,
}

impl StepState {
    /// That of a node `state`; `number` reads one of its children.
    pub(crate) fn read(state: Option<Node>, step: [&str; 2], number: impl Fn(Node) -> Option<f64>) -> Self {
        let of = |name: &str| state?.at(name).and_then(&number);
        let told = state.and_then(|state| state.at("diagnostics")).map(|node| node.children()).unwrap_or_default();
        let diagnostics = told.into_iter().filter_map(|(name, value)| Some((name, number(value)?))).collect();
        Self { step: step.into_iter().find_map(of), time: of("time"), diagnostics }
    }
}

/// The simulation as its calls show it.
pub(crate) struct Adaptor {
    options: CatalystOptions,
    ranks: Ranks,
    run: Option<OpenRun>,
    /// All ranks have rank 0's options.
    agreed: bool,
    /// The ranks know each other's domains: a run of parts of one lattice has no further collective call.
    gathered: bool,
    /// Steps so far, which number those that have no number.
    calls: u64,
    lost: u64,
    /// What people who watch want: `pause` holds until `resume`.
    paused: bool,
    stop: bool,
    numbers: Vec<(String, f64)>,
    /// That a diagnostic was refused is said once.
    refused_diagnostic: bool,
}

/// An open run.
struct OpenRun {
    way: Way,
    /// None, where the run was refused: the rank still has its part in what is collective.
    client: Option<Client>,
    field: String,
}

impl OpenRun {
    /// Whether a step is computed, and whether this rank's part of it would be handed over, or why it is lost. Once a step. Where the mesh
    /// is resampled it is collective, and all ranks compute what any of them hands over.
    fn wants(&mut self, ranks: &Ranks, step: u64) -> Result<(bool, Result<bool, String>), String> {
        let is_resampled = matches!(self.way, Way::Resampled(_));
        if is_resampled {
            // From the question on time counts as a cost of watching: to wait for slower ranks is none.
            ranks.any(step, false)?;
        }
        let wanted = caught(|| {
            let client = self.client.as_mut().ok_or("the run was refused, at the first step; see above")?;
            client.wants(step).map_err(|error| in_words(&error, &self.field))
        });
        let is_wanted = wanted == Ok(true);
        let is_computed = if is_resampled { ranks.any(step, is_wanted)? } else { is_wanted };
        Ok((is_computed, wanted))
    }
}

fn in_words(error: &ClientError, field: &str) -> String {
    match error {
        // The client says by itself, once, why its node is away, and tries again.
        ClientError::Unreachable { .. } => format!("{field} is not shown: its node cannot be reached"),
        _ => format!("{field}: {error}"),
    }
}

/// How values become bricks.
enum Way {
    InPlace(LatticeRun),
    Resampled(ResampledRun),
}

impl Adaptor {
    /// By the options in the node `lamina`, and the communicator, a Fortran handle.
    pub(crate) fn new(stated: Option<Node>, communicator: Option<f64>) -> Result<Self, String> {
        let (options, ranks) = (CatalystOptions::read(stated), Ranks::of(communicator)?);
        let numbers = options.steering.iter().flatten().map(|number| (number.name.clone(), number.value)).collect();
        Ok(Self {
            options,
            ranks,
            run: None,
            agreed: false,
            gathered: false,
            calls: 0,
            lost: 0,
            paused: false,
            stop: false,
            numbers,
            refused_diagnostic: false,
        })
    }

    /// Hands a step over, whose domains of a channel (if one is stated) with a field are read by `domains`.
    pub(crate) fn push(&mut self, state: &StepState, domains: &DomainReader<'_>) -> Result<(), String> {
        let call = self.calls;
        self.calls += 1;
        let step = state.step.filter(|step| *step >= 0.0).map_or(call, |step| step as u64);
        let time = state.time.unwrap_or(step as f64);
        if !self.agreed {
            self.agreed = true;
            self.ranks.duplicate()?;
            let of_ranks = self.ranks.gather(&self.options.of_all_ranks())?;
            self.options.take_over(&of_ranks[0]);
        }
        if !self.gathered {
            // All ranks take part, also one whose own mesh cannot be shown: nobody waits for it.
            self.open(domains)?;
        }
        if let Some(run) = &mut self.run {
            let outcome = match run.wants(&self.ranks, step) {
                Ok((true, wanted)) => self.compute((step, time, &state.diagnostics), domains, wanted),
                Ok((false, wanted)) => wanted.map(|_| ()),
                Err(error) => Err(error),
            };
            self.lost += u64::from(outcome.is_err());
            return outcome;
        }
        caught(|| domains(self.options.channel.as_deref(), self.options.field.as_deref()))?;
        Err("this rank took no part when the run was opened, at the first step; see above".to_owned())
    }

    /// Reads the fields of a step, and hands them over where this rank's part of it is `wanted`. Collective where the mesh is resampled.
    fn compute(
        &mut self,
        (step, time, diagnostics): (u64, f64, &[(String, f64)]),
        domains: &DomainReader<'_>,
        wanted: Result<bool, String>,
    ) -> Result<(), String> {
        let Some(run) = &mut self.run else { return Ok(()) };
        if let Some(client) = run.client.as_mut().filter(|_| wanted == Ok(true)) {
            // One that is refused is no reason to lose the step.
            let refused = diagnostics.iter().filter_map(|(name, value)| client.diagnostic(name, *value).err()).next();
            if let Some(error) = refused.filter(|_| !std::mem::replace(&mut self.refused_diagnostic, true)) {
                eprintln!("lamina: rank {}: {error}; it is left out at every step", self.ranks.rank);
            }
        }
        let channel = self.options.channel.as_deref();
        let read = |field: Option<&str>| caught(|| domains(channel, field));
        let of_more = |(_, field): &(String, String)| Ok(read(Some(field))?.0);
        let found = read(self.options.field.as_deref()).and_then(|(own, _)| {
            let more = self.options.more_fields.iter().map(of_more).collect::<Result<Vec<_>, String>>();
            Ok((own, more?))
        });
        let (client, field) = (&mut run.client, &run.field);
        let hand_over = |bricks: &[Brick<'_>]| {
            let Some(client) = client.as_mut().filter(|_| wanted == Ok(true)) else { return wanted.map(|_| ()) };
            match client.push_bricks(step, time, bricks) {
                Ok(Receipt::Admitted(_) | Receipt::Dropped) => Ok(()),
                Err(error) => Err(in_words(&error, field)),
            }
        };
        match &mut run.way {
            Way::InPlace(way) => found.and_then(|(own, more)| way.push(&own, &more, hand_over)),
            Way::Resampled(way) => way.push(&self.ranks, step, found, hand_over),
        }
    }

    /// Opens the run on the grid that holds the domains of all ranks. Collective, until one has a domain.
    fn open(&mut self, domains: &DomainReader<'_>) -> Result<(), String> {
        let stated = self.options.points.as_deref().map(StatedPoints::parse).transpose()?;
        let channel = self.options.channel.clone();
        let read = |field: Option<&str>| caught(|| domains(channel.as_deref(), field));
        // Where none is stated, all show the field that the first rank with one has first.
        let found = read(self.options.field.as_deref());
        let name = found.as_ref().ok().filter(|(own, _)| !own.is_empty()).and_then(|(_, field)| field.clone());
        let names = self.ranks.gather(name.unwrap_or_default().as_bytes())?;
        let Some(name) = names.into_iter().find(|name| !name.is_empty()) else {
            found?;
            return Err("no rank has a domain with the field yet".to_owned());
        };
        let field = String::from_utf8_lossy(&name).into_owned();
        self.options.field = Some(field.clone());
        let found = read(Some(&field));
        let own = found.as_ref().map_or(&[][..], |(domains, _)| domains);
        let extents: Vec<Extent> = own.iter().filter_map(Extent::of).collect();
        let bytes: Vec<u8> = extents.iter().flat_map(|extent| extent.to_bytes()).collect();
        let of_ranks: Vec<Vec<Extent>> = self.ranks.gather(&bytes)?.iter().map(|b| Extent::read_all(b)).collect();
        let Some(first) = of_ranks.iter().flatten().next().copied() else {
            found?;
            return Err("no rank has a domain with the field yet".to_owned());
        };
        self.gathered = true;
        let fields = 1 + self.options.more_fields.len();
        let (way, grid, voxel_type) = match lattices(&of_ranks).filter(|_| stated.is_none()) {
            Some(all) => {
                found.as_ref().map_err(Clone::clone)?;
                // Several fields are copied, to lie in memory alike.
                let voxel_type = if fields > 1 { VoxelType::F64 } else { first.voxel_type };
                let before: usize = of_ranks[..self.ranks.rank as usize].iter().map(Vec::len).sum();
                let (way, grid) = LatticeRun::new(&all, before, extents.len(), voxel_type)?;
                (Way::InPlace(way), grid, voxel_type)
            }
            None => {
                let all: Vec<Extent> = of_ranks.into_iter().flatten().collect();
                let lattice = target::lattice(&all, stated)?;
                if self.ranks.rank == 0 {
                    let ([x, y, z], spacing) = (lattice.dims, lattice.spacing);
                    eprintln!(
                        "lamina: the mesh is shown resampled, at {x} x {y} x {z} points {spacing:?} apart; points or LAMINA_POINTS states how many"
                    );
                }
                let (way, grid) = ResampledRun::new(lattice, self.ranks.size, fields)?;
                (Way::Resampled(way), grid, VoxelType::F32)
            }
        };
        // What is collective goes on also where a rank is refused.
        let client = self.connect(&field, grid, voxel_type);
        if let Err(error) = &client {
            eprintln!("lamina: rank {}: {error}", self.ranks.rank);
        }
        self.run = Some(OpenRun { way, client: client.ok(), field });
        Ok(())
    }

    fn connect(&self, field: &str, grid: Grid, voxel_type: VoxelType) -> Result<Client, String> {
        let mut run = RunOptions {
            rank: self.ranks.rank,
            ranks: self.ranks.size,
            credentials: self.options.credentials.clone(),
            more_fields: self.options.more_fields.iter().map(|(name, _)| (name.clone(), voxel_type)).collect(),
            shown: self.options.shown.clone(),
            steering: self.options.steering.clone().filter(|_| self.ranks.rank == 0),
            ..RunOptions::new(&self.options.generator, &self.options.name, field, grid, voxel_type)
        };
        run.deadline = self.options.deadline.unwrap_or(run.deadline);
        Client::connect(run).map_err(|e| e.to_string())
    }

    /// What people who watch have asked for, into the node of `catalyst_results`.
    pub(crate) fn results(&mut self, results: &Node) {
        let client = self.run.as_mut().and_then(|run| run.client.as_mut());
        let requests = client.map(Client::steering).unwrap_or_default();
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
        let Some(client) = self.run.and_then(|run| run.client) else { return Ok(()) };
        let summary = client.close();
        let lost = summary.lost.max(self.lost);
        if lost > 0 { Err(format!("{lost} of {} steps were lost", self.calls)) } else { Ok(()) }
    }
}
