//! Which gammas are worth trying on this data: the paper's fixed range missed those that mattered on one of its sets.

use super::Grid;
use crate::trial::{Trial, TrialError};
use lamina_model::{GenerationParams, Invalid, ReducedVolume, Representation};

/// Gammas looked at, evenly on a logarithmic scale. Greedily, all samples join above 1.
const WIDEST: (f64, f64) = (1e-4, 2.0);
const LOOKED_AT: usize = 24;
/// Gammas found.
const FOUND: usize = 40;
/// A size this near to that at an end of the scale counts as equal.
const EQUAL: f64 = 1.02;

fn logarithmic((low, high): (f64, f64), n: usize) -> Vec<f64> {
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

/// Resolutions of volumes: from all sample points down to a quarter of those on a side, three to a factor of two.
const VOLUME_RESOLUTIONS: i32 = 7;
/// The most points on a side of a volume: more take longer to code, to decode and to draw than one would wait for.
const MOST_POINTS: u32 = 512;
/// Error bounds of volumes: finer ones are not seen, coarser ones leave nothing.
const BOUNDS: (f64, f64) = (1e-3, 0.3);
const VOLUME_BOUNDS: usize = 28;

/// What may be tried on this step: volumes first, because they take less time to measure; what cannot beat them is soon
/// known.
///
/// # Errors
/// If a node stops answering, the grid is none, or only volumes may be tried and none can stand for the step.
pub async fn candidates(
    trial: &mut impl Trial,
    representations: &[Representation],
    grid: &Grid,
    base: &GenerationParams,
) -> Result<Vec<GenerationParams>, TrialError> {
    let mut all = Vec::new();
    let volumes_can = trial.longest_side() > 0;
    if representations.contains(&Representation::Volume) && volumes_can {
        all.extend(volumes(trial.longest_side(), base)?);
    }
    if !volumes_can && !representations.contains(&Representation::Vdi) {
        let reason = format!("{}; allow VDIs", ReducedVolume::WHY_NONE);
        return Err(Invalid::new("representations", reason).into());
    }
    if representations.contains(&Representation::Vdi) {
        all.extend(vdis(trial, grid, base).await?);
    }
    Ok(all)
}

/// Reduced volumes of a grid with so many points on its longest side.
fn volumes(longest_side: u32, base: &GenerationParams) -> Result<Vec<GenerationParams>, Invalid> {
    let most = f64::from(longest_side.clamp(2, MOST_POINTS));
    let mut resolutions: Vec<u32> =
        (0..VOLUME_RESOLUTIONS).map(|k| (most * 0.5_f64.powf(f64::from(k) / 3.0)).round().max(2.0) as u32).collect();
    resolutions.dedup();
    let base = base.with_representation(Representation::Volume);
    let mut all = Vec::new();
    for r in resolutions {
        for bound in logarithmic(BOUNDS, VOLUME_BOUNDS) {
            all.push(base.with_resolution(r)?.with_gamma(bound)?);
        }
    }
    Ok(all)
}

/// The VDIs of `grid`: where it states no gammas, those between which sizes change, found with one march at the lowest
/// resolution.
async fn vdis(
    trial: &mut impl Trial,
    grid: &Grid,
    base: &GenerationParams,
) -> Result<Vec<GenerationParams>, TrialError> {
    if grid.gamma.is_some() {
        return Ok(grid.candidates(base)?);
    }
    let lowest = grid.with_gammas(base, &[0.0])?;
    let Some(first) = lowest.first() else { return Ok(Vec::new()) };
    let wide = logarithmic(WIDEST, LOOKED_AT);
    let sizes: Vec<u64> = trial.sizes(first, &wide).await?.iter().map(|c| c.size_bytes).collect();
    Ok(grid.with_gammas(base, &logarithmic(changing(&wide, &sizes), FOUND))?)
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
