//! A step as a line of `steps.csv`, column by column.

use super::row::{Number, QualityStatus, StepRow, ViewPsnr};
use csv::{StringRecord, WriterBuilder};
use lamina_model::{Representation, TuningState};
use serde::{Deserialize, Serialize};
use std::sync::LazyLock;

/// The columns in their order. New ones come last, so that a shorter line is one of an earlier version.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Line {
    step: u64,
    time: f64,
    resolution: u32,
    gamma: f64,
    size_bytes: u64,
    generation_ms: f64,
    psnr_db: Option<f64>,
    encode_ms: f64,
    supersegments: u64,
    dropped_steps: u64,
    empty_voxels: u64,
    size_limit_bytes: Option<u64>,
    time_limit_ms: Option<f64>,
    limit_kept: bool,
    /// `angle:decibels`, joined by semicolons.
    psnr_db_by_angle: String,
    #[serde(default)]
    representation: Representation,
    #[serde(default)]
    psnr_half_width_db: Option<f64>,
    #[serde(default)]
    measured: Option<QualityStatus>,
    #[serde(default)]
    tuning: TuningState,
    #[serde(default)]
    overhead: Option<f64>,
    #[serde(default)]
    throttle: f64,
    /// Joined by semicolons.
    #[serde(default)]
    lost_ranks: String,
    /// Joined by semicolons.
    #[serde(default)]
    triggers: String,
    #[serde(default)]
    derivation_ms: f64,
    #[serde(default)]
    ssim: Option<f64>,
    #[serde(default)]
    after_step: Option<u64>,
    /// `name=value`, joined by semicolons.
    #[serde(default)]
    diagnostics: String,
}

static HEADER: LazyLock<String> = LazyLock::new(|| {
    let mut names = written(&Line::default(), true);
    names.truncate(names.find('\n').map_or(0, |end| end + 1));
    names
});

/// Columns of lines from before there were volumes, before measuring had a share of the processor, before steps had holes, before
/// fields were computed, before structural similarity was measured, before steps were coded after others, and before simulations told
/// diagnostics.
const EARLIER: [usize; 7] = [15, 16, 21, 23, 24, 25, 26];

/// The line with its end, after the names of the columns if they are wanted.
fn written(line: &Line, with_names: bool) -> String {
    let mut writer = WriterBuilder::new().has_headers(with_names).from_writer(Vec::new());
    writer.serialize(line).expect("memory takes a flat record");
    let bytes = writer.into_inner().expect("memory is flushed");
    String::from_utf8(bytes).expect("all columns are text")
}

fn rounded(x: f64, digits: i32) -> f64 {
    let scale = 10_f64.powi(digits);
    (x * scale).round() / scale
}

impl StepRow {
    /// What the columns of `steps.csv` are called: its first line, with its end.
    pub fn csv_header() -> &'static str {
        &HEADER
    }

    /// This step's line, with its end. What was not measured or limited is empty; the limit on quality is not in it.
    pub fn to_csv(&self) -> String {
        let decibels = |n: Number| rounded(n.into(), 3);
        let view = |v: &ViewPsnr| format!("{}:{}", v.angle_deg, decibels(v.psnr_db));
        let line = Line {
            step: self.step,
            time: self.time,
            resolution: self.resolution,
            gamma: self.gamma,
            size_bytes: self.size_bytes,
            generation_ms: rounded(self.generation_ms, 3),
            psnr_db: self.psnr_db.map(decibels),
            encode_ms: rounded(self.encode_ms, 3),
            supersegments: self.supersegments,
            dropped_steps: self.dropped_steps,
            empty_voxels: self.empty_voxels,
            size_limit_bytes: self.size_limit_bytes,
            time_limit_ms: self.time_limit_ms,
            limit_kept: self.limit_kept,
            psnr_db_by_angle: self.views.iter().map(view).collect::<Vec<_>>().join(";"),
            representation: self.representation,
            psnr_half_width_db: self.half_width_db.map(|w| rounded(w, 3)),
            measured: Some(self.measured),
            tuning: self.tuning,
            overhead: self.overhead.map(|o| rounded(o, 4)),
            throttle: self.throttle,
            lost_ranks: self.lost_ranks.iter().map(u32::to_string).collect::<Vec<_>>().join(";"),
            triggers: self.triggers.join(";"),
            derivation_ms: rounded(self.derivation_ms, 3),
            ssim: self.ssim.map(|s| rounded(s, 5)),
            after_step: self.after_step,
            diagnostics: self.diagnostics.to_string(),
        };
        written(&line, false)
    }

    /// The step on a line of `steps.csv`; `None` if the line is not whole.
    pub fn from_csv(line: &str) -> Option<Self> {
        let fields: StringRecord = line.trim_end().split(',').collect();
        let columns = HEADER.trim_end().split(',');
        if columns.clone().count() != fields.len() && !EARLIER.contains(&fields.len()) {
            return None;
        }
        let columns: StringRecord = columns.take(fields.len()).collect();
        let line: Line = fields.deserialize(Some(&columns)).ok()?;
        let view = |pair: &str| {
            let (angle, db) = pair.split_once(':')?;
            Some(ViewPsnr { angle_deg: angle.parse().ok()?, psnr_db: db.parse::<f64>().ok()?.into() })
        };
        let views = line.psnr_db_by_angle.split(';').filter(|v| !v.is_empty()).map(view).collect::<Option<_>>()?;
        let lost_ranks = line.lost_ranks.split(';').filter(|r| !r.is_empty()).map(str::parse).collect::<Result<_, _>>();
        let lost_ranks = lost_ranks.ok()?;
        let measured = if line.psnr_db.is_some() { QualityStatus::Yes } else { QualityStatus::No };
        Some(Self {
            step: line.step,
            time: line.time,
            resolution: line.resolution,
            gamma: line.gamma,
            size_bytes: line.size_bytes,
            generation_ms: line.generation_ms,
            psnr_db: line.psnr_db.map(Number::from),
            encode_ms: line.encode_ms,
            supersegments: line.supersegments,
            dropped_steps: line.dropped_steps,
            empty_voxels: line.empty_voxels,
            lost_ranks,
            triggers: line.triggers.split(';').filter(|name| !name.is_empty()).map(str::to_owned).collect(),
            derivation_ms: line.derivation_ms,
            ssim: line.ssim,
            after_step: line.after_step,
            size_limit_bytes: line.size_limit_bytes,
            time_limit_ms: line.time_limit_ms,
            psnr_limit_db: None,
            limit_kept: line.limit_kept,
            views,
            representation: line.representation,
            half_width_db: line.psnr_half_width_db,
            measured: line.measured.unwrap_or(measured),
            tuning: line.tuning,
            overhead: line.overhead,
            throttle: line.throttle,
            diagnostics: line.diagnostics.parse().ok()?,
        })
    }
}
