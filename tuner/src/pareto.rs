//! The front of what can be had: measurements that no other one beats in size, quality and time at once.

use crate::evaluator::Measurement;
use crate::tune::Trial;
use lamina_model::Quality;

/// True if `a` is nowhere worse than `b` in size, time and squared error, and somewhere better; on the pixels that both were
/// measured on.
fn beats(a: &Trial, b: &Trial) -> bool {
    let (a, b) = (&a.measured, &b.measured);
    let prices = |m: &Measurement| [m.cost.size_bytes as f64, m.cost.generation.as_secs_f64()];
    let (cheap, dear) = (prices(a), prices(b));
    if cheap.iter().zip(&dear).any(|(a, b)| a > b) {
        return false;
    }
    let both = a.quality.batches().min(b.quality.batches());
    let [error, other] = [a, b].map(|m| m.quality.first(both).mse());
    error <= other && (error < other || cheap != dear)
}

/// Indices of the rows that no other row beats, smallest first. Rows without quality are none of them.
pub fn front(rows: &[Trial]) -> Vec<usize> {
    let known = |row: &Trial| !row.measured.quality.mse().is_nan();
    let beaten = |row: &Trial| rows.iter().any(|other| known(other) && beats(other, row));
    let mut front: Vec<usize> = (0..rows.len()).filter(|&n| known(&rows[n]) && !beaten(&rows[n])).collect();
    front.sort_by_key(|&n| rows[n].measured.cost.size_bytes);
    front
}

/// What more of one thing buys.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exchange {
    /// The row that offers it.
    pub row: usize,
    /// Decibels more.
    pub gain_db: f64,
    /// Kilobytes more (less if negative).
    pub extra_kilobytes: f64,
    /// Milliseconds of generation more (less if negative).
    pub extra_ms: f64,
}

/// Decibels by which `b` is better than `a`, on the pixels that both were measured on.
fn gain_db(a: &Quality, b: &Quality) -> f64 {
    let both = a.batches().min(b.batches());
    b.first(both).psnr_db() - a.first(both).psnr_db()
}

/// What the front offers beyond row `chosen`, at least 0.1 dB better: the most decibels per kilobyte, and the most per
/// millisecond.
pub fn offers(rows: &[Trial], chosen: usize) -> (Option<Exchange>, Option<Exchange>) {
    let from = &rows[chosen].measured;
    let offer = |row: usize| {
        let to = &rows[row].measured;
        let ms = |m: &Measurement| 1e3 * m.cost.generation.as_secs_f64();
        Exchange {
            row,
            gain_db: gain_db(&from.quality, &to.quality),
            extra_kilobytes: (to.cost.size_bytes as f64 - from.cost.size_bytes as f64) / 1e3,
            extra_ms: ms(to) - ms(from),
        }
    };
    let better: Vec<Exchange> = front(rows).into_iter().map(offer).filter(|o| o.gain_db >= 0.1).collect();
    let most = |price: fn(&Exchange) -> f64| {
        let paid = better.iter().filter(|o| price(o) > 0.0);
        paid.max_by(|a, b| (a.gain_db / price(a)).total_cmp(&(b.gain_db / price(b)))).copied()
    };
    (most(|o| o.extra_kilobytes), most(|o| o.extra_ms))
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamina_model::Cost;
    use lamina_model::{GenerationParams, ViewError};
    use std::time::Duration;

    fn row(kilobytes: u64, ms: u64, db: f64) -> Trial {
        let cost = Cost { size_bytes: 1000 * kilobytes, generation: Duration::from_millis(ms), ..Cost::default() };
        let view = ViewError { angle_deg: 10.0, batch_mse: vec![10_f64.powf(-db / 10.0)], ssim: None };
        let measured = Measurement { cost, quality: Quality { views: vec![view] } };
        Trial { params: GenerationParams::vdi(64, 0.1).unwrap(), measured, cost: 0.0 }
    }

    #[test]
    fn the_front_holds_what_nothing_beats() {
        let rows = [
            row(100, 10, 30.0),
            row(100, 11, 30.0),
            row(90, 20, 30.0),
            row(200, 5, 31.0),
            row(300, 30, 30.9),
            row(5, 1, f64::NAN),
        ];
        assert_eq!(front(&rows), [2, 0, 3]);
    }

    #[test]
    fn offers_name_the_best_price() {
        let rows = [row(100, 10, 30.0), row(110, 30, 31.0), row(200, 12, 32.0), row(400, 60, 40.0)];
        let (size, time) = offers(&rows, 0);
        let (size, time) = (size.unwrap(), time.unwrap());
        assert_eq!((size.row, time.row), (1, 2));
        assert!(
            (size.gain_db - 1.0).abs() < 1e-9 && size.extra_kilobytes == 10.0 && (time.extra_ms - 2.0).abs() < 1e-9
        );
        assert_eq!(offers(&rows, 3), (None, None));
    }

    #[test]
    fn gains_are_of_the_same_pixels() {
        // The second batch is ten times as hard; who was not measured on it is not better for that.
        let mut rows = [row(100, 10, 30.0), row(110, 30, 31.0)];
        rows[0].measured.quality.views[0].batch_mse.push(1e-2);
        let gain = offers(&rows, 0).0.unwrap().gain_db;
        assert!((gain - 1.0).abs() < 1e-9, "{gain}");
    }
}
