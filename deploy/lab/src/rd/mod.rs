//! `lamina-lab rd`: decibels against bytes of every representation and coding, and of what users would ship instead.
//!
//! PSNR is pooled over the paper's novel views (10 to 60 degrees, 768 x 768, one pixel in 16). Curves are
//! fronts over all parameters measured; the anchor is the paper's plain layout.

mod curve;
mod peers;

use crate::cli;
use crate::table::Table;
use anyhow::{Context, ensure};
use curve::{RateCurve, Sample, difference};
use indicatif::{ProgressBar, ProgressStyle};
use lamina::offline::{open, prepare};
use lamina::say;
use lamina_codec::{Codec, DecodeLimits, EncodeOptions, ErrorMeasure, Layout};
use lamina_model::{GenerationParams, Intermediate, ReferenceSamples, SamplePlan, Segmentation, VdiParams};
use lamina_raycast::{Field, most_points};
use lamina_report::numbers::significant;
use lamina_report::panel::{CLASSES, PlotLine, file, panel};
use lamina_tuner::units::show_bytes;
use lamina_vdi_render::{Detail, Drawable, Kernels};
use std::path::Path;
use std::time::Instant;

/// Rays a side and interrupt parameters of VDIs.
const RAYS: [u32; 6] = [96, 128, 192, 256, 384, 512];
const GAMMAS: [f64; 6] = [0.1, 0.05, 0.02, 0.01, 0.005, 0.002];
/// Shares of the sample points on a side, and error bounds, of reduced volumes.
const SHARES: [f64; 5] = [1.0, 0.75, 0.5, 0.375, 0.25];
const BOUNDS: [f64; 12] = [0.2, 0.14, 0.1, 0.07, 0.05, 0.035, 0.025, 0.017, 0.012, 0.008, 0.005, 0.003];
/// Decibels at which bytes are quoted.
const QUOTED_DB: [f64; 4] = [36.0, 40.0, 44.0, 48.0];

/// The anchor of all comparisons, what the paper has, and what else is done with VDIs, one thing after the other.
const VDI_CODINGS: [(&str, Segmentation, EncodeOptions, Detail); 5] = [
    ("VDI, plain", Segmentation::Greedy, PLAIN, Detail::Nearest),
    ("VDI, columns", Segmentation::Greedy, EncodeOptions::BZIP2, Detail::Nearest),
    ("VDI, blended", Segmentation::Greedy, EncodeOptions::BZIP2, Detail::Cubic),
    ("VDI, fitted", Segmentation::Fitted, EncodeOptions::BZIP2, Detail::Cubic),
    ("VDI, context mixing", Segmentation::Fitted, CONTEXT_MIXING, Detail::Cubic),
];
const PLAIN: EncodeOptions = EncodeOptions { codec: Codec::Bzip2, layout: Layout::Plain, ..EncodeOptions::BZIP2 };
const CONTEXT_MIXING: EncodeOptions =
    EncodeOptions { codec: Codec::ContextMixing, layout: Layout::Columns, error: ErrorMeasure::MeanSquare };

/// Volumes of all sample points: in the tables only, as their curve lies on that of all volumes.
const WHOLE: &str = "volume, whole";

/// What was drawn last.
struct Seen {
    decoded: Intermediate,
    detail: Detail,
    psnr_db: f64,
}

/// What is measured on.
struct RateDistortion {
    field: Field,
    kernels: Kernels,
    reference: ReferenceSamples,
    bar: ProgressBar,
}

impl RateDistortion {
    fn psnr_db(&self, shown: &Drawable, detail: Detail) -> anyhow::Result<f64> {
        Ok(self.kernels.draw.quality(shown, &self.reference, 0..self.reference.plan.batches, detail)?.psnr_db())
    }

    /// One representation in one coding, as the viewer shows it; `seen` is what it showed last, so that codings without loss
    /// of their own are drawn once.
    fn sample(
        &self,
        intermediate: &Intermediate,
        generation_ms: f64,
        options: &EncodeOptions,
        detail: Detail,
        seen: &mut Option<Seen>,
    ) -> anyhow::Result<Sample> {
        let params = intermediate.params();
        self.bar.inc(1);
        let start = Instant::now();
        let bytes = lamina_codec::encode_any(intermediate, options)?;
        let encoded = Instant::now();
        let decoded = lamina_codec::decode_any(&bytes, &DecodeLimits::default())?;
        let decode_ms = encoded.elapsed().as_secs_f64() * 1e3;
        let psnr_db = match seen {
            Some(seen) if seen.detail == detail && seen.decoded == decoded => seen.psnr_db,
            _ => {
                let psnr_db = self.psnr_db(&Drawable::new(decoded.clone()), detail)?;
                *seen = Some(Seen { decoded, detail, psnr_db });
                psnr_db
            }
        };
        Ok(Sample {
            bytes: bytes.len() as u64,
            psnr_db,
            how: format!("r {} gamma {}", params.resolution(), params.gamma()),
            times_ms: [generation_ms, (encoded - start).as_secs_f64() * 1e3, decode_ms],
        })
    }

    /// Adds curves of VDIs to `results`, which are saved as they grow.
    fn vdis(&self, base: &GenerationParams, results: &mut Results) -> anyhow::Result<()> {
        let first = results.curves.len();
        results.curves.extend(VDI_CODINGS.map(|(name, ..)| RateCurve::new(name, Vec::new())));
        for r in RAYS {
            for gamma in GAMMAS {
                let params = base.with_resolution(r)?.with_gamma(gamma)?;
                for segmentation in [Segmentation::Greedy, Segmentation::Fitted] {
                    let (vdi, time) = self.kernels.cast.represent(&self.field, &params, segmentation)?;
                    let mut seen = None;
                    let codings = VDI_CODINGS.iter().zip(&mut results.curves[first..]);
                    for ((.., options, detail), curve) in codings.filter(|((_, s, ..), _)| *s == segmentation) {
                        curve.add(self.sample(&vdi, time.as_secs_f64() * 1e3, options, *detail, &mut seen)?);
                    }
                }
            }
            results.save()?;
        }
        Ok(())
    }

    /// Adds curves of volumes: those of all sample points, to be compared with codecs of volumes, and those of fewer too.
    fn volumes(&self, base: &GenerationParams, results: &mut Results) -> anyhow::Result<()> {
        let first = results.curves.len();
        results.curves.extend([WHOLE, "volume"].map(|name| RateCurve::new(name, Vec::new())));
        let side = f64::from(self.field.grid().longest_side());
        let base = GenerationParams::volume(base.resolution(), base.gamma())?;
        for share in SHARES {
            let params = base.with_resolution((side * share).round().max(2.0) as u32)?;
            let start = Instant::now();
            let volumes = self.kernels.cast.represent_all(&self.field, &params, &BOUNDS, Segmentation::Fitted)?;
            let reduction_ms = start.elapsed().as_secs_f64() * 1e3;
            for volume in volumes {
                let sample = self.sample(&volume, reduction_ms, &CONTEXT_MIXING, Detail::Cubic, &mut None)?;
                if share == 1.0 {
                    results.curves[first].add(sample.clone());
                }
                results.curves[first + 1].add(sample);
            }
            results.save()?;
        }
        Ok(())
    }
}

/// All curves so far, and the folder they are saved in.
struct Results<'a> {
    curves: Vec<RateCurve>,
    out: &'a Path,
}

impl Results<'_> {
    /// Writes the curves so far: whoever stops the command keeps them.
    fn save(&self) -> anyhow::Result<()> {
        let curves = &self.curves;
        write_samples(self.out, curves)?;
        write_differences(self.out, curves)?;
        let path = self.out.join("rd.svg");
        std::fs::write(&path, drawing(curves)).with_context(|| format!("{}: cannot be written", path.display()))
    }
}

/// `lamina-lab rd`.
pub(crate) fn rd(arguments: &cli::Rd) -> anyhow::Result<()> {
    let (volume, scene) = open(&arguments.input)?;
    ensure!(
        arguments.peers.is_none() || scene.effects.color_field.is_none(),
        "--peers: other codings hold one field, and this scene takes its colors from a second; leave one of the two out"
    );
    std::fs::create_dir_all(&arguments.out)
        .with_context(|| format!("{}: cannot be created", arguments.out.display()))?;
    let kernels = Kernels::open(arguments.input.backend)?;
    let field = prepare(volume, &scene);
    let plan = SamplePlan { batches: 64, ..SamplePlan::default() };
    let reference = kernels.cast.reference_samples(&field, &plan, arguments.input.time_step as u64)?;
    let of_vdis = if arguments.volumes_only { 0 } else { RAYS.len() * GAMMAS.len() * VDI_CODINGS.len() };
    let encodings = of_vdis + SHARES.len() * BOUNDS.len();
    let bar = ProgressBar::new(encodings as u64);
    let style = ProgressStyle::with_template("{bar:30} {pos}/{len} encodings  {elapsed}  {eta} to go")?;
    bar.set_style(style);
    let bench = RateDistortion { field, kernels, reference, bar };
    let base = VdiParams::new(1, 0.0)?.with_step_voxels(scene.step_voxels)?.into();
    let mut results = Results { curves: Vec::new(), out: &arguments.out };
    if !arguments.volumes_only {
        bench.vdis(&base, &mut results)?;
    }
    if most_points(&bench.field) > 0 {
        bench.volumes(&base, &mut results)?;
    } else {
        bench.bar.suspend(|| say!("{}", lamina_model::ReducedVolume::WHY_NONE));
    }
    if let Some(table) = &arguments.peers {
        results.curves.extend(peers::curves(table, &bench)?);
    }
    bench.bar.finish_and_clear();
    results.save()?;
    say!("{}", table(&results.curves).trim_end());
    Ok(())
}

fn write_samples(folder: &Path, curves: &[RateCurve]) -> anyhow::Result<()> {
    let columns = ["coding", "how", "bytes", "psnr_db", "generation_ms", "encode_ms", "decode_ms", "front"];
    let mut table = Table::create(folder, "rd.csv", columns)?;
    for curve in curves {
        let front = curve.front();
        for s in &curve.samples {
            let on_front = front.iter().any(|f| std::ptr::eq(*f, s));
            let times = s.times_ms.map(|t| if t.is_nan() { String::new() } else { format!("{t:.2}") });
            let of = [curve.coding.to_owned(), s.how.to_string(), s.bytes.to_string(), format!("{:.3}", s.psnr_db)];
            table.row(of.into_iter().chain(times).chain([on_front.to_string()]))?;
        }
    }
    table.finish()
}

fn write_differences(folder: &Path, curves: &[RateCurve]) -> anyhow::Result<()> {
    let columns = ["coding", "bd_rate_percent", "bd_psnr_db", "from_db", "to_db"];
    let mut table = Table::create(folder, "bd.csv", columns)?;
    for curve in curves {
        if let Some(d) = difference(curve, &curves[0]) {
            let [rate, from, to] = [d.rate_percent, d.range_db.0, d.range_db.1].map(|x| format!("{x:.2}"));
            table.row([curve.coding.to_owned(), rate, format!("{:.3}", d.psnr_db), from, to])?;
        }
    }
    table.finish()
}

fn table(curves: &[RateCurve]) -> String {
    let mut text = format!("{:24}", "coding");
    QUOTED_DB.iter().for_each(|db| text += &format!("{:>14}", format!("{db} dB")));
    text += &format!("{:>12}{:>12}\n", "BD-rate", "BD-PSNR");
    for curve in curves {
        text += &format!("{:24}", curve.coding);
        for db in QUOTED_DB {
            let bytes = curve.bytes_at(db).map_or_else(|| "-".to_owned(), |b| show_bytes(b as u64));
            text += &format!("{bytes:>14}");
        }
        match difference(curve, &curves[0]) {
            Some(d) => text += &format!("{:>10.1} %{:>9.2} dB\n", d.rate_percent, d.psnr_db),
            None => text += &format!("{:>12}{:>12}\n", "-", "-"),
        }
    }
    text
}

fn drawing(curves: &[RateCurve]) -> String {
    let line = |(n, curve): (usize, &RateCurve)| {
        let point = |s: &&Sample| {
            let words =
                format!("{}, {}: {}, {} dB", curve.coding, s.how, show_bytes(s.bytes), significant(s.psnr_db, 4));
            (s.bytes as f64 / 1e3, s.psnr_db, words)
        };
        PlotLine {
            class: CLASSES[n % CLASSES.len()],
            name: curve.coding.clone(),
            points: curve.front().iter().map(point).collect(),
        }
    };
    let lines: Vec<PlotLine> = curves.iter().filter(|c| c.coding != WHOLE).enumerate().map(line).collect();
    file("Decibels against bytes", &[panel("size, kB", &lines)])
}
