//! `lamina export`: recorded steps for other tools.
//!
//! Reduced volumes become VTK image data (XML or HDF5), in the data's units; any step becomes pictures of a Cinema database (Spec D: `data.csv`, whose
//! last column names a file for each combination of the others), or of a movie.

use crate::cli;
use crate::movie::{self, Movie};
use crate::picture_file;
use anyhow::{Context, bail, ensure};
use lamina_model::{Image, Intermediate, ReducedVolume, ScalarRange, Scale, Volume, Voxels};
use lamina_vdi_render::{Backend, Detail, Drawable};
use lamina_viz_node::store::Run;
use lamina_volume_io::{read_recorded, write_pvd, write_vti, write_vtkhdf};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A recorded step's file, its number and its time.
struct RecordedStep {
    number: u64,
    time: f64,
    file: PathBuf,
}

/// `lamina export`.
pub fn export(arguments: &cli::Export) -> anyhow::Result<()> {
    let (out, input) = (&arguments.out, &arguments.input);
    let ending = out.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let steps = recorded(input)?;
    match (ending.as_str(), &steps[..]) {
        ("vti", [step]) => write_vti(out, &volume(&step.file)?, &field_of(&step.file))?,
        ("vtkhdf", [step]) => write_vtkhdf(out, &volume(&step.file)?, &field_of(&step.file))?,
        ("vti" | "vtkhdf", _) => {
            bail!("{}: a .{ending} holds one step of the {} there are; name a .pvd", out.display(), steps.len())
        }
        ("pvd", _) => collection(out, &steps)?,
        ("cdb", _) => cinema(arguments, &steps)?,
        ("webp" | "mp4", _) => film(arguments, &steps)?,
        _ => bail!("{}: cannot be written; name a .vti, .vtkhdf, .pvd, .cdb, .webp or .mp4", out.display()),
    }
    say!("{}: {} steps", out.display(), steps.len());
    Ok(())
}

/// The step that is the file, or those of the run in the folder: of several runs the newest.
fn recorded(input: &Path) -> anyhow::Result<Vec<RecordedStep>> {
    if !input.is_dir() {
        return Ok(vec![RecordedStep { number: 0, time: 0.0, file: input.to_owned() }]);
    }
    let folder = newest_run(input).with_context(|| format!("{}: no run was recorded here", input.display()))?;
    #[derive(Deserialize)]
    struct Row {
        step: u64,
        time: f64,
    }
    let table = folder.join("steps.csv");
    let rows = csv::Reader::from_path(&table).with_context(|| format!("{}: cannot be read", table.display()))?;
    let times: Result<BTreeMap<u64, f64>, _> =
        rows.into_deserialize().map(|row| row.map(|r: Row| (r.step, r.time))).collect();
    let times = times.with_context(|| table.display().to_string())?;
    let step = |(number, time)| RecordedStep { number, time, file: folder.join(format!("step_{number:06}.vdi")) };
    let steps: Vec<RecordedStep> = times.into_iter().map(step).filter(|step| step.file.exists()).collect();
    ensure!(!steps.is_empty(), "{}: no step was recorded", folder.display());
    Ok(steps)
}

/// `folder`, or the folder below it, whose `steps.csv` with recorded steps beside it is youngest.
fn newest_run(folder: &Path) -> Option<PathBuf> {
    let below = std::fs::read_dir(folder).ok()?.flatten().map(|entry| entry.path()).filter(|path| path.is_dir());
    // `lamina live --out` has the steps in a folder of their own.
    let deeper = std::fs::read_dir(folder.join("vdi")).into_iter().flatten().flatten().map(|entry| entry.path());
    let has_steps = |folder: &Path| {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        entries.into_iter().any(|entry| entry.path().extension().is_some_and(|e| e == "vdi"))
    };
    let runs = std::iter::once(folder.to_owned()).chain(below).chain(deeper).filter(|folder| has_steps(folder));
    runs.filter_map(|run| Some((std::fs::metadata(run.join("steps.csv")).ok()?.modified().ok()?, run)))
        .max()
        .map(|(_, run)| run)
}

/// The values of a reduced volume, data units.
fn volume(file: &Path) -> anyhow::Result<Volume> {
    let Intermediate::Volume(reduced) = read_recorded(file)? else {
        bail!(
            "{}: a VDI holds colors, not values; record with --representation volume, or export pictures (.cdb)",
            file.display()
        );
    };
    let range = *reduced.scene().transfer.range();
    let (grid, _, units) = ReducedVolume::into_parts(*reduced);
    let values = units.into_iter().map(|unit| value_from_unit(&range, f64::from(unit)) as f32).collect();
    Ok(Volume::new(grid, Voxels::F32(values))?)
}

/// The inverse of [`ScalarRange::unit_from_value`].
fn value_from_unit(range: &ScalarRange, unit: f64) -> f64 {
    match range.scale() {
        Scale::Linear => range.lo() + unit * (range.hi() - range.lo()),
        Scale::Log10 => (range.lo().ln() + unit * (range.hi().ln() - range.lo().ln())).exp(),
    }
}

/// The field's name, which the description beside recorded steps has.
fn field_of(step: &Path) -> String {
    let description = std::fs::read(step.with_file_name("run.json")).unwrap_or_default();
    serde_json::from_slice::<Run>(&description).map_or_else(|_| "scalar".to_owned(), |run| run.field)
}

/// A `.pvd`, and a folder with the steps beside it.
fn collection(out: &Path, steps: &[RecordedStep]) -> anyhow::Result<()> {
    let stem = format!("{}_steps", out.file_stem().unwrap_or_default().to_string_lossy());
    let folder = out.with_file_name(&stem);
    std::fs::create_dir_all(&folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
    let mut entries = Vec::new();
    for step in steps {
        let name = format!("step_{:06}.vti", step.number);
        write_vti(&folder.join(&name), &volume(&step.file)?, &field_of(&step.file))?;
        entries.push((step.time, format!("{stem}/{name}")));
    }
    Ok(write_pvd(out, &entries)?)
}

/// A movie: of a run each step once, of a single step all its sides, unless otherwise asked for.
fn film(arguments: &cli::Export, steps: &[RecordedStep]) -> anyhow::Result<()> {
    let cli::Export { out, size, fps, .. } = arguments;
    let (frames, turn) = if steps.len() > 1 { (steps.len() as u32, 0.0) } else { (5 * fps, 360.0) };
    let &[elevation] = &arguments.elevations[..] else { bail!("--elevations: a movie has one") };
    let (frames, turn) = (arguments.frames.unwrap_or(frames), arguments.turn.unwrap_or(turn));
    ensure!(turn.is_finite() && elevation.is_finite(), "--turn and --elevations: degrees must be finite numbers");
    let movie = Movie { frames, turn, elevation, rate: *fps, size: *size };
    let files: Vec<&Path> = steps.iter().map(|step| &*step.file).collect();
    movie::write(out, &files, &movie, &Backend::open(arguments.backend)?)
}

/// Pictures of all steps from all cameras, with their table.
fn cinema(arguments: &cli::Export, steps: &[RecordedStep]) -> anyhow::Result<()> {
    let (out, size) = (&arguments.out, arguments.size);
    Image::check_size(size, size)?;
    std::fs::create_dir_all(out).with_context(|| format!("{}: cannot be made", out.display()))?;
    let backend = Backend::open(arguments.backend)?;
    let mut table = csv::Writer::from_path(out.join("data.csv"))?;
    table.write_record(["step", "time", "phi", "theta", "FILE"])?;
    for step in steps {
        let shown = Drawable::new(read_recorded(&step.file)?);
        for &theta in &arguments.elevations {
            for n in 0..arguments.azimuths {
                let phi = 360.0 * f64::from(n) / f64::from(arguments.azimuths);
                let camera = shown.camera().orbit(phi, theta, 1.0)?;
                let picture = backend.render(&shown, &camera, size, size, Detail::Cubic)?;
                let name = format!("step_{:06}_phi_{phi}_theta_{theta}.png", step.number);
                picture_file::write(&out.join(&name), &picture)?;
                table.write_record([
                    step.number.to_string(),
                    step.time.to_string(),
                    phi.to_string(),
                    theta.to_string(),
                    name,
                ])?;
            }
        }
    }
    Ok(table.flush()?)
}
