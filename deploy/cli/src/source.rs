//! Where time steps come from: the example simulation or recorded data.

use crate::cli;
use crate::scene_file::scene_for;
use anyhow::Context;
use glam::DVec3;
use lamina_blast::{Config, Simulation};
use lamina_model::{
    ColorField, ControlPoint, Effects, Grid, Invalid, ScalarRange, Scale, Scene, TransferFunction, Volume, Voxels,
    suggest,
};
use lamina_volume_io::{Options, RawSpec, Series};
use std::path::Path;
use std::time::Duration;

/// A simulation as `lamina` drives it.
pub trait Source {
    /// Name of the run.
    fn name(&self) -> &str;
    /// What the scalar is.
    fn field(&self) -> &str;
    /// Number of steps, if it ends by itself.
    fn step_count(&self) -> Option<u64>;
    /// How to show it.
    fn scene(&self) -> &Scene;
    /// The next step's simulation time and volume; `None` at the end. Takes as long as computing or reading it does.
    fn next(&mut self) -> anyhow::Result<Option<(f64, Volume)>>;
    /// Further fields of the step that came last, for people to choose from.
    fn more_fields(&self) -> Vec<(String, Voxels)> {
        Vec::new()
    }
    /// Processor time of its own threads, if it has any.
    fn cpu_time(&self) -> Option<Duration> {
        None
    }
}

/// The built-in blast.
#[derive(Debug)]
pub struct Example {
    simulation: Simulation,
    /// Its own threads, as a simulation beside the nodes has.
    threads: rayon::ThreadPool,
    started: bool,
    elapsed: f64,
    scene: Scene,
}

impl Example {
    /// A blast on `cells`^3 cells, on `threads` threads or half of the cores.
    pub fn new(
        cells: usize,
        seed: u64,
        terms: &[cli::Term],
        threads: Option<u16>,
        scene_file: Option<&Path>,
    ) -> anyhow::Result<Self> {
        let mut config = Config { cells, seed, ..Config::default() };
        for term in terms {
            match term {
                cli::Term::Gravity => config.gravity = [0.0, -20.0, 0.0],
                cli::Term::Cooling => config.cooling = 2.0,
                cli::Term::Viscosity => config.viscosity = 0.01,
                cli::Term::Tracer => config.tracer = true,
            }
        }
        let simulation = Simulation::new(config)?;
        let scene = match scene_file {
            Some(file) => scene_for(Some(file), &[&shown(&simulation)?])?,
            None => example_scene(&simulation)?,
        };
        let half = || std::thread::available_parallelism().map_or(1, |n| n.get().div_ceil(2));
        let threads = threads.map_or_else(half, usize::from);
        let threads = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        Ok(Self { simulation, threads, started: false, elapsed: 0.0, scene })
    }
}

/// Name of the example's second field.
const TRACER: &str = "blast gas";

/// Density, and the tracer of a run that has one.
fn shown(simulation: &Simulation) -> anyhow::Result<Volume> {
    let (h, o) = (simulation.spacing(), simulation.origin());
    let grid = Grid::new([simulation.cells(); 3], DVec3::splat(h), DVec3::splat(o))?;
    let volume = Volume::new(grid, Voxels::F32(simulation.density()))?;
    Ok(match simulation.tracer() {
        Some(tracer) => volume.with_color_field(TRACER, Voxels::F32(tracer.to_vec()))?,
        None => volume,
    })
}

/// Density over four decades: the hot cavity a thin blue, undisturbed gas (density 1) clear, the swept-up shell red, clumps
/// amber to white. Opacities refer to 1/48 of the box, so that the grid's fineness changes no brightness.
fn example_scene(simulation: &Simulation) -> anyhow::Result<Scene> {
    let point = |at, color, opacity| ControlPoint { at, color, opacity };
    let points = vec![
        point(0.0, [0.30, 0.55, 1.0], 0.06),
        point(0.30, [0.15, 0.25, 0.85], 0.02),
        point(0.42, [0.05, 0.05, 0.25], 0.0),
        point(0.52, [0.35, 0.10, 0.15], 0.0),
        point(0.60, [0.85, 0.25, 0.12], 0.06),
        point(0.72, [0.98, 0.62, 0.20], 0.18),
        point(0.85, [1.0, 0.88, 0.55], 0.5),
        point(1.0, [1.0, 1.0, 1.0], 0.9),
    ];
    let transfer = TransferFunction::new(ScalarRange::new(0.01, 100.0, Scale::Log10)?, Some(1.0 / 24.0), points)?;
    let volume = shown(simulation)?;
    let camera = suggest::suggest_camera(&volume.grid().bounds())?;
    // The share of gas that was in the blast.
    let color_field = volume.color_field().map(|(name, _)| {
        let range = ScalarRange::new(0.0, 1.0, Scale::Linear)?;
        Ok::<_, Invalid>(ColorField { name: name.to_owned(), range, points: ColorField::cool_to_warm() })
    });
    let effects = Effects { color_field: color_field.transpose()?, ..Effects::default() };
    Ok(Scene { transfer, camera, background: [0.0; 3], step_voxels: 0.5, effects })
}

impl Source for Example {
    fn name(&self) -> &str {
        "blast"
    }
    fn field(&self) -> &str {
        "density"
    }
    fn step_count(&self) -> Option<u64> {
        None
    }
    fn scene(&self) -> &Scene {
        &self.scene
    }

    fn more_fields(&self) -> Vec<(String, Voxels)> {
        let momentum =
            ["x", "y", "z"].map(|axis| format!("momentum.{axis}")).into_iter().zip(self.simulation.momentum());
        let all = momentum.chain([("energy".to_owned(), self.simulation.energy())]);
        all.map(|(name, values)| (name, Voxels::F32(values))).collect()
    }

    fn cpu_time(&self) -> Option<Duration> {
        Some(self.threads.broadcast(|_| lamina_compute::thread_cpu_time()).into_iter().sum())
    }

    fn next(&mut self) -> anyhow::Result<Option<(f64, Volume)>> {
        if self.started {
            if self.simulation.finished() {
                // The blast has left the box: the next one, into other clumps; time goes on.
                self.elapsed += self.simulation.time();
                self.simulation = Simulation::new(self.simulation.config().reseeded())?;
            }
            let simulation = &mut self.simulation;
            self.threads.install(|| simulation.advance());
        }
        self.started = true;
        Ok(Some((self.elapsed + self.simulation.time(), shown(&self.simulation)?)))
    }
}

/// A recorded series.
#[derive(Debug)]
pub struct Recorded {
    series: Series,
    next: usize,
    scene: Scene,
}

/// What the command line says about raw files.
pub fn read_options(raw: &cli::Raw) -> Options {
    let spec = RawSpec { dims: raw.dims.map(|d| d.0), voxel_type: raw.dtype, ..RawSpec::default() };
    Options { raw: spec, field: raw.field.clone(), missing: raw.missing, axes: raw.axes, level: raw.level }
}

/// The scene of a series: of `file`, where that leaves something open chosen from first, middle and last step.
pub fn scene_of(series: &Series, file: Option<&Path>) -> anyhow::Result<Scene> {
    let last = series.len() - 1;
    let mut steps = vec![0, last / 2, last];
    steps.dedup();
    let read = |n| series.read(n).with_context(|| format!("{}, step {n}", series.name()));
    let volumes = steps.into_iter().map(read).collect::<anyhow::Result<Vec<Volume>>>()?;
    scene_for(file, &volumes.iter().collect::<Vec<_>>())
}

/// `volume`, which is step `n`, with the second field that `scene` takes colors from, if it does.
pub fn with_colors(series: &Series, n: usize, volume: Volume, scene: &Scene) -> anyhow::Result<Volume> {
    match &scene.effects.color_field {
        None => Ok(volume),
        Some(second) => Ok(series.with_color_field(n, &second.name, volume)?),
    }
}

impl Recorded {
    /// The series at `path`; its scene suits first, middle and last step.
    pub fn open(path: &Path, options: &Options, scene_file: Option<&Path>) -> anyhow::Result<Self> {
        let series = Series::open(path, options)?;
        let scene = scene_of(&series, scene_file)?;
        Ok(Self { series, next: 0, scene })
    }
}

impl Source for Recorded {
    fn name(&self) -> &str {
        self.series.name()
    }
    fn field(&self) -> &str {
        self.series.field()
    }
    fn step_count(&self) -> Option<u64> {
        Some(self.series.len() as u64)
    }
    fn scene(&self) -> &Scene {
        &self.scene
    }

    fn next(&mut self) -> anyhow::Result<Option<(f64, Volume)>> {
        if self.next == self.series.len() {
            return Ok(None);
        }
        let n = self.next;
        self.next += 1;
        let volume = self.series.read(n).with_context(|| format!("step {n}"))?;
        Ok(Some((self.series.time(n), with_colors(&self.series, n, volume, &self.scene)?)))
    }
}
