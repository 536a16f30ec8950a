//! How quality, size and time follow the parameters: what the paper says of its data, counted on a measured grid.

use super::choices::{StudyLimits, best};
use lamina_report::numbers::{fixed, significant};
use lamina_tuner::tune::Trial;

/// What one quantity does along one parameter, over all pairs of neighbors on the grid.
#[derive(Debug, PartialEq)]
struct Trend {
    pairs: usize,
    /// Those that go the way they should, or stay.
    agree: usize,
    /// By how much the others go the other way, at most.
    against: f64,
}

impl Trend {
    /// Of `value`, which should rise (or fall: `sign` -1) with `along` among rows of the same `group`.
    fn of(
        rows: &[Trial],
        group: impl Fn(&Trial) -> f64,
        along: impl Fn(&Trial) -> f64 + Copy,
        value: impl Fn(&Trial) -> f64,
        sign: f64,
    ) -> Self {
        let mut points: Vec<[f64; 3]> = rows.iter().map(|r| [group(r), along(r), value(r)]).collect();
        points.retain(|p| !p[2].is_nan());
        points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        let mut places: Vec<f64> = rows.iter().map(along).collect();
        places.sort_by(f64::total_cmp);
        places.dedup();
        let place = |p: &[f64; 3]| places.partition_point(|x| *x < p[1]);
        // Where one is missing that others have, those beside it are no neighbors.
        let neighbors = |w: &&[[f64; 3]]| w[0][0] == w[1][0] && place(&w[0]) + 1 == place(&w[1]);
        let mut trend = Self { pairs: 0, agree: 0, against: 0.0 };
        for pair in points.windows(2).filter(neighbors) {
            let [from, to] = [sign * pair[0][2], sign * pair[1][2]];
            trend.pairs += 1;
            trend.agree += usize::from(to >= from);
            if to < from {
                trend.against = trend.against.max(from - to);
            }
        }
        trend
    }

    /// "1279 of 1280", and how far the others are off.
    fn words(&self, off: impl Fn(f64) -> String) -> String {
        let count = format!("{} of {}", self.agree, self.pairs);
        if self.agree < self.pairs { format!("{count}, else by at most {}", off(self.against)) } else { count }
    }
}

/// The heads of [`row`].
pub(super) const HEAD: [&str; 6] = [
    "q falls or stays as gamma grows",
    "size falls or stays as gamma grows",
    "size grows or stays with r",
    "q grows or stays with r",
    "median ms by r",
    "best gamma under size limits",
];

/// What `rows` say, in the order of [`HEAD`].
pub(super) fn row(rows: &[Trial], limits: &StudyLimits) -> [String; 6] {
    let r = |row: &Trial| f64::from(row.params.resolution());
    let gamma = |row: &Trial| row.params.gamma();
    let q = |row: &Trial| row.measured.quality.psnr_db();
    let size = |row: &Trial| (row.measured.cost.size_bytes as f64).ln();
    let db = |off: f64| format!("{} dB", fixed(off, 2));
    let percent = |share: f64| format!("{} %", fixed(100.0 * share, 1));
    let (growth, loss) = (|off: f64| percent(off.exp_m1()), |off: f64| percent(-(-off).exp_m1()));
    let resolutions = || rows.iter().map(|r| r.params.resolution());
    let ends = resolutions().min().zip(resolutions().max());
    let median = |resolution: u32| {
        let some = rows.iter().filter(|r| r.params.resolution() == resolution);
        let mut ms: Vec<f64> = some.map(|r| 1e3 * r.measured.cost.generation.as_secs_f64()).collect();
        ms.sort_by(f64::total_cmp);
        format!("{} at {resolution}", fixed((ms[ms.len() / 2] + ms[(ms.len() - 1) / 2]) / 2.0, 0))
    };
    let gammas = || limits.size.iter().filter_map(|c| best(rows, c)).map(|n| rows[n].params.gamma());
    let (least, most) = (gammas().fold(f64::INFINITY, f64::min), gammas().fold(f64::NEG_INFINITY, f64::max));
    [
        Trend::of(rows, r, gamma, q, -1.0).words(db),
        Trend::of(rows, r, gamma, size, -1.0).words(growth),
        Trend::of(rows, gamma, r, size, 1.0).words(loss),
        Trend::of(rows, gamma, r, q, 1.0).words(db),
        ends.map_or_else(String::new, |(low, high)| format!("{}, {}", median(low), median(high))),
        if least <= most { format!("{} to {}", significant(least, 4), significant(most, 4)) } else { "none".into() },
    ]
}

/// Under how many limits on size the best SSIM is that of other parameters than the best PSNR, and what choosing by it changes.
/// `None` where SSIM was not measured.
pub(super) fn choices_by_ssim(rows: &[Trial], limits: &StudyLimits) -> Option<String> {
    let (mut limited, mut same, mut gained, mut lost) = (0, 0, 0.0_f64, 0.0_f64);
    let ssim = |n: usize| rows[n].measured.quality.ssim();
    for contract in &limits.size {
        let Some(by_psnr) = best(rows, contract) else { continue };
        let kept = (0..rows.len()).filter(|&n| contract.cost(&rows[n].measured) < f64::INFINITY);
        let measured = kept.filter_map(|n| Some((n, ssim(n)?)));
        let (by_ssim, most) = measured.max_by(|a, b| a.1.total_cmp(&b.1))?;
        limited += 1;
        if rows[by_ssim].params == rows[by_psnr].params {
            same += 1;
        } else {
            let db = |n: usize| rows[n].measured.quality.psnr_db();
            gained = gained.max(most - ssim(by_psnr)?);
            lost = lost.max(db(by_psnr) - db(by_ssim));
        }
    }
    let other = format!("; else at most {gained:.4} more of it for {} dB less", fixed(lost, 2));
    (limited > 0)
        .then(|| format!("the best by PSNR in {same} of {limited}{}", if same < limited { &other } else { "" }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamina_model::Cost;
    use lamina_model::{GenerationParams, Quality, ViewError};
    use lamina_tuner::Contract;
    use lamina_tuner::evaluator::Measurement;
    use std::time::Duration;

    #[test]
    fn neighbors_are_counted_along_each_parameter() {
        // (r, gamma, bytes, ms, dB), in no order.
        let measured = [
            (20, 0.1, 200, 5, 31.0),
            (10, 0.1, 100, 1, 30.0),
            (10, 0.2, 90, 2, 29.0),
            (10, 0.3, 99, 3, 29.5),
            (20, 0.2, 180, 6, 31.0),
            (20, 0.3, 170, 7, f64::INFINITY),
            (30, 0.1, 150, 9, 31.0),
            (30, 0.3, 170, 8, f64::INFINITY),
        ];
        let row_of = |&(r, gamma, size_bytes, ms, db): &(u32, f64, u64, u64, f64)| {
            let batch_mse = vec![10_f64.powf(-db / 10.0)];
            let quality = Quality { views: vec![ViewError { angle_deg: 10.0, batch_mse, ssim: None }] };
            let cost = Cost { size_bytes, generation: Duration::from_millis(ms), ..Cost::default() };
            let params = GenerationParams::vdi(r, gamma).unwrap();
            Trial { params, measured: Measurement { cost, quality }, cost: 0.0 }
        };
        let rows: Vec<Trial> = measured.iter().map(row_of).collect();
        let limits = StudyLimits { size: [50, 95, 160].map(Contract::size).into(), time: Vec::new() };
        // Gamma 0.2 is missing at r = 30: its neighbors are none of each other's.
        let expected = [
            "2 of 4, else by at most \u{221e} dB",
            "3 of 4, else by at most 10.0 %",
            "4 of 5, else by at most 25.0 %",
            "5 of 5",
            "2 at 10, 8 at 30",
            "0.1 to 0.2",
        ];
        assert_eq!(row(&rows, &limits), expected);
    }
}
