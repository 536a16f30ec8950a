//! What the user wants: limits that every step must keep, and what is best among what keeps them.

use crate::evaluator::Measurement;
use crate::units::{Bytes, Millis, show_bytes};
use crate::utility::Utility;
use lamina_model::{Cost, Invalid, Limits, Representation, SamplePlan};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Limits on size, time and quality, and a utility; nu of the paper is such a contract with one limit.
///
/// Written as `size <= 300kB, time <= 40ms, psnr >= 35dB, cone <= 30deg, maximise psnr`; every part may be left out, and
/// `time+encoding <= 60ms` counts encoding too.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Contract {
    /// What every step must keep.
    pub limits: Limits,
    /// The least mean structural similarity of the views. Trials keep it; of live steps it is not measured.
    pub ssim: Option<f64>,
    /// Views up to so many degrees to either side count; without it, those of the generator-node's sample plan.
    pub cone_deg: Option<f64>,
    /// What is best among what keeps the limits; `None`: quality, or size where quality alone is limited.
    pub utility: Option<Utility>,
}

/// Decibels above a limit that a study aims at.
const MARGIN_DB: f64 = 0.2;

/// Share of a limit on time that a study aims at: steps alike differ by some percent on a machine that does other things too.
const TIME_AIMED_AT: f64 = 0.9;

/// By which share of what is left to 1 a study aims beyond a limit on structural similarity: 0.2 dB of it.
const MARGIN_SSIM: f64 = 0.045;

/// Further than any quality short of its limit.
const FAR: f64 = 100.0;

const HELP: &str = "write limits such as `size <= 300kB, time <= 40ms, psnr >= 35dB, ssim >= 0.98, cone <= 30deg, overhead <= 5%` (or `time+encoding <= 60ms` for `time`), and \
     `maximise psnr`, `minimise size`, `minimise time` or `maximise q - 0.01 * sigma`";

fn bad(part: &str, why: impl fmt::Display) -> Invalid {
    Invalid::new("contract", format!("\"{part}\": {why}; {HELP}"))
}

impl Default for Contract {
    /// 300 kB a step: what the product promises a user who names no price.
    fn default() -> Self {
        Self::size(300_000)
    }
}

impl Contract {
    /// The best quality within so many bytes: the paper's Eq. 1.
    pub fn size(limit_bytes: u64) -> Self {
        Self::of(Limits { size_bytes: Some(limit_bytes), ..Limits::default() })
    }

    /// The best quality within so much generation time: the paper's Eq. 2.
    pub fn time(limit_ms: f64) -> Self {
        Self::of(Limits { time_ms: Some(limit_ms), ..Limits::default() })
    }

    fn of(limits: Limits) -> Self {
        Self { limits, ssim: None, cone_deg: None, utility: None }
    }

    /// The utility in force.
    pub fn utility(&self) -> Utility {
        let quality = self.limits.psnr_db.is_some() || self.ssim.is_some();
        let quality_alone = quality && self.limits.size_bytes.is_none() && self.limits.time_ms.is_none();
        self.utility.clone().unwrap_or(if quality_alone { Utility::Size } else { Utility::Quality })
    }

    /// Where quality has to be measured: in views of the cone, if there is one; on every pixel where structure counts.
    pub fn sample_plan(&self) -> SamplePlan {
        let plan = if self.ssim.is_some() { SamplePlan::whole_views() } else { SamplePlan::default() };
        let of_cone = |d: f64| [-3.0, -2.0, -1.0, 1.0, 2.0, 3.0].map(|k| k * d / 3.0).to_vec();
        SamplePlan { angles_deg: self.cone_deg.map_or(plan.angles_deg.clone(), of_cone), ..plan }
    }

    /// What a study is to reach: a little more quality and less time than the limits say, so that the next steps, which differ
    /// a little, keep them too. (The generator-node itself keeps the limit on size.)
    #[must_use]
    pub fn aim(&self) -> Self {
        let limits = Limits {
            psnr_db: self.limits.psnr_db.map(|q| q + MARGIN_DB),
            time_ms: self.limits.time_ms.map(|ms| ms * TIME_AIMED_AT),
            ..self.limits
        };
        Self { limits, ssim: self.ssim.map(|least| least + MARGIN_SSIM * (1.0 - least)), ..self.clone() }
    }

    /// What trials have to keep where live steps take so many times as long.
    #[must_use]
    pub fn paced(&self, pace: f64) -> Self {
        Self { limits: Limits { time_ms: self.limits.time_ms.map(|ms| ms / pace), ..self.limits }, ..self.clone() }
    }

    /// The time that the limit is about, milliseconds.
    pub fn time_of(&self, cost: &Cost) -> f64 {
        self.limits.time_of(cost)
    }

    /// The longest that generation may take by itself, milliseconds; `None` where that is not limited,
    /// or counts encoding: always for volumes, which lose accuracy there.
    pub(crate) fn generation_limit_ms(&self, representation: Representation) -> Option<f64> {
        let alone = !self.limits.with_encoding && representation == Representation::Vdi;
        self.limits.time_ms.filter(|_| alone)
    }

    /// True if it depends on sizes what is best.
    pub(crate) fn weighs_size(&self) -> bool {
        self.limits.size_bytes.is_some() || self.utility().weighs_size()
    }

    /// By which factor the worst limit is exceeded: [`Limits::excess`].
    pub fn excess(&self, cost: &Cost, psnr_db: f64) -> f64 {
        self.limits.excess(cost, psnr_db)
    }

    /// The same of bytes, milliseconds ([`Self::time_of`]) and decibels.
    pub(crate) fn excess_of(&self, size_bytes: f64, ms: f64, psnr_db: f64) -> f64 {
        self.limits.excess_of(size_bytes, ms, psnr_db)
    }

    /// How far these figures are from keeping all limits, to be compared with others'. Whatever keeps those on size and time is
    /// nearer than what does not: the generator-node holds the limit on size in any case. Infinite where only the quality could
    /// tell and there is none.
    pub(crate) fn distance_of(&self, size_bytes: f64, ms: f64, psnr_db: f64) -> f64 {
        let cost = self.excess_of(size_bytes, ms, f64::NAN);
        if cost > 0.0 {
            FAR + cost
        } else if self.limits.psnr_db.is_some() && psnr_db.is_nan() {
            f64::INFINITY
        } else {
            self.excess_of(size_bytes, ms, psnr_db)
        }
    }

    /// alpha: lower is better; +infinity breaks a limit or measures nothing.
    #[doc(alias = "alpha")]
    pub fn cost(&self, measured: &Measurement) -> f64 {
        self.cost_at(measured, measured.quality.psnr_db())
    }

    /// alpha of a trial whose quality over all pixels is so many decibels.
    pub(crate) fn cost_at(&self, measured: &Measurement, psnr_db: f64) -> f64 {
        let Measurement { cost, quality } = measured;
        if self.breaks_ssim(quality) || psnr_db.is_nan() || self.excess(cost, psnr_db) > 0.0 {
            return f64::INFINITY;
        }
        self.utility().cost(cost.size_bytes, psnr_db, self.time_of(cost))
    }

    /// What these figures are against the limits, for people: `312.0 kB (limit 300.0 kB), 31.2 ms`.
    pub fn describe(&self, measured: &Measurement) -> String {
        let ms = self.time_of(&measured.cost);
        let db = measured.quality.psnr_db();
        let limit = |text: Option<String>| text.map_or_else(String::new, |t| format!(" (limit {t})"));
        format!(
            "{}{}, {ms:.1} ms{}, {}{}",
            show_bytes(measured.cost.size_bytes),
            limit(self.limits.size_bytes.map(show_bytes)),
            limit(self.limits.time_ms.map(|t| format!("{t} ms"))),
            if db.is_nan() { "quality not measured".to_owned() } else { format!("{db:.2} dB") },
            limit(self.limits.psnr_db.map(|q| format!("{q} dB"))),
        ) + &self.describe_ssim(&measured.quality)
    }

    fn limit(&mut self, part: &str) -> Result<(), Invalid> {
        let ordered = part.split_once("<=").map(|p| (p, true)).or_else(|| part.split_once(">=").map(|p| (p, false)));
        let ((name, value), at_most) = ordered.ok_or_else(|| bad(part, "not a limit"))?;
        let (name, value) = (name.trim(), value.trim());
        let once = |unset: bool| if unset { Ok(()) } else { Err(bad(part, "limited twice")) };
        match (name, at_most) {
            ("size", true) => {
                once(self.limits.size_bytes.is_none())?;
                self.limits.size_bytes = Some(value.parse::<Bytes>().map_err(|e| bad(part, e))?.0);
            }
            ("time" | "time+encoding", true) => {
                once(self.limits.time_ms.is_none())?;
                self.limits.time_ms = Some(value.parse::<Millis>().map_err(|e| bad(part, e))?.0);
                self.limits.with_encoding = name != "time";
            }
            ("psnr", false) => {
                once(self.limits.psnr_db.is_none())?;
                self.limits.psnr_db = Some(number(part, value, "dB", 0.0..=200.0)?);
            }
            ("ssim", false) => {
                once(self.ssim.is_none())?;
                self.ssim = Some(number(part, value, "", 0.0..=1.0)?);
            }
            ("cone", true) => {
                once(self.cone_deg.is_none())?;
                self.cone_deg = Some(number(part, value, "deg", 0.1..=180.0)?);
            }
            ("overhead", true) => {
                once(self.limits.overhead.is_none())?;
                self.limits.overhead = Some(number(part, value, "%", f64::MIN_POSITIVE..=100.0)? / 100.0);
            }
            ("size" | "time" | "time+encoding" | "cone" | "overhead", false) => {
                return Err(bad(part, "this is limited from above, <="));
            }
            ("psnr" | "ssim", true) => return Err(bad(part, "quality is limited from below, >=")),
            _ => return Err(bad(part, "there is no such quantity")),
        }
        Ok(())
    }
}

fn number(part: &str, value: &str, unit: &str, range: std::ops::RangeInclusive<f64>) -> Result<f64, Invalid> {
    let digits = value.strip_suffix(unit).unwrap_or(value).trim();
    let parsed = digits.parse().ok().filter(|v| range.contains(v));
    let (low, high) = (range.start(), range.end());
    let unit = if unit.is_empty() { String::new() } else { format!(" of {unit}") };
    parsed.ok_or_else(|| bad(part, format!("needs a number{unit} from {low} to {high}")))
}

impl FromStr for Contract {
    type Err = Invalid;

    fn from_str(text: &str) -> Result<Self, Invalid> {
        let mut contract = Self::of(Limits::default());
        for part in text.split(',').map(str::trim) {
            let aim = ["maximise ", "minimise "].iter().find_map(|w| part.strip_prefix(w).map(|rest| (*w, rest)));
            match aim {
                Some(_) if contract.utility.is_some() => return Err(bad(part, "a second aim")),
                Some((word, rest)) => {
                    contract.utility = Some(Utility::parse(word == "maximise ", rest).map_err(|e| bad(part, e))?);
                }
                None => contract.limit(part)?,
            }
        }
        Ok(contract)
    }
}

impl fmt::Display for Contract {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let time = if self.limits.with_encoding { "time+encoding" } else { "time" };
        let parts = [
            self.limits.size_bytes.map(|b| format!("size <= {}", Bytes(b))),
            self.limits.time_ms.map(|t| format!("{time} <= {t}ms")),
            self.limits.psnr_db.map(|q| format!("psnr >= {q}dB")),
            self.ssim.map(|least| format!("ssim >= {least}")),
            self.cone_deg.map(|d| format!("cone <= {d}deg")),
            self.limits.overhead.map(|share| format!("overhead <= {}%", (share * 1e8).round() / 1e6)),
            self.utility.as_ref().map(ToString::to_string),
        ];
        let parts: Vec<String> = parts.into_iter().flatten().collect();
        f.write_str(if parts.is_empty() { "maximise psnr" } else { "" })?;
        f.write_str(&parts.join(", "))
    }
}

impl TryFrom<String> for Contract {
    type Error = Invalid;
    fn try_from(text: String) -> Result<Self, Invalid> {
        text.parse()
    }
}

impl From<Contract> for String {
    fn from(contract: Contract) -> Self {
        contract.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamina_model::{Quality, ViewError};
    use std::time::Duration;

    fn measured(size_bytes: u64, ms: u64, mse: f64) -> Measurement {
        let cost = Cost { size_bytes, generation: Duration::from_millis(ms), ..Cost::default() };
        Measurement {
            cost,
            quality: Quality { views: vec![ViewError { angle_deg: 10.0, batch_mse: vec![mse], ssim: None }] },
        }
    }

    fn contract(text: &str) -> Contract {
        text.parse().unwrap()
    }

    #[test]
    fn cost_is_the_utility_within_all_limits_and_infinite_beyond_any() {
        let c = contract("size <= 300kB, time <= 40ms");
        assert!((c.cost(&measured(300_000, 40, 1e-3)) + 30.0).abs() < 1e-12);
        assert_eq!(c.cost(&measured(300_001, 40, 1e-3)), f64::INFINITY);
        assert_eq!(c.cost(&measured(1, 41, 1e-3)), f64::INFINITY);
        assert_eq!(c.cost(&measured(1, 1, 0.0)), f64::NEG_INFINITY);
        assert_eq!(c.cost(&measured(1, 1, f64::NAN)), f64::INFINITY);
        // Quality alone limited: the smallest is wanted.
        let c = contract("psnr >= 30 dB");
        assert_eq!(c.cost(&measured(5000, 1, 0.9e-3)), 5.0);
        assert_eq!(c.cost(&measured(5000, 1, 1.1e-3)), f64::INFINITY);
        let c = contract("psnr >= 30dB, maximise q - 2 * sigma - tau");
        assert!((c.cost(&measured(5000, 3, 1e-4)) - (-40.0 + 10.0 + 3.0)).abs() < 1e-12);
    }

    #[test]
    fn excess_is_the_worst_factor() {
        let c = contract("size <= 100B, psnr >= 20dB");
        assert!((c.excess(&measured(200, 0, 0.0).cost, 0.0) - 10_f64.ln()).abs() < 1e-12);
        assert!((c.excess(&measured(200, 0, 0.0).cost, f64::NAN) - 2_f64.ln()).abs() < 1e-12);
    }

    #[test]
    fn what_has_no_value_is_never_the_best() {
        // Division by nothing; but identical pictures have a quality, if no finite one.
        let c = contract("maximise q / 0");
        assert_eq!(c.cost(&measured(1, 1, 1e-3)), f64::INFINITY);
        assert_eq!(contract("maximise q - sigma").cost(&measured(1, 1, 0.0)), f64::NEG_INFINITY);
        assert!(c.describe(&measured(1, 1, f64::NAN)).ends_with("quality not measured"));
    }

    #[test]
    fn encoding_counts_where_it_is_asked_for() {
        let mut m = measured(1, 30, 1e-3);
        m.cost.encode = Duration::from_millis(20);
        assert!(contract("time <= 40ms").cost(&m).is_finite());
        assert_eq!(contract("time+encoding <= 40ms").cost(&m), f64::INFINITY);
    }

    #[test]
    fn what_is_written_comes_back_and_nonsense_is_refused_with_the_remedy() {
        for text in [
            "size <= 300kB",
            "size <= 999B",
            "size <= 252.501kB, maximise psnr",
            "size <= 1.000001MB",
            "time+encoding <= 40.5ms, psnr >= 35dB, minimise size",
            "ssim >= 0.98",
            "size <= 300kB, ssim >= 0.95, cone <= 30deg",
            "cone <= 30deg",
            "size <= 300kB, overhead <= 5%",
            "overhead <= 0.25%",
            "maximise psnr",
        ] {
            assert_eq!(contract(text).to_string(), text);
        }
        for bad in [
            "",
            "size",
            "size <= 300 parsecs",
            "size >= 300kB",
            "psnr <= 30dB",
            "psnr >= 30 kB",
            "size <= 1kB, size <= 2kB",
            "weight <= 3",
            "time <= -1ms",
            "psnr >= nan",
            "ssim >= 1.1",
            "ssim <= 0.9",
            "ssim >= 0.9, ssim >= 0.8",
            "cone <= 0",
            "overhead <= 0%",
            "overhead <= 101%",
            "overhead <= -5",
            "overhead >= 5%",
            "overhead <= 5%, overhead <= 6%",
            "maximise",
            "maximise fun",
            "minimise size, minimise time",
        ] {
            let error = bad.parse::<Contract>().unwrap_err().to_string();
            assert!(error.contains("write limits such as"), "{bad}: {error}");
        }
    }
}
