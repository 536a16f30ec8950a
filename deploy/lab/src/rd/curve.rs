//! Curves of decibels against bytes: what of a coding is worth having, and how two codings compare over all of it.

/// One encoded volume.
#[derive(Debug, Clone)]
pub(super) struct Sample {
    /// Bytes.
    pub bytes: u64,
    /// PSNR over all views; may be infinite.
    pub psnr_db: f64,
    /// How it was made, for people.
    pub how: String,
    /// Milliseconds of generation, encoding and decoding; NaN where nobody measured them here.
    pub times_ms: [f64; 3],
}

/// All samples of one coding.
#[derive(Debug, Clone)]
pub(super) struct RateCurve {
    /// What the coding is called.
    pub coding: String,
    /// By rising bytes.
    pub samples: Vec<Sample>,
}

/// Corners of a front: ln(bytes) by rising decibels.
type CurveCorner = (f64, f64);

impl RateCurve {
    /// `samples` of `coding`, in any order.
    pub(super) fn new(coding: impl Into<String>, mut samples: Vec<Sample>) -> Self {
        samples.sort_by_key(|s| s.bytes);
        Self { coding: coding.into(), samples }
    }

    /// Takes in one more.
    pub(super) fn add(&mut self, sample: Sample) {
        let place = self.samples.partition_point(|s| s.bytes <= sample.bytes);
        self.samples.insert(place, sample);
    }

    /// The samples that no other of at most as many bytes is as good as, by rising bytes and decibels.
    pub(super) fn front(&self) -> Vec<&Sample> {
        let mut best = f64::NEG_INFINITY;
        let better = |s: &&Sample| {
            let better = s.psnr_db > best;
            best = best.max(s.psnr_db);
            better
        };
        let mut front: Vec<&Sample> = self.samples.iter().filter(|s| s.psnr_db.is_finite()).filter(better).collect();
        // Of equal bytes only the last is better than all.
        front.dedup_by(|later, earlier| {
            let same = later.bytes == earlier.bytes;
            if same {
                *earlier = later;
            }
            same
        });
        front
    }

    fn corners(&self) -> Vec<CurveCorner> {
        self.front().iter().map(|s| (s.psnr_db, (s.bytes.max(1) as f64).ln())).collect()
    }

    /// Bytes for so many decibels, between the two samples beside it; `None` if the front does not reach there.
    pub(super) fn bytes_at(&self, psnr_db: f64) -> Option<f64> {
        at(&self.corners(), psnr_db).map(f64::exp)
    }
}

/// The second coordinate at `x`, linear between corners.
fn at(corners: &[CurveCorner], x: f64) -> Option<f64> {
    let next = corners.partition_point(|c| c.0 < x);
    let b = corners.get(next)?;
    match next.checked_sub(1).map(|n| corners[n]) {
        Some(a) => Some(a.1 + (b.1 - a.1) * (x - a.0) / (b.0 - a.0)),
        None => (b.0 == x).then_some(b.1),
    }
}

/// Mean height of the line through `corners` over `from..to`, both within it.
fn mean(corners: &[CurveCorner], from: f64, to: f64) -> f64 {
    let inner = corners.iter().map(|c| c.0).filter(|x| (from..to).contains(x) && *x > from);
    let xs: Vec<f64> = std::iter::once(from).chain(inner).chain([to]).collect();
    let height = |x: f64| at(corners, x).unwrap_or(f64::NAN);
    let area: f64 = xs.windows(2).map(|w| 0.5 * (w[1] - w[0]) * (height(w[0]) + height(w[1]))).sum();
    area / (to - from)
}

/// How one curve compares with another where both reach (G. Bjontegaard, Calculation of Average PSNR Differences between
/// RD-curves, VCEG-M33, 2001; with straight lines between samples, as fronts are not cubic).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Difference {
    /// Mean change of bytes at equal decibels, percent: -50 is half of them.
    pub rate_percent: f64,
    /// Mean change of decibels at equal bytes.
    pub psnr_db: f64,
    /// The decibels compared over.
    pub range_db: (f64, f64),
}

/// `curve` against `anchor`; `None` if they have no decibels or no bytes in common.
pub(super) fn difference(curve: &RateCurve, anchor: &RateCurve) -> Option<Difference> {
    let [a, b] = [curve, anchor].map(RateCurve::corners);
    let common = |a: &[CurveCorner], b: &[CurveCorner]| {
        let (from, to) = (a.first()?.0.max(b.first()?.0), a.last()?.0.min(b.last()?.0));
        (from < to).then_some((from, to))
    };
    let range_db = common(&a, &b)?;
    let rate = mean(&a, range_db.0, range_db.1) - mean(&b, range_db.0, range_db.1);
    let swap = |c: Vec<CurveCorner>| c.into_iter().map(|(x, y)| (y, x)).collect::<Vec<CurveCorner>>();
    let (a, b) = (swap(a), swap(b));
    let psnr_db = common(&a, &b).map_or(f64::NAN, |(from, to)| mean(&a, from, to) - mean(&b, from, to));
    Some(Difference { rate_percent: 100.0 * rate.exp_m1(), psnr_db, range_db })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `scale` bytes, doubled every 6 dB from 30 to 60.
    fn curve(scale: f64) -> RateCurve {
        let sample = |k: i32| Sample {
            bytes: (scale * 2_f64.powi(k)).round() as u64,
            psnr_db: 30.0 + 6.0 * f64::from(k),
            how: String::new(),
            times_ms: [0.0; 3],
        };
        RateCurve::new("made up", (0..6).rev().map(sample).collect())
    }

    #[test]
    fn a_sixth_of_the_bytes_everywhere_is_minus_five_sixths() {
        let d = difference(&curve(1e5), &curve(6e5)).unwrap();
        assert!((d.rate_percent + 100.0 * 5.0 / 6.0).abs() < 1e-6, "{d:?}");
        // Six decibels a doubling: log2(6) doublings.
        assert!((d.psnr_db - 6.0 * 6_f64.log2()).abs() < 1e-3, "{d:?}");
        assert_eq!(d.range_db, (30.0, 60.0));
        let same = difference(&curve(1e5), &curve(1e5)).unwrap();
        assert_eq!((same.rate_percent, same.psnr_db), (0.0, 0.0));
    }

    #[test]
    fn the_front_has_no_sample_that_another_beats() {
        let mut c = curve(1000.0);
        let worse = Sample { bytes: 5000, psnr_db: 31.0, ..c.samples[0].clone() };
        let equal = Sample { bytes: 1000, psnr_db: 29.0, ..c.samples[0].clone() };
        let infinite = Sample { bytes: 10, psnr_db: f64::INFINITY, ..c.samples[0].clone() };
        c.samples.extend([worse, equal, infinite]);
        let c = RateCurve::new("more", c.samples);
        let front: Vec<(u64, f64)> = c.front().iter().map(|s| (s.bytes, s.psnr_db)).collect();
        assert_eq!(front, (0..6).map(|k| (1000 << k, 30.0 + 6.0 * k as f64)).collect::<Vec<_>>());
        assert!((c.bytes_at(33.0).unwrap() - 1000.0 * 2_f64.sqrt()).abs() < 1e-6);
        assert_eq!((c.bytes_at(29.9), c.bytes_at(60.1)), (None, None));
        assert!((c.bytes_at(30.0).unwrap() - 1000.0).abs() < 1e-9);
    }

    #[test]
    fn curves_with_nothing_in_common_are_not_compared() {
        let mut low = curve(1e5);
        low.samples.iter_mut().for_each(|s| s.psnr_db -= 40.0);
        assert_eq!(difference(&low, &curve(1e5)), None);
        assert_eq!(difference(&RateCurve::new("none", Vec::new()), &curve(1e5)), None);
    }
}
