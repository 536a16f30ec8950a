//! Piecewise-linear maps over 0..1, given by their corners.

use crate::Invalid;

/// A position and the `N` values there.
pub(crate) trait Corner<const N: usize>: std::fmt::Debug {
    /// Where, 0..1.
    fn at(&self) -> f64;
    /// What, each 0..1.
    fn values(&self) -> [f64; N];
}

/// Passes one to `most` corners, all numbers in 0..1, by ascending position, `apart` or more from each other.
pub(crate) fn check<const N: usize>(
    thing: &'static str,
    corners: &[impl Corner<N>],
    (most, apart): (usize, f64),
) -> Result<(), Invalid> {
    let (n, refused) = (corners.len(), |reason: String| Err(Invalid { thing, reason }));
    if n == 0 || n > most {
        return refused(format!("{n} given; one to {most} are needed"));
    }
    if let Some(c) = corners.iter().find(|c| !c.values().iter().chain([&c.at()]).all(|x| (0.0..=1.0).contains(x))) {
        return refused(format!("{c:?}: every number must lie in 0..1"));
    }
    let mut pairs = corners.windows(2).map(|w| (w[0].at(), w[1].at()));
    let Some((a, b)) = pairs.find(|(a, b)| b - a < 0.999 * apart) else { return Ok(()) };
    let reason = format!("{b} follows {a}; list them by ascending `at`");
    refused(if apart > 0.0 { format!("{reason}, {apart} or more apart") } else { format!("not sorted: {reason}") })
}

/// The values at position `u` of corners that have been checked: linear between them, constant beyond the ends, and of two
/// at one position the later's. The first `before` corners are known to be at or before `u`.
#[inline]
pub(crate) fn interpolate<const N: usize>(corners: &[impl Corner<N>], before: usize, u: f64) -> [f64; N] {
    let mut next = before;
    while corners.get(next).is_some_and(|c| c.at() <= u) {
        next += 1;
    }
    let (Some(a), Some(b)) = (next.checked_sub(1).map(|i| &corners[i]), corners.get(next)) else {
        return corners[next.saturating_sub(1)].values();
    };
    let w = (u - a.at()) / (b.at() - a.at());
    let (a, b) = (a.values(), b.values());
    std::array::from_fn(|i| a[i] + w * (b[i] - a[i]))
}
