//! The numbers of one step, as the page, `steps.csv` and the report show them.

use lamina_model::{Diagnostics, Frame, Quality, Representation, TuningState, ViewError};
use lamina_vdi_render::QualityEstimate;
use serde::{Deserialize, Serialize};

/// A number that JSON may lack a word for: infinity travels as "inf".
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Number {
    /// An ordinary number.
    Finite(f64),
    /// `"inf"`: identical pictures.
    Word(Infinity),
}

/// The word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Infinity {
    /// +infinity.
    #[serde(rename = "inf")]
    Inf,
}

impl From<f64> for Number {
    fn from(x: f64) -> Self {
        if x.is_finite() { Self::Finite(x) } else { Self::Word(Infinity::Inf) }
    }
}

impl From<Number> for f64 {
    fn from(n: Number) -> Self {
        match n {
            Number::Finite(x) => x,
            Number::Word(Infinity::Inf) => Self::INFINITY,
        }
    }
}

/// PSNR of one test view.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ViewPsnr {
    /// Rotation about +y, degrees.
    pub angle_deg: f64,
    /// Decibels.
    pub psnr_db: Number,
}

/// Whether a step's quality was measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum QualityStatus {
    /// It came without reference samples.
    No,
    /// It waits for processor time.
    Pending,
    /// There was no processor time before a newer step came.
    Skipped,
    /// At a slice of the sampled pixels, or at all of them.
    Yes,
}

lamina_model::named!(QualityStatus, "measured", "neither no, pending, skipped nor yes", No "no", Pending "pending", Skipped "skipped", Yes "yes");

/// One recorded step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StepRow {
    /// The step's number.
    pub step: u64,
    /// Simulation time.
    pub time: f64,
    /// Rays per side; of a volume, the most sample points on a side.
    pub resolution: u32,
    /// Interrupt parameter; of a volume, the greatest error of a value.
    pub gamma: f64,
    /// Bytes as encoded.
    pub size_bytes: u64,
    /// Milliseconds of generation.
    pub generation_ms: f64,
    /// PSNR pooled over all views, decibels; `None` if the step came without reference samples.
    pub psnr_db: Option<Number>,
    /// Milliseconds of encoding.
    pub encode_ms: f64,
    /// Supersegments, or sample points.
    pub supersegments: u64,
    /// Steps the generator-node had dropped by then.
    pub dropped_steps: u64,
    /// NaN or infinite voxels, drawn as empty.
    pub empty_voxels: u64,
    /// Ranks that fell silent and whose bricks the step lacks.
    pub lost_ranks: Vec<u32>,
    /// Triggers that fired at the step.
    pub triggers: Vec<String>,
    /// Milliseconds that computing the shown field from the run's took.
    pub derivation_ms: f64,
    /// The step that this one was coded after; `None` for a key frame.
    pub after_step: Option<u64>,
    /// Mean structural similarity of all views, where all of their pixels were compared.
    pub ssim: Option<f64>,
    /// The size limit in force.
    pub size_limit_bytes: Option<u64>,
    /// The generation time limit in force.
    pub time_limit_ms: Option<f64>,
    /// The limit on quality in force, decibels; not in `steps.csv`.
    pub psnr_limit_db: Option<f64>,
    /// True if the step keeps the limits in force.
    pub limit_kept: bool,
    /// PSNR per view.
    pub views: Vec<ViewPsnr>,
    /// What the step was turned into.
    pub representation: Representation,
    /// Half the width of the 95 % interval about the PSNR, decibels.
    pub half_width_db: Option<f64>,
    /// Whether its quality was measured.
    pub measured: QualityStatus,
    /// Where its parameters come from.
    pub tuning: TuningState,
    /// By which share of its time a step of the simulation takes longer beside the nodes, where that is measured.
    pub overhead: Option<f64>,
    /// Share of its processor time that the generator-node allowed itself, at most 1.
    pub throttle: f64,
    /// What the simulation told of the step beside its field.
    pub diagnostics: Diagnostics,
}

impl StepRow {
    /// A live step that has just arrived; its quality is to be measured where it `has_reference`.
    pub fn live(frame: &Frame, has_reference: bool) -> Self {
        let measured = if has_reference { QualityStatus::Pending } else { QualityStatus::No };
        Self { measured, ..Self::new(frame, None) }
    }

    /// A trial and its measured quality.
    pub fn trial(frame: &Frame, quality: &Quality) -> Self {
        Self { measured: QualityStatus::Yes, ..Self::new(frame, Some(quality)) }
    }

    /// The same step, measured. It breaks a limit on quality only where the whole interval lies below.
    #[must_use]
    pub fn with_quality(&self, estimate: &QualityEstimate) -> Self {
        let QualityEstimate { quality, half_width_db } = estimate;
        let surely_kept = self.psnr_limit_db.is_none_or(|limit| quality.psnr_db() + half_width_db >= limit);
        Self {
            psnr_db: psnr(quality),
            half_width_db: Some(*half_width_db).filter(|w| w.is_finite()),
            views: views(quality),
            ssim: quality.ssim(),
            measured: QualityStatus::Yes,
            limit_kept: self.limit_kept && surely_kept,
            ..self.clone()
        }
    }

    fn new(frame: &Frame, quality: Option<&Quality>) -> Self {
        let Frame { params, cost, limits, .. } = frame;
        // A step whose quality was not measured breaks no limit on it.
        let limit_kept = limits.are_kept(cost, quality.map_or(f64::NAN, Quality::psnr_db));
        Self {
            step: frame.step,
            time: frame.time,
            resolution: params.resolution(),
            gamma: params.gamma(),
            size_bytes: cost.size_bytes,
            generation_ms: 1e3 * cost.generation.as_secs_f64(),
            psnr_db: quality.and_then(psnr),
            encode_ms: 1e3 * cost.encode.as_secs_f64(),
            supersegments: cost.elements,
            dropped_steps: frame.dropped_steps,
            empty_voxels: frame.empty_voxels,
            after_step: frame.after_step,
            lost_ranks: frame.lost_ranks.clone(),
            triggers: frame.triggers.clone(),
            derivation_ms: 1e3 * frame.derivation.as_secs_f64(),
            size_limit_bytes: limits.size_bytes,
            time_limit_ms: limits.time_ms,
            limit_kept,
            psnr_limit_db: limits.psnr_db,
            views: quality.map(views).unwrap_or_default(),
            ssim: quality.and_then(Quality::ssim),
            representation: params.representation(),
            half_width_db: None,
            measured: QualityStatus::No,
            tuning: frame.tuning,
            overhead: frame.overhead,
            throttle: frame.throttle,
            diagnostics: frame.diagnostics.clone(),
        }
    }
}

fn psnr(quality: &Quality) -> Option<Number> {
    Some(quality.psnr_db()).filter(|q| !q.is_nan()).map(Number::from)
}

fn views(quality: &Quality) -> Vec<ViewPsnr> {
    let view = |v: &ViewError| ViewPsnr { angle_deg: v.angle_deg, psnr_db: v.psnr_db().into() };
    quality.views.iter().map(view).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamina_model::{Cost, Limits};

    #[test]
    fn rows_go_to_csv_and_come_back() {
        let limits = Limits { size_bytes: Some(100), ..Limits::default() };
        let frame = Frame { step: 12, time: 0.25, limits, ..Frame::default() };
        let view = |angle_deg, mse| ViewError { angle_deg, batch_mse: vec![mse], ssim: Some(1.0 - 10.0 * mse) };
        // 40 dB, and identical.
        let [some, none] = [1e-4, 0.0].map(|mse| Quality { views: vec![view(10.0, mse), view(20.0, mse)] });
        let tuning = TuningState::Done;
        let measured = Frame {
            tuning,
            overhead: Some(0.0125),
            throttle: 0.5,
            lost_ranks: vec![3, 17],
            triggers: vec!["hot".into(), "fast".into()],
            diagnostics: "dt=0.05;residual=0.00000000125".parse().unwrap(),
            derivation: std::time::Duration::from_micros(1250),
            ..frame.clone()
        };
        let row = StepRow::live(&measured, true);
        let measured = [some, none].map(|quality| row.with_quality(&QualityEstimate { quality, half_width_db: 0.25 }));
        for row in [&measured[0], &measured[1], &row, &StepRow::live(&frame, false)] {
            let line = row.to_csv();
            assert_eq!(StepRow::from_csv(&line).unwrap(), *row);
            assert_eq!(row.ssim, row.psnr_db.map(|db| if f64::from(db).is_finite() { 0.999 } else { 1.0 }));
            assert_eq!(line.split(',').count(), StepRow::csv_header().split(',').count());
            assert_eq!(StepRow::from_csv(&line[..9]), None);
            // Lines of before there were shares, and of before there were volumes.
            for columns in [26, 24, 23, 21, 16, 15] {
                let old = StepRow::from_csv(&line.split(',').take(columns).collect::<Vec<_>>().join(",")).unwrap();
                assert_eq!((old.step, old.psnr_db), (row.step, row.psnr_db));
                assert!(columns > 24 || old.ssim.is_none());
                assert!(columns > 26 || old.diagnostics.is_empty());
                assert!(columns > 23 || old.derivation_ms == 0.0);
                assert!(columns > 21 || old.lost_ranks.is_empty());
                let since = [old.half_width_db, old.overhead];
                assert!(columns > 16 || since == [None, None], "{since:?}");
            }
        }
        // 40 dB keep a limit of 20; 10 dB do not, unless they are known so badly that they may be 20; encoding counts where it is to.
        let limits = Limits { psnr_db: Some(20.0), ..limits };
        let limited = Frame { limits, ..frame };
        let kept = |frame: &Frame, mse| StepRow::trial(frame, &Quality { views: vec![view(10.0, mse)] }).limit_kept;
        assert!(kept(&limited, 1e-4) && !kept(&limited, 0.1));
        let estimated = |half_width_db| {
            let quality = Quality { views: vec![view(10.0, 0.1)] };
            StepRow::live(&limited, true).with_quality(&QualityEstimate { quality, half_width_db }).limit_kept
        };
        assert!(estimated(11.0) && !estimated(9.0));
        let ns = std::time::Duration::from_nanos;
        let cost = Cost { generation: ns(30), encode: ns(20), ..Cost::default() };
        let timed = |with_encoding| {
            let limits = Limits { time_ms: Some(4e-5), with_encoding, ..Limits::default() };
            Frame { limits, cost, ..Frame::default() }
        };
        assert!(kept(&timed(false), 0.0) && !kept(&timed(true), 0.0));
        assert_eq!(
            StepRow::csv_header(),
            "step,time,resolution,gamma,size_bytes,generation_ms,psnr_db,encode_ms,supersegments,dropped_steps,\
             empty_voxels,size_limit_bytes,time_limit_ms,limit_kept,psnr_db_by_angle,representation,\
             psnr_half_width_db,measured,tuning,overhead,throttle,lost_ranks,triggers,derivation_ms,ssim,\
             after_step,diagnostics\n"
        );
    }
}
