//! The folder of a watched run: `steps.csv` step by step, `trials.csv` study by study, `report.html` every some seconds; pictures.

use crate::nodes::Nodes;
use crate::source::Source;
use anyhow::{Context, ensure};
use lamina_model::{GenerationParams, Scene, Volume, psnr};
use lamina_raycast::{Backend, Field};
use lamina_report::{Limit, PicturePair, Report, ReportTrial, Turntable};
use lamina_rpc::daemon::png;
use lamina_rpc::v1;
use lamina_tuner::units::show_bytes;
use lamina_vdi_render::Detail;
use lamina_viz_node::store::{StepRow, Store};
use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Views of which picture pairs are kept, degrees.
const ANGLES_DEG: [f64; 3] = [10.0, 30.0, 60.0];
/// Side of a kept picture, pixels.
const PICTURE_SIZE: u32 = 512;
/// Steps of which pictures are kept.
const PICTURE_STEPS: u64 = 4;
/// How old `report.html` may be while steps come: what a run that is killed leaves.
const REPORT_AGE: Duration = Duration::from_secs(10);

/// An output folder being filled.
pub(crate) struct RunFolder {
    dir: PathBuf,
    csv: File,
    steps: Option<u64>,
    /// Studies whose trials are written.
    studies: u64,
    pictures: Vec<PicturePair>,
    /// When the report was written.
    reported: Instant,
    title: String,
    source: String,
}

impl RunFolder {
    /// A fresh folder `dir`; one that holds a run already is left alone.
    pub(crate) fn create(dir: &Path, source: &dyn Source, volume: &Volume, steps: Option<u64>) -> anyhow::Result<Self> {
        let unwritable = || format!("{}: cannot be written; name another folder with --out", dir.display());
        fs::create_dir_all(dir.join("pictures")).with_context(unwritable)?;
        let path = dir.join("steps.csv");
        ensure!(!path.exists(), "{} holds a recorded run; name another folder with --out", dir.display());
        let mut csv = OpenOptions::new().create_new(true).append(true).open(&path).with_context(unwritable)?;
        csv.write_all(StepRow::csv_header().as_bytes()).with_context(unwritable)?;
        let ([nx, ny, nz], kind) = (volume.grid().dims(), volume.voxels().voxel_type());
        let size = show_bytes(volume.size_bytes() as u64);
        let second = volume.color_field().map_or_else(String::new, |(name, _)| format!(" and {name}"));
        Ok(Self {
            dir: dir.to_owned(),
            csv,
            steps,
            studies: 0,
            pictures: Vec::new(),
            reported: Instant::now(),
            title: format!("{}: {}", source.name(), source.field()),
            source: format!(
                "{}{second} of {}, {nx} x {ny} x {nz} {kind} ({size} a step)",
                source.field(),
                source.name()
            ),
        })
    }

    /// Appends steps to `steps.csv`.
    pub(crate) fn add(&mut self, rows: &[StepRow]) -> anyhow::Result<()> {
        for row in rows {
            self.csv
                .write_all(row.to_csv().as_bytes())
                .with_context(|| format!("{}: steps.csv", self.dir.display()))?;
        }
        Ok(())
    }

    /// Writes `trials.csv` if there are more than the last time, and `report.html` if it is old.
    pub(crate) fn update(&mut self, nodes: &Nodes) -> anyhow::Result<()> {
        let studies = nodes.studies()?;
        if studies > self.studies {
            self.write_trials(nodes)?;
            self.studies = studies;
        }
        if self.reported.elapsed() > REPORT_AGE {
            self.write_report(&nodes.store.rows(), nodes, None)?;
            self.reported = Instant::now();
        }
        Ok(())
    }

    /// Keeps pictures of a few steps, spread over the run: the viewer's beside the ray-cast volume's.
    pub(crate) fn pictures(
        &mut self,
        row: &StepRow,
        volume: &Volume,
        scene: &Scene,
        store: &Store,
    ) -> anyhow::Result<()> {
        let last = self.steps.map_or(0, |n| n.saturating_sub(1));
        let spread = (0..PICTURE_STEPS).any(|k| row.step == k * last / (PICTURE_STEPS - 1));
        if !spread {
            return Ok(());
        }
        let field = Field::new(volume.clone(), scene);
        let (shown, viewer) = (store.prepared(row.step)?, lamina_vdi_render::Backend::default());
        for angle_deg in ANGLES_DEG {
            let camera = scene.camera.rotated_about_y(angle_deg)?;
            let reference = Backend::cpu().raycast(&field, &camera, PICTURE_SIZE, PICTURE_SIZE)?;
            let rendered = viewer.render(&shown, &camera, PICTURE_SIZE, PICTURE_SIZE, Detail::Cubic)?;
            let pair = PicturePair {
                step: row.step,
                angle_deg,
                psnr_db: psnr(&rendered, &reference)?,
                shown_png: png(&rendered)?,
                reference_png: png(&reference)?,
            };
            for (kind, bytes) in [("shown", &pair.shown_png), ("reference", &pair.reference_png)] {
                let path = self.dir.join(format!("pictures/step_{:06}_view_{angle_deg}_{kind}.png", row.step));
                fs::write(&path, bytes).with_context(|| path.display().to_string())?;
            }
            self.pictures.push(pair);
        }
        Ok(())
    }

    /// Writes `trials.csv` and `report.html`, and says what there is.
    pub(crate) fn finish(self, nodes: &Nodes) -> anyhow::Result<()> {
        let rows = nodes.store.rows();
        let turntable = |step| {
            let encoded = nodes.store.encoded(step).ok()?.to_vec();
            Some(Turntable { step, encoded, engine: lamina_viz_node::ENGINE, script: lamina_viz_node::EMBED })
        };
        self.write_report(&rows, nodes, rows.last().and_then(|row| turntable(row.step)))?;
        let broken = rows.iter().filter(|r| !r.limit_kept).count();
        say!("{} steps, {broken} broke the contract; see {}", rows.len(), self.dir.join("report.html").display());
        Ok(())
    }

    fn write_report(&self, rows: &[StepRow], nodes: &Nodes, turntable: Option<Turntable>) -> anyhow::Result<()> {
        let trials = self.write_trials(nodes)?;
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let last = rows.last();
        let report = Report {
            title: self.title.clone(),
            source: self.source.clone(),
            machine: format!("{cores} cores, {}, {}", std::env::consts::ARCH, std::env::consts::OS),
            command: std::env::args().collect::<Vec<_>>().join(" "),
            limit: Limit {
                size_bytes: last.and_then(|r| r.size_limit_bytes),
                time_ms: last.and_then(|r| r.time_limit_ms),
            },
            steps: rows.iter().map(report_row).collect(),
            trials,
            pictures: self.pictures.clone(),
            turntable,
        };
        self.write("report.html", lamina_report::render(&report).as_bytes())
    }

    /// Writes `trials.csv` with all trials so far, and gives its rows.
    fn write_trials(&self, nodes: &Nodes) -> anyhow::Result<Vec<ReportTrial>> {
        let trials: Vec<ReportTrial> = nodes.trials()?.iter().map(trial_row).collect();
        self.write("trials.csv", &trials_csv(&trials)?)?;
        Ok(trials)
    }

    /// Writes a file whole: what was there stays until then.
    fn write(&self, name: &str, bytes: &[u8]) -> anyhow::Result<()> {
        let (path, part) = (self.dir.join(name), self.dir.join(format!("{name}.part")));
        fs::write(&part, bytes)
            .and_then(|()| fs::rename(&part, &path))
            .with_context(|| format!("{}: cannot be written", path.display()))
    }
}

fn trials_csv(trials: &[ReportTrial]) -> anyhow::Result<Vec<u8>> {
    let mut csv = csv::Writer::from_writer(Vec::new());
    csv.write_record([
        "step",
        "resolution",
        "gamma",
        "size_bytes",
        "generation_ms",
        "encode_ms",
        "psnr_db",
        "chosen",
        "representation",
    ])?;
    for t in trials {
        let [generation, encode] = [t.generation_ms, t.encode_ms].map(|ms| format!("{ms:.3}"));
        let psnr = if t.psnr_db.is_nan() { String::new() } else { format!("{:.3}", t.psnr_db) };
        let of = (t.step, t.resolution, t.gamma, t.size_bytes);
        csv.serialize((of, generation, encode, psnr, t.chosen, t.representation))?;
    }
    Ok(csv.into_inner()?)
}

fn report_row(row: &StepRow) -> lamina_report::ReportStep {
    lamina_report::ReportStep {
        step: row.step,
        time: row.time,
        resolution: row.resolution,
        gamma: row.gamma,
        size_bytes: row.size_bytes,
        generation_ms: row.generation_ms,
        encode_ms: row.encode_ms,
        supersegments: row.supersegments,
        psnr_db: row.psnr_db.map(f64::from),
        views: row.views.iter().map(|v| (v.angle_deg, v.psnr_db.into())).collect(),
        limit_kept: row.limit_kept,
        representation: row.representation.name(),
    }
}

fn trial_row(record: &v1::TrialRecord) -> ReportTrial {
    let params = GenerationParams::try_from(record.params.unwrap_or_default()).unwrap_or_default();
    let cost = record.cost.unwrap_or_default();
    ReportTrial {
        step: record.step,
        resolution: params.resolution(),
        gamma: params.gamma(),
        size_bytes: cost.size_bytes,
        generation_ms: cost.generation_ns as f64 / 1e6,
        encode_ms: cost.encode_ns as f64 / 1e6,
        psnr_db: record.psnr_db,
        chosen: record.chosen,
        representation: params.representation().name(),
    }
}
