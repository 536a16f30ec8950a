//! Across knobs: what reaches a stated quality at the least price.

use super::curve::Point;

/// Of the points that reach `psnr_db`, the one of the least `cost`.
pub(super) fn cheapest(points: &[Point], psnr_db: f64, cost: impl Fn(&Point) -> Option<f64>) -> Option<&Point> {
    let reaching = points.iter().filter(|p| p.decibels() >= psnr_db).filter_map(|p| Some((cost(p)?, p)));
    reaching.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, p)| p)
}

/// The best there is.
pub(super) fn best(points: &[Point]) -> Option<&Point> {
    points.iter().filter(|p| !p.error.rms.is_nan()).min_by(|a, b| a.error.rms.total_cmp(&b.error.rms))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accuracy::error::Error;

    #[test]
    fn the_cheapest_reaches_what_was_asked_for() {
        let point = |rms, ms| Point::new(0.0, Error { rms, max: rms }, ms);
        let points = [point(1e-1, 1.0), point(1e-2, 5.0), point(1e-3, 3.0), point(1e-4, 9.0)];
        assert_eq!(cheapest(&points, 35.0, |p| Some(p.time_ms)).unwrap().time_ms, 3.0);
        assert!(cheapest(&points, 90.0, |p| Some(p.time_ms)).is_none());
        assert!(cheapest(&points, 10.0, Point::kilobytes).is_none());
        assert_eq!(best(&points).unwrap().time_ms, 9.0);
    }
}
