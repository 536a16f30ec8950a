//! Transfer functions: from a scalar to color and extinction.

use crate::corners::{self, Corner};
use crate::{Grid, Invalid, ScalarRange, Scale, composite};
use serde::{Deserialize, Serialize};

/// One corner of the piecewise-linear transfer function.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlPoint {
    /// Position in the scalar range, 0..1.
    pub at: f64,
    /// Red, green, blue, each 0..1.
    pub color: [f64; 3],
    /// Opacity of one unit length, 0..1.
    pub opacity: f64,
}

/// A 1-D transfer function, linear between control points, constant beyond the first and last.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "TransferFields", into = "TransferFields")]
pub struct TransferFunction {
    range: ScalarRange,
    unit_length: Option<f64>,
    points: Vec<ControlPoint>,
    /// Per 1/256 of the range, the number of points at or before its start: where the search for a position begins.
    starts: Vec<u16>,
    /// Per point, how many before it are not transparent; one more at the end.
    shining: Vec<u16>,
}

/// Intervals of [`TransferFunction::starts`].
const BINS: usize = 256;

/// A transfer function as written in files.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransferFields {
    /// The scalars shown.
    pub range: ScalarRange,
    /// World length that opacity refers to; one voxel if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit_length: Option<f64>,
    /// Corners, by ascending position.
    pub points: Vec<ControlPoint>,
}

impl TryFrom<TransferFields> for TransferFunction {
    type Error = Invalid;
    fn try_from(f: TransferFields) -> Result<Self, Invalid> {
        Self::new(f.range, f.unit_length, f.points)
    }
}

impl From<TransferFunction> for TransferFields {
    fn from(t: TransferFunction) -> Self {
        Self { range: t.range, unit_length: t.unit_length, points: t.points }
    }
}

/// What the transfer function makes of one sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Classified {
    /// Straight (not premultiplied) red, green, blue.
    pub color: [f64; 3],
    /// Opacity of one unit length.
    pub opacity: f64,
    /// Extinction kappa, 1 / world length; 0 is empty, infinity opaque.
    pub extinction: f64,
}

impl Classified {
    /// Nothing there.
    pub const EMPTY: Self = Self { color: [0.0; 3], opacity: 0.0, extinction: 0.0 };
}

impl Corner<4> for ControlPoint {
    fn at(&self) -> f64 {
        self.at
    }
    fn values(&self) -> [f64; 4] {
        [self.color[0], self.color[1], self.color[2], self.opacity]
    }
}

impl TransferFunction {
    /// The most control points accepted.
    pub const MAX_POINTS: usize = 4096;

    /// A transfer function over `range`; `unit_length` is the world length that opacities refer to (`None`: one voxel).
    ///
    /// # Errors
    /// If there is no point, the points do not ascend, or a number is outside its interval.
    pub fn new(range: ScalarRange, unit_length: Option<f64>, points: Vec<ControlPoint>) -> Result<Self, Invalid> {
        corners::check("transfer.points", &points, (Self::MAX_POINTS, 0.0))?;
        if unit_length.is_some_and(|l| !(l.is_finite() && l > 0.0)) {
            return Err(Invalid::new("transfer.unit_length", format!("{unit_length:?} must be finite and positive")));
        }
        let before = |u: f64| points.partition_point(|p| p.at <= u) as u16;
        let starts = (0..=BINS).map(|b| before(b as f64 / BINS as f64)).collect();
        let count = |n: &mut u16, p: Option<&ControlPoint>| {
            let before = *n;
            *n += u16::from(p.is_some_and(|p| p.opacity > 0.0));
            Some(before)
        };
        let shining = points.iter().map(Some).chain([None]).scan(0, count).collect();
        Ok(Self { range, unit_length, points, starts, shining })
    }

    /// The scalars shown.
    pub fn range(&self) -> &ScalarRange {
        &self.range
    }
    /// The corners.
    pub fn points(&self) -> &[ControlPoint] {
        &self.points
    }
    /// The world length opacities refer to, if stated.
    pub fn stated_unit_length(&self) -> Option<f64> {
        self.unit_length
    }
    /// The same with opacities that refer to `unit_length`, which is positive.
    pub fn with_unit_length(&self, unit_length: f64) -> Self {
        Self { unit_length: Some(unit_length), ..self.clone() }
    }
    /// The world length opacities refer to on `grid`.
    pub fn unit_length(&self, grid: &Grid) -> f64 {
        self.unit_length.unwrap_or_else(|| grid.voxel_length())
    }

    /// Color and opacity at position `u` of the range; NaN is transparent. Two points at one position make a jump, which
    /// takes the later point's value.
    #[inline]
    pub fn at(&self, u: f32) -> ([f64; 3], f64) {
        if u.is_nan() {
            return ([0.0; 3], 0.0);
        }
        let u = f64::from(u);
        let before = if u < 0.0 { 0 } else { usize::from(self.starts[((u * BINS as f64) as usize).min(BINS)]) };
        let [red, green, blue, opacity] = corners::interpolate(&self.points, before, u);
        ([red, green, blue], opacity)
    }

    /// Color and extinction at position `u`, with opacities referring to `unit_length`.
    #[inline]
    pub fn classify(&self, u: f32, unit_length: f64) -> Classified {
        let (color, opacity) = self.at(u);
        if opacity <= 0.0 {
            return Classified::EMPTY;
        }
        Classified { color, opacity, extinction: composite::optical_depth_from_opacity(opacity) / unit_length }
    }

    /// True if everything from `lo` to `hi` of the range is transparent.
    pub fn is_transparent(&self, lo: f32, hi: f32) -> bool {
        let (a, b) = (f64::from(lo), f64::from(hi));
        let first = self.points.partition_point(|p| p.at < a);
        let beyond = first + self.points[first..].partition_point(|p| p.at <= b);
        let corner = self.shining[first] < self.shining[beyond];
        // Of two corners at one position `at` sees the later; just below, the earlier may still shine in.
        !corner && self.at(lo).1 <= 0.0 && self.at(hi).1 <= 0.0
    }

    /// The parts of the scale on which everything is transparent, ends included, in order; a first or last one may go on for
    /// ever.
    pub fn transparent_parts(&self) -> Vec<[f32; 2]> {
        // Ends in single precision, rounded inwards.
        let inwards = |x: f64, towards: fn(f32) -> f32, beyond: fn(&f64, &f64) -> bool| {
            let rounded = x as f32;
            if beyond(&f64::from(rounded), &x) { towards(rounded) } else { rounded }
        };
        let mut ends = vec![f64::NEG_INFINITY];
        ends.extend(self.points.iter().map(|p| p.at));
        ends.push(f64::INFINITY);
        let mut parts: Vec<[f32; 2]> = Vec::new();
        for pair in ends.windows(2) {
            let (lo, hi) = (inwards(pair[0], f32::next_up, f64::lt), inwards(pair[1], f32::next_down, f64::gt));
            // A jump at an end belongs to what shows.
            let shorter = [(lo, hi), (lo, hi.next_down()), (lo.next_up(), hi), (lo.next_up(), hi.next_down())];
            let Some((lo, hi)) = shorter.into_iter().find(|&(lo, hi)| lo <= hi && self.is_transparent(lo, hi)) else {
                continue;
            };
            match parts.last_mut() {
                Some(last) if self.is_transparent(last[0], hi) => last[1] = hi,
                _ => parts.push([lo, hi]),
            }
        }
        parts
    }

    /// The same where `recorded`, over the same range, shows anything, and transparent elsewhere.
    ///
    /// # Errors
    /// If that takes more than [`Self::MAX_POINTS`] points.
    pub fn where_shown_by(&self, recorded: &Self) -> Result<Self, Invalid> {
        let own = |u: f32| {
            let (color, opacity) = self.at(u);
            ControlPoint { at: f64::from(u).clamp(0.0, 1.0), color, opacity }
        };
        let clear = |u: f32| ControlPoint { opacity: 0.0, ..own(u) };
        let mut points = Vec::new();
        let mut from = f32::NEG_INFINITY;
        for [lo, hi] in recorded.transparent_parts().into_iter().chain([[f32::INFINITY; 2]]) {
            // No single-precision position lies between the ends of two neighboring intervals.
            let to = lo.next_down();
            if from < to {
                points.push(own(from));
                let between = |p: &&ControlPoint| p.at > f64::from(from) && p.at <= f64::from(to);
                points.extend(self.points.iter().filter(between));
                points.push(own(to));
            }
            if lo < f32::INFINITY {
                points.extend([clear(lo), clear(hi)]);
            }
            from = hi.next_up();
        }
        Self::new(self.range, self.unit_length, points)
    }

    /// The positions outside which everything is transparent, ends included; empty (`lo > hi`) if nothing shows.
    pub fn visible_hull(&self) -> [f32; 2] {
        let shines = |p: &ControlPoint| p.opacity > 0.0;
        let (Some(first), Some(last)) = (self.points.iter().position(shines), self.points.iter().rposition(shines))
        else {
            return [1.0, 0.0];
        };
        // Between points opacity is linear, so it vanishes at the neighbor; rounding outwards keeps the hull whole.
        let lo = first.checked_sub(1).map_or(f32::NEG_INFINITY, |i| (self.points[i].at as f32).next_down());
        let hi = self.points.get(last + 1).map_or(f32::INFINITY, |p| (p.at as f32).next_up());
        [lo, hi]
    }

    /// An identity: equal for equal transfer functions (64-bit FNV-1a over all numbers in order).
    pub fn id(&self) -> u64 {
        let head = [
            self.range.lo(),
            self.range.hi(),
            f64::from(u8::from(self.range.scale() == Scale::Log10)),
            self.unit_length.unwrap_or(0.0),
        ];
        let points = self.points.iter().flat_map(|p| [p.at, p.color[0], p.color[1], p.color[2], p.opacity]);
        head.into_iter()
            .chain(points)
            .flat_map(f64::to_le_bytes)
            .fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> TransferFunction {
        let p = |at, opacity| ControlPoint { at, color: [at, 0.5, 1.0], opacity };
        let range = ScalarRange::new(0.0, 10.0, Scale::Linear).unwrap();
        TransferFunction::new(range, None, vec![p(0.25, 0.0), p(0.5, 0.5), p(0.5, 1.0), p(1.0, 1.0)]).unwrap()
    }

    #[test]
    fn it_is_linear_between_points_constant_beyond_and_jumps_where_two_coincide() {
        assert_eq!(ramp().at(0.0).1, 0.0);
        assert_eq!(ramp().at(0.375).1, 0.25);
        assert!((ramp().at(0.499_999).1 - 0.5).abs() < 1e-5);
        assert_eq!(ramp().at(0.5).1, 1.0);
        assert_eq!(ramp().at(7.0), ([1.0, 0.5, 1.0], 1.0));
        assert_eq!(ramp().at(f32::NAN).1, 0.0);
    }

    #[test]
    fn transparent_parts_are_all_of_the_scale_that_shows_nothing() {
        let p = |at, opacity| ControlPoint { at, color: [1.0; 3], opacity };
        let parts = |points: Vec<ControlPoint>| {
            let range = ScalarRange::new(0.0, 1.0, Scale::Linear).unwrap();
            TransferFunction::new(range, None, points).unwrap().transparent_parts()
        };
        let (least, most) = (f32::NEG_INFINITY, f32::INFINITY);
        assert_eq!(
            parts(vec![p(0.25, 0.0), p(0.375, 0.0), p(0.5, 0.3), p(0.625, 0.0), p(0.75, 0.0), p(1.0, 1.0)]),
            [[least, 0.375], [0.625, 0.75]]
        );
        assert_eq!(parts(vec![p(0.0, 0.0), p(0.5, 0.0)]), [[least, most]]);
        assert_eq!(parts(vec![p(0.0, 0.1), p(1.0, 0.1)]), [[0.0; 2]; 0]);
        let jump = parts(vec![p(0.0, 0.0), p(0.5, 0.0), p(0.5, 0.8), p(0.75, 0.8), p(0.75, 0.0), p(1.0, 0.0)]);
        assert_eq!(jump, [[least, 0.5_f32.next_down()], [0.75_f32.next_up(), most]]);
        // Neither 0.1 nor 0.7 is a single-precision number.
        let [[a, b]] = parts(vec![p(0.0, 0.1), p(0.1, 0.0), p(0.7, 0.0), p(0.8, 0.1)])[..] else { panic!() };
        assert!(f64::from(a) >= 0.1 && f64::from(a) < 0.1 + 1e-7 && f64::from(b) <= 0.7 && f64::from(b) > 0.7 - 1e-6);
    }

    #[test]
    fn another_function_is_held_to_what_one_shows() {
        let p = |at, opacity| ControlPoint { at, color: [at, 1.0 - at, 0.5], opacity };
        let tf = |points: Vec<ControlPoint>| {
            TransferFunction::new(ScalarRange::new(0.0, 1.0, Scale::Linear).unwrap(), None, points).unwrap()
        };
        let recorded = [
            tf(vec![p(0.1, 0.0), p(0.3, 0.5), p(0.5, 0.0), p(0.7, 0.0), p(0.7, 0.4), p(0.9, 0.4), p(0.9, 0.0)]),
            tf(vec![p(0.0, 0.5), p(0.0, 0.0), p(1.0, 0.0), p(1.0, 0.5)]),
            tf(vec![p(0.5, 0.0)]),
            tf(vec![p(0.5, 0.1)]),
            // Jumps at single-precision numbers.
            tf(vec![p(0.0, 0.0), p(0.5, 0.0), p(0.5, 0.8), p(0.75, 0.8), p(0.75, 0.0), p(1.0, 0.0)]),
        ];
        let wished = [
            recorded[4].clone(),
            tf(vec![p(0.0, 1.0)]),
            tf(vec![p(0.2, 0.0), p(0.2, 0.3), p(0.6, 1.0), p(0.8, 0.0), p(0.8, 0.9), p(1.0, 0.1)]),
        ];
        for (recorded, wished) in recorded.iter().flat_map(|r| wished.iter().map(move |w| (r, w))) {
            let held = wished.where_shown_by(recorded).unwrap();
            let corners = [0.0, 0.1, 0.2, 0.3, 0.5, 0.6, 0.7, 0.75, 0.8, 0.9, 1.0_f32];
            let beside = corners.iter().flat_map(|c| [c.next_down(), *c, c.next_up()]);
            for u in (-20..=120).map(|n| n as f32 * 0.01).chain(beside) {
                let (color, opacity) = held.at(u);
                if recorded.is_transparent(u, u) {
                    assert_eq!(opacity, 0.0, "{u}");
                } else {
                    let (wanted, of) = wished.at(u);
                    assert!((opacity - of).abs() < 1e-6, "{u}: {opacity} {of}");
                    assert!((0..3).all(|c| (color[c] - wanted[c]).abs() < 1e-6), "{u}");
                }
            }
        }
    }

    #[test]
    fn an_interval_is_transparent_only_if_all_of_it_is() {
        let p = |at, opacity| ControlPoint { at, color: [1.0; 3], opacity };
        let range = ScalarRange::new(0.0, 1.0, Scale::Linear).unwrap();
        let tf = TransferFunction::new(
            range,
            None,
            vec![p(0.25, 0.0), p(0.375, 0.0), p(0.5, 0.3), p(0.625, 0.0), p(0.75, 0.0)],
        )
        .unwrap();
        for (lo, hi, transparent) in [
            (0.0, 0.375, true),
            (0.0, 0.39, false),
            (0.3, 0.7, false),
            (0.625, 9.0, true),
            (-3.0, 0.1, true),
            (0.45, 0.46, false),
        ] {
            assert_eq!(tf.is_transparent(lo, hi), transparent, "{lo}..{hi}");
        }
    }

    #[test]
    fn extinction_keeps_its_digits_at_both_ends() {
        let range = ScalarRange::new(0.0, 1.0, Scale::Linear).unwrap();
        let tf = |opacity| {
            TransferFunction::new(range, Some(2.0), vec![ControlPoint { at: 0.0, color: [1.0; 3], opacity }]).unwrap()
        };
        // -ln(1 - x) / 2 by its series x/2 + x^2/4.
        assert!((tf(1e-7).classify(0.0, 2.0).extinction / (0.5e-7 + 0.25e-14) - 1.0).abs() < 1e-12);
        assert!((tf(1.0 - 1e-7).classify(0.0, 2.0).extinction - 0.5 * 1e7f64.ln()).abs() < 1e-8);
        assert_eq!(tf(1.0).classify(0.0, 2.0).extinction, f64::INFINITY);
        assert_eq!(tf(0.0).classify(0.0, 2.0), Classified::EMPTY);
    }

    #[test]
    fn unsorted_and_out_of_range_points_are_refused() {
        let range = ScalarRange::new(0.0, 1.0, Scale::Linear).unwrap();
        let p = |at, opacity| ControlPoint { at, color: [0.0; 3], opacity };
        for points in [vec![], vec![p(0.5, 0.0), p(0.2, 0.0)], vec![p(0.5, 1.5)], vec![p(f64::NAN, 0.5)]] {
            assert_eq!(TransferFunction::new(range, None, points).unwrap_err().thing, "transfer.points");
        }
        assert!(TransferFunction::new(range, Some(0.0), vec![p(0.0, 0.0)]).is_err());
    }

    #[test]
    fn the_identity_tells_transfer_functions_apart() {
        let mut points = ramp().points().to_vec();
        points[1].opacity = 0.25;
        let other = TransferFunction::new(*ramp().range(), None, points).unwrap();
        assert_ne!(ramp().id(), other.id());
        assert_eq!(ramp().id(), ramp().clone().id());
    }
}
