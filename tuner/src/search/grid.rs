//! Resolutions and gammas to choose from.

use lamina_model::{GenerationParams, Invalid, VdiParams};
use serde::{Deserialize, Serialize};
use std::str::FromStr;

/// Evenly spaced values from `from` to at most `to`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GridAxis {
    /// First value.
    pub from: f64,
    /// Upper end.
    pub to: f64,
    /// Distance of neighbors.
    pub step: f64,
}

impl GridAxis {
    /// The values; a last one within a thousandth of a step of `to` counts.
    fn values(&self, name: &'static str) -> Result<Vec<f64>, Invalid> {
        let Self { from, to, step } = *self;
        if !(from.is_finite() && to.is_finite() && from <= to && step.is_finite() && step > 0.0) {
            return Err(Invalid::new(name, format!("from {from} to {to} step {step}: needs from <= to and step > 0")));
        }
        let n = ((to - from) / step + 1e-3).floor() + 1.0;
        if n > 10_000.0 {
            return Err(Invalid::new(
                name,
                format!("from {from} to {to} step {step} are {n:.0} values; at most 10000"),
            ));
        }
        Ok((0..n as u32).map(|k| from + f64::from(k) * step).collect())
    }
}

/// A grid of resolutions and gammas.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SearchGrid {
    /// Rays per side.
    pub resolution: GridAxis,
    /// Interrupt parameter; without it, a range found from the data.
    pub gamma: Option<GridAxis>,
}

impl Default for SearchGrid {
    /// 22 resolutions; gammas as the data wants them.
    fn default() -> Self {
        Self { resolution: GridAxis { from: 96.0, to: 768.0, step: 32.0 }, gamma: None }
    }
}

impl FromStr for GridAxis {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Option<Vec<f64>> = text.split(':').map(|n| n.trim().parse().ok()).collect();
        match numbers.as_deref() {
            Some(&[from, to, step]) => Ok(Self { from, to, step }),
            _ => Err(format!("\"{text}\" is not FROM:TO:STEP")),
        }
    }
}

impl FromStr for SearchGrid {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => return Ok(Self::default()),
            "coarse" => return Ok(Self::coarse()),
            "paper" => return Ok(Self::paper()),
            _ => {}
        }
        let help = "write auto, coarse, paper, or resolutions and gammas such as 160:768:64,0.001:0.26:0.008";
        let (resolution, gamma) = text.split_once(',').ok_or_else(|| format!("\"{text}\" is no grid; {help}"))?;
        let axis = |text: &str| text.parse::<GridAxis>().map_err(|e| format!("{e}; {help}"));
        let grid = Self { resolution: axis(resolution)?, gamma: Some(axis(gamma)?) };
        // Whatever is wrong with it is wrong for every base.
        let base = GenerationParams::vdi(1, 0.0).map_err(|e| e.to_string())?;
        grid.candidates(&base).map_err(|e| e.to_string())?;
        Ok(grid)
    }
}

impl SearchGrid {
    /// Coarse enough for a quick look: 3 resolutions by 6 gammas.
    pub fn coarse() -> Self {
        Self {
            resolution: GridAxis { from: 128.0, to: 384.0, step: 128.0 },
            gamma: Some(GridAxis { from: 0.005, to: 0.08, step: 0.015 }),
        }
    }

    /// The paper's grid: 20 resolutions by 65 gammas.
    pub fn paper() -> Self {
        Self {
            resolution: GridAxis { from: 160.0, to: 768.0, step: 32.0 },
            gamma: Some(GridAxis { from: 0.001, to: 0.26, step: 0.004 }),
        }
    }

    /// All parameters of the grid; opacity cut-off and step are those of `base`.
    ///
    /// # Errors
    /// If an axis is not a range or holds values that cannot be used, or no gammas are stated.
    pub fn candidates(&self, base: &GenerationParams) -> Result<Vec<GenerationParams>, Invalid> {
        let stated = self.gamma.ok_or_else(|| Invalid::new("grid.gamma", "none stated; give from, to and step"))?;
        // Rounded to what a person would write, so that 0.001 + 3 x 0.004 is 0.013.
        let gammas: Vec<f64> = stated.values("grid.gamma")?.iter().map(|g| (g * 1e9).round() / 1e9).collect();
        self.with_gammas(base, &gammas)
    }

    /// The grid's resolutions with these gammas.
    ///
    /// # Errors
    /// As [`Self::candidates`].
    pub fn with_gammas(&self, base: &GenerationParams, gammas: &[f64]) -> Result<Vec<GenerationParams>, Invalid> {
        let mut all = Vec::new();
        for r in self.resolution.values("grid.resolution")? {
            if r.fract() != 0.0 || !(1.0..=f64::from(VdiParams::MAX_RESOLUTION)).contains(&r) {
                return Err(Invalid::new(
                    "grid.resolution",
                    format!("{r} is not a whole number of rays from 1 to 8192"),
                ));
            }
            for &gamma in gammas {
                all.push(base.with_resolution(r as u32)?.with_gamma(gamma)?);
            }
        }
        Ok(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_grid_has_its_1300_parameters() {
        let base = GenerationParams::vdi(1, 0.0).unwrap();
        let all = SearchGrid::paper().candidates(&base).unwrap();
        assert_eq!(all.len(), 1300);
        assert_eq!((all[0].resolution(), all[0].gamma()), (160, 0.001));
        assert_eq!((all[3].resolution(), all[3].gamma()), (160, 0.013));
        assert_eq!((all[1299].resolution(), all[1299].gamma()), (768, 0.257));
        assert_eq!(SearchGrid::coarse().candidates(&base).unwrap().len(), 18);
        assert!(SearchGrid::default().candidates(&base).is_err(), "gammas are not stated");
        assert_eq!(SearchGrid::default().with_gammas(&base, &[0.1, 0.2]).unwrap().len(), 44);
    }

    #[test]
    fn grids_are_read_from_the_command_line() {
        let base = GenerationParams::vdi(1, 0.0).unwrap();
        let grid: SearchGrid = "160:768:64,0.001:0.26:0.008".parse().unwrap();
        assert_eq!(grid.candidates(&base).unwrap().len(), 10 * 33);
        assert_eq!("paper".parse(), Ok(SearchGrid::paper()));
        for bad in ["fine", "1:2,3:4:5", "1:2:1,x:1:1", "9:1:1,0:1:1", "1:2:1,-1:0:1"] {
            assert!(bad.parse::<SearchGrid>().is_err(), "{bad}");
        }
    }

    #[test]
    fn axes_that_are_no_ranges_are_refused_by_name() {
        let base = GenerationParams::vdi(1, 0.0).unwrap();
        let axis = |from, to, step| GridAxis { from, to, step };
        let resolution = |a| SearchGrid { resolution: a, ..SearchGrid::coarse() }.candidates(&base).unwrap_err().thing;
        for bad in
            [axis(0.0, 9.0, 1.0), axis(9.0, 1.0, 1.0), axis(1.0, 9.0, 0.0), axis(1.0, 9.0, 1e-9), axis(1.5, 9.0, 1.0)]
        {
            assert_eq!(resolution(bad), "grid.resolution");
        }
        assert!(SearchGrid { gamma: Some(axis(-0.1, 0.1, 0.1)), ..SearchGrid::default() }.candidates(&base).is_err());
    }
}
