//! The range of gammas worth trying on some data: the paper's fixed range missed those that mattered on one of its sets.

use crate::evaluator::{Evaluator, TrialError};
use lamina_model::{Cost, GenerationParams};
use std::time::Duration;
use tokio::time::Instant;

/// Gammas looked at, evenly on a logarithmic scale. Greedily, all samples join above 1.
pub(super) const WIDEST: (f64, f64) = (1e-4, 2.0);
const LOOKED_AT: usize = 24;
/// Gammas of a range.
pub(super) const GAMMAS: usize = 40;
/// A size this near to that at an end of the scale counts as equal.
const EQUAL: f64 = 1.02;

/// A range of gammas, with what finding it measured and took.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct GammaRange {
    /// The least and the greatest gamma worth trying.
    pub ends: (f64, f64),
    /// Wall time of finding it.
    pub took: Duration,
}

impl GammaRange {
    /// Finds it with one march at the resolution of `params`. The second value is what that gave, gamma by gamma.
    ///
    /// # Errors
    /// Those of [`Trial::sizes`].
    pub(super) async fn find(
        trial: &mut impl Evaluator,
        params: &GenerationParams,
    ) -> Result<(Self, Vec<(GenerationParams, Cost)>), TrialError> {
        let begun = Instant::now();
        let wide = logarithmic(WIDEST, LOOKED_AT);
        let costs = trial.sizes(params, &wide).await?;
        let sizes: Vec<u64> = costs.iter().map(|c| c.size_bytes).collect();
        let ends = changing(&wide, &sizes);
        let mut known = Vec::with_capacity(costs.len());
        for (gamma, cost) in wide.into_iter().zip(costs).filter(|(gamma, _)| (ends.0..=ends.1).contains(gamma)) {
            known.push((params.with_gamma(gamma)?, cost));
        }
        Ok((Self { ends, took: begun.elapsed() }, known))
    }
}

/// `n` gammas from the low to the high end, evenly on a logarithmic scale.
pub(super) fn logarithmic((low, high): (f64, f64), n: usize) -> Vec<f64> {
    let ratio = (high / low).powf(1.0 / (n - 1) as f64);
    // Three digits are enough for a person to write them down again.
    let rounded = |value: f64| format!("{value:.2e}").parse().unwrap_or(value);
    (0..n).map(|k| rounded(low * ratio.powi(k as i32))).collect()
}

/// The range in which sizes change with gamma, of sizes by rising gamma.
fn changing(gammas: &[f64], sizes: &[u64]) -> (f64, f64) {
    let (Some(&largest), Some(&smallest)) = (sizes.first(), sizes.last()) else { return WIDEST };
    let low = sizes.iter().rposition(|&s| s as f64 * EQUAL >= largest as f64).unwrap_or(0);
    let high = sizes.iter().position(|&s| s as f64 <= smallest as f64 * EQUAL).unwrap_or(sizes.len() - 1);
    if low < high { (gammas[low], gammas[high]) } else { WIDEST }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_range_is_where_sizes_change() {
        let gammas = [0.001, 0.01, 0.1, 0.5, 1.0, 2.0];
        assert_eq!(changing(&gammas, &[1000, 995, 600, 300, 201, 200]), (0.01, 1.0));
        assert_eq!(changing(&gammas, &[1000, 900, 600, 300, 250, 200]), (0.001, 2.0));
        assert_eq!(changing(&gammas, &[500; 6]), WIDEST, "nothing changes: an empty or constant field");
    }

    #[test]
    fn logarithmic_gammas_reach_from_end_to_end() {
        let found = logarithmic((0.002, 0.5), 9);
        assert_eq!((found[0], found[8], found.len()), (0.002, 0.5, 9));
        assert!(found.windows(2).all(|w| (w[1] / w[0] - found[1] / found[0]).abs() < 0.02));
    }
}
