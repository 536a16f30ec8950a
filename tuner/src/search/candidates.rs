//! What may be tried on a step: reduced volumes and VDIs, whose range of gammas is found only once a search gets to them.

use super::SearchGrid;
use super::gamma_range::{GAMMAS, GammaRange, WIDEST, logarithmic};
use crate::evaluator::{Evaluator, TrialError};
use lamina_model::{Cost, GenerationParams, Invalid, ReducedVolume, Representation};
use std::time::Duration;

/// Resolutions of volumes: from all sample points down to a quarter of those on a side, three to a factor of two.
const VOLUME_RESOLUTIONS: i32 = 7;
/// The most points on a side of a volume: more take longer to code, to decode and to draw than one would wait for.
const MOST_POINTS: u32 = 512;
/// Error bounds of volumes: finer ones are not seen, coarser ones leave nothing.
const BOUNDS: (f64, f64) = (1e-3, 0.3);
const VOLUME_BOUNDS: usize = 28;

/// A range that took so large a share of the time there is to find is not found anew.
const SHORT: u32 = 4;

/// Parameters to choose from, by representation.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CandidateSet {
    groups: Vec<Group>,
    /// The range of gammas that an earlier step had.
    earlier: Option<GammaRange>,
}

/// Candidates of one representation.
#[derive(Debug, Clone, PartialEq)]
enum Group {
    /// All of them.
    Listed(Vec<GenerationParams>),
    /// The VDIs of a grid that states no gammas. `lowest` has its lowest resolution.
    Vdis { grid: SearchGrid, lowest: GenerationParams },
}

/// The candidates of one representation as a search takes them.
pub(super) struct Resolved {
    /// All of them.
    pub candidates: Vec<GenerationParams>,
    /// What finding them has measured.
    pub known: Vec<(GenerationParams, Cost)>,
    /// Their range was not found on this step, for lack of time.
    pub stale: bool,
}

impl CandidateSet {
    /// What may be tried on a step that reduced volumes with so many points on the longest side can stand for (0: none can):
    /// volumes first, because they take less time to measure; what cannot beat them is soon known.
    ///
    /// # Errors
    /// If the grid is none, or only volumes may be tried and none can stand for the step.
    pub fn new(
        longest_side: u32,
        representations: &[Representation],
        grid: &SearchGrid,
        base: &GenerationParams,
    ) -> Result<Self, Invalid> {
        let mut groups = Vec::new();
        if representations.contains(&Representation::Volume) && longest_side > 0 {
            groups.push(Group::Listed(volumes(longest_side, base)?));
        }
        if longest_side == 0 && !representations.contains(&Representation::Vdi) {
            return Err(Invalid::new("representations", format!("{}; allow VDIs", ReducedVolume::WHY_NONE)));
        }
        if representations.contains(&Representation::Vdi) {
            if grid.gamma.is_some() {
                groups.push(Group::Listed(grid.candidates(base)?));
            } else if let Some(&lowest) = grid.with_gammas(base, &[0.0])?.first() {
                groups.push(Group::Vdis { grid: *grid, lowest });
            }
        }
        groups.retain(|group| !matches!(group, Group::Listed(all) if all.is_empty()));
        Ok(Self { groups, earlier: None })
    }

    /// Takes over the range of gammas that was found on an earlier step, for where finding it again would take too long.
    #[must_use]
    pub fn with_range_of(mut self, earlier: &Self) -> Self {
        self.earlier.clone_from(&earlier.earlier);
        self
    }

    /// The representations, in the order they are searched.
    pub(super) fn representations(&self) -> Vec<Representation> {
        let of = |group: &Group| match group {
            Group::Listed(all) => all[0].representation(),
            Group::Vdis { .. } => Representation::Vdi,
        };
        self.groups.iter().map(of).collect()
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        let of = |group: &Group| match group {
            Group::Listed(all) => all.len(),
            Group::Vdis { grid, lowest } => grid.with_gammas(lowest, &[0.0]).map_or(0, |all| all.len() * GAMMAS),
        };
        self.groups.iter().map(of).sum()
    }

    /// True if `params` differ from some candidates in resolution and gamma alone and lie between them.
    pub fn spans(&self, params: &GenerationParams) -> bool {
        let like = |c: &GenerationParams| {
            c.with_resolution(params.resolution())
                .and_then(|c| c.with_gamma(params.gamma()))
                .is_ok_and(|c| c == *params)
        };
        let between = |all: &[GenerationParams]| {
            let spanned = |of: fn(&GenerationParams) -> f64| {
                let values = || all.iter().filter(|c| like(c)).map(of);
                values().any(|v| v <= of(params)) && values().any(|v| v >= of(params))
            };
            spanned(|p| p.resolution().into()) && spanned(GenerationParams::gamma)
        };
        self.groups.iter().any(|group| match group {
            Group::Listed(all) => between(all),
            Group::Vdis { grid, lowest } => {
                grid.with_gammas(lowest, &[WIDEST.0, WIDEST.1]).is_ok_and(|all| between(&all))
            }
        })
    }

    /// The candidates of group `n`, with at most `left` time for all of the search: the range of gammas is found with one march
    /// at the lowest resolution unless they are listed or that would take too long.
    ///
    /// # Errors
    /// If a node stops answering.
    pub(super) async fn resolve(
        &mut self,
        n: usize,
        trial: &mut impl Evaluator,
        left: Option<Duration>,
    ) -> Result<Resolved, TrialError> {
        let (grid, lowest) = match &self.groups[n] {
            Group::Listed(all) => return Ok(Resolved { candidates: all.clone(), known: Vec::new(), stale: false }),
            Group::Vdis { grid, lowest } => (grid, lowest),
        };
        let gammas = |ends| logarithmic(ends, GAMMAS);
        if let Some(earlier) = self.earlier.as_ref().filter(|e| left.is_some_and(|left| left < SHORT * e.took)) {
            let candidates = grid.with_gammas(lowest, &gammas(earlier.ends))?;
            return Ok(Resolved { candidates, known: Vec::new(), stale: true });
        }
        let (range, known) = GammaRange::find(trial, lowest).await?;
        let candidates = grid.with_gammas(lowest, &gammas(range.ends))?;
        self.earlier = Some(range);
        Ok(Resolved { candidates, known, stale: false })
    }

    /// All of them, ranges of gammas found on the step of `trial`.
    ///
    /// # Errors
    /// If a node stops answering.
    pub async fn all(&mut self, trial: &mut impl Evaluator) -> Result<Vec<GenerationParams>, TrialError> {
        let mut all = Vec::new();
        for n in 0..self.groups.len() {
            all.extend(self.resolve(n, trial, None).await?.candidates);
        }
        Ok(all)
    }
}

/// Listed ones; those of one representation stand together.
impl From<Vec<GenerationParams>> for CandidateSet {
    fn from(all: Vec<GenerationParams>) -> Self {
        let groups = all.chunk_by(|a, b| a.representation() == b.representation());
        Self { groups: groups.map(|some| Group::Listed(some.to_vec())).collect(), earlier: None }
    }
}

/// Reduced volumes of a grid with so many points on its longest side.
fn volumes(longest_side: u32, base: &GenerationParams) -> Result<Vec<GenerationParams>, Invalid> {
    let most = f64::from(longest_side.clamp(2, MOST_POINTS));
    let mut resolutions: Vec<u32> =
        (0..VOLUME_RESOLUTIONS).map(|k| (most * 0.5_f64.powf(f64::from(k) / 3.0)).round().max(2.0) as u32).collect();
    resolutions.dedup();
    let base = GenerationParams::volume(base.resolution(), base.gamma())?;
    let mut all = Vec::new();
    for r in resolutions {
        for bound in logarithmic(BOUNDS, VOLUME_BOUNDS) {
            all.push(base.with_resolution(r)?.with_gamma(bound)?);
        }
    }
    Ok(all)
}
