//! The numbers of one step, as the page, `steps.csv` and the report show them.

use lamina_model::{Quality, Representation, ViewError};
use lamina_wire::convert::representation;
use lamina_wire::v1;
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
pub struct View {
    /// Rotation about +y, degrees.
    pub angle_deg: f64,
    /// Decibels.
    pub psnr_db: Number,
}

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
    /// The size limit in force.
    pub size_limit_bytes: Option<u64>,
    /// The generation time limit in force.
    pub time_limit_ms: Option<f64>,
    /// True if the step keeps the limits in force.
    pub limit_kept: bool,
    /// PSNR per view.
    pub views: Vec<View>,
    /// What the step was turned into.
    pub representation: Representation,
}

impl StepRow {
    /// A frame's numbers and its measured quality.
    pub fn new(frame: &v1::Frame, quality: Option<&Quality>) -> Self {
        let params = frame.params.unwrap_or_default();
        let cost = frame.cost.unwrap_or_default();
        let limits = frame.limits.unwrap_or_default();
        let size_kept = limits.size_bytes.is_none_or(|limit| cost.size_bytes <= limit);
        let time_ns = cost.generation_ns + if limits.with_encoding { cost.encode_ns } else { 0 };
        let time_kept = limits.time_ns.is_none_or(|limit| time_ns <= limit);
        // A step whose quality was not measured breaks no limit on it.
        let psnr_kept = limits.psnr_db.zip(quality).is_none_or(|(limit, q)| q.psnr_db() >= limit);
        let view = |v: &ViewError| View { angle_deg: v.angle_deg, psnr_db: v.psnr_db().into() };
        Self {
            step: frame.step,
            time: frame.time,
            resolution: params.resolution,
            gamma: params.gamma,
            size_bytes: cost.size_bytes,
            generation_ms: cost.generation_ns as f64 / 1e6,
            psnr_db: quality.map(Quality::psnr_db).filter(|q| !q.is_nan()).map(Number::from),
            encode_ms: cost.encode_ns as f64 / 1e6,
            supersegments: cost.supersegments,
            dropped_steps: frame.dropped_steps,
            empty_voxels: frame.empty_voxels,
            size_limit_bytes: limits.size_bytes,
            time_limit_ms: limits.time_ns.map(|ns| ns as f64 / 1e6),
            limit_kept: size_kept && time_kept && psnr_kept,
            views: quality.map(|q| q.views.iter().map(view).collect()).unwrap_or_default(),
            representation: representation(&params).unwrap_or_default(),
        }
    }

    /// First line of `steps.csv`.
    pub const CSV_HEADER: &'static str = "step,time,resolution,gamma,size_bytes,generation_ms,psnr_db,encode_ms,supersegments,dropped_steps,empty_voxels,size_limit_bytes,time_limit_ms,limit_kept,psnr_db_by_angle,representation";

    /// This step's line. What was not measured or limited is empty; views are `angle:decibels` joined by semicolons.
    pub fn to_csv(&self) -> String {
        let number = |n: Number| match n {
            Number::Finite(x) => format!("{x:.3}"),
            Number::Word(Infinity::Inf) => "inf".to_owned(),
        };
        let option = |o: Option<String>| o.unwrap_or_default();
        let views: Vec<String> = self.views.iter().map(|v| format!("{}:{}", v.angle_deg, number(v.psnr_db))).collect();
        format!(
            "{},{},{},{},{},{:.3},{},{:.3},{},{},{},{},{},{},{},{}",
            self.step,
            self.time,
            self.resolution,
            self.gamma,
            self.size_bytes,
            self.generation_ms,
            option(self.psnr_db.map(number)),
            self.encode_ms,
            self.supersegments,
            self.dropped_steps,
            self.empty_voxels,
            option(self.size_limit_bytes.map(|b| b.to_string())),
            option(self.time_limit_ms.map(|t| t.to_string())),
            self.limit_kept,
            views.join(";"),
            self.representation
        )
    }

    /// The step on a line of `steps.csv`; `None` if the line is not whole.
    pub fn from_csv(line: &str) -> Option<Self> {
        let mut fields: Vec<&str> = line.trim_end().split(',').collect();
        // Before there were volumes.
        if fields.len() == 15 {
            fields.push(Representation::Vdi.name());
        }
        let [
            step,
            time,
            resolution,
            gamma,
            size,
            generation,
            psnr,
            encode,
            segments,
            dropped,
            empty,
            size_limit,
            time_limit,
            kept,
            views,
            kind,
        ] = fields.try_into().ok()?;
        let number = |text: &str| text.parse::<f64>().ok().map(Number::from);
        let optional = |text: &str| if text.is_empty() { Some(None) } else { Some(Some(text.parse().ok()?)) };
        let view = |pair: &str| {
            let (angle, db) = pair.split_once(':')?;
            Some(View { angle_deg: angle.parse().ok()?, psnr_db: number(db)? })
        };
        Some(Self {
            step: step.parse().ok()?,
            time: time.parse().ok()?,
            resolution: resolution.parse().ok()?,
            gamma: gamma.parse().ok()?,
            size_bytes: size.parse().ok()?,
            generation_ms: generation.parse().ok()?,
            psnr_db: if psnr.is_empty() { None } else { Some(number(psnr)?) },
            encode_ms: encode.parse().ok()?,
            supersegments: segments.parse().ok()?,
            dropped_steps: dropped.parse().ok()?,
            empty_voxels: empty.parse().ok()?,
            size_limit_bytes: if size_limit.is_empty() { None } else { Some(size_limit.parse().ok()?) },
            time_limit_ms: optional(time_limit)?,
            limit_kept: kept.parse().ok()?,
            views: views.split(';').filter(|v| !v.is_empty()).map(view).collect::<Option<_>>()?,
            representation: kind.parse().ok()?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_go_to_csv_and_come_back() {
        let limits = v1::Limits { size_bytes: Some(100), psnr_db: Some(20.0), ..Default::default() };
        let frame = v1::Frame { step: 12, time: 0.25, limits: Some(limits), ..Default::default() };
        let view = |angle_deg, mse| ViewError { angle_deg, batch_mse: vec![mse] };
        // 40 dB, and identical.
        let [some, none] = [1e-4, 0.0].map(|mse| Quality { views: vec![view(10.0, mse), view(20.0, mse)] });
        for quality in [Some(&some), Some(&none), None] {
            let row = StepRow::new(&frame, quality);
            assert_eq!(StepRow::from_csv(&row.to_csv()).unwrap(), row);
            assert_eq!(row.to_csv().split(',').count(), StepRow::CSV_HEADER.split(',').count());
            assert_eq!(StepRow::from_csv(&row.to_csv()[..9]), None);
            let older = row.to_csv();
            assert_eq!(StepRow::from_csv(older.rsplit_once(',').unwrap().0).unwrap(), row);
        }
        // 40 dB keep a limit of 20; 10 dB do not; encoding counts where it is to.
        let kept =
            |frame: &v1::Frame, mse| StepRow::new(frame, Some(&Quality { views: vec![view(10.0, mse)] })).limit_kept;
        assert!(kept(&frame, 1e-4) && !kept(&frame, 0.1));
        let cost = v1::Cost { generation_ns: 30, encode_ns: 20, ..Default::default() };
        let timed = |with_encoding| {
            let limits = v1::Limits { time_ns: Some(40), with_encoding, ..Default::default() };
            v1::Frame { limits: Some(limits), cost: Some(cost), ..Default::default() }
        };
        assert!(kept(&timed(false), 0.0) && !kept(&timed(true), 0.0));
        assert!(StepRow::CSV_HEADER.starts_with("step,time,resolution,gamma,size_bytes,generation_ms,psnr_db,"));
    }
}
