//! What is turned, and how far.

use super::curve::{ErrorSource, Parameter};
use lamina_model::{GenerationParams, Invalid, Scene, VdiParams};

/// Sampling steps in voxels.
const STEPS: [f64; 6] = [4.0, 2.0, 1.0, 0.5, 0.25, 0.125];
/// Opacities at which rays end; 1 never.
const CUTOFFS: [f64; 9] = [0.9, 0.95, 0.98, 0.99, 0.995, 0.998, 0.999, 0.9999, 1.0];
/// Interrupt parameters.
const GAMMAS: [f64; 8] = [0.16, 0.08, 0.04, 0.02, 0.01, 0.005, 0.0025, 0.00125];
/// Rays per side, over those of the base.
const RESOLUTIONS: [f64; 8] = [0.25, 0.375, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0];
/// Bits of each channel; the codec stores 8.
pub(super) const COLOR_BITS: [u32; 8] = [3, 4, 5, 6, 7, 8, 10, 12];
/// The fewest bits of depth.
pub(super) const FEWEST_DEPTH_BITS: u32 = 3;
/// Distances of sample points, voxels.
pub(super) const SPACINGS: [usize; 4] = [8, 4, 2, 1];

fn itself(value: f64) -> f64 {
    value
}
fn one_less(value: f64) -> f64 {
    1.0 - value
}
fn inverse(value: f64) -> f64 {
    1.0 / value
}
/// At a distance of one voxel the field is whole: no distance to converge with.
fn thinned(spacing: f64) -> f64 {
    if spacing > 1.0 { spacing } else { 0.0 }
}
fn halved_each(bits: f64) -> f64 {
    (-bits).exp2()
}

const fn knob(key: &'static str, title: &'static str, unit: &'static str, source: ErrorSource) -> Parameter {
    Parameter { key, title, unit, source, coarseness: itself, plotted: itself, priced: true }
}

pub(super) const RAYCAST_STEP: Parameter = knob("raycast_step", "Sampling step", "voxels", ErrorSource::Raycast);
pub(super) const STEP: Parameter = knob("step", "Sampling step", "voxels", ErrorSource::Vdi);
/// The same of the kernels that integrate the transfer function over each step.
pub(super) const RAYCAST_INTEGRATED: Parameter =
    knob("raycast_step_integrated", "Sampling step, pre-integrated", "voxels", ErrorSource::Raycast);
pub(super) const STEP_INTEGRATED: Parameter =
    knob("step_integrated", "Sampling step, pre-integrated", "voxels", ErrorSource::Vdi);
pub(super) const CUTOFF: Parameter = Parameter {
    coarseness: one_less,
    plotted: one_less,
    ..knob("opacity_cutoff", "Opacity cut-off", "1 - opacity", ErrorSource::Vdi)
};
pub(super) const GAMMA: Parameter = knob("gamma", "Gamma", "", ErrorSource::Vdi);
pub(super) const RESOLUTION: Parameter =
    Parameter { coarseness: inverse, ..knob("resolution", "Resolution r", "rays a side", ErrorSource::Vdi) };
pub(super) const COLOR: Parameter = Parameter {
    coarseness: halved_each,
    ..knob("color_bits", "Bits of color and opacity", "bits a channel", ErrorSource::Vdi)
};
pub(super) const DEPTH: Parameter =
    Parameter { coarseness: halved_each, ..knob("depth_bits", "Bits of depth", "bits", ErrorSource::Vdi) };
pub(super) const BLENDED: Parameter = Parameter {
    coarseness: inverse,
    ..knob("blended", "Rays of the VDI for one of the picture", "rays", ErrorSource::Drawing)
};
pub(super) const NEAREST: Parameter =
    Parameter { priced: false, coarseness: thinned, ..knob("nearest", "Nearest", "voxels apart", ErrorSource::Plain) };
pub(super) const TRILINEAR: Parameter = Parameter {
    priced: false,
    coarseness: thinned,
    ..knob("trilinear", "Trilinear", "voxels apart", ErrorSource::Plain)
};
pub(super) const TRICUBIC: Parameter = Parameter {
    priced: false,
    coarseness: thinned,
    ..knob("tricubic", "Tricubic", "voxels apart", ErrorSource::Plain)
};
pub(super) const MIDPOINT: Parameter = knob("midpoint_f64", "Midpoint, f64", "voxels", ErrorSource::Plain);
pub(super) const MIDPOINT_SINGLE: Parameter = knob("midpoint_f32", "Midpoint, f32", "voxels", ErrorSource::Plain);
pub(super) const PREINTEGRATED: Parameter = knob("preintegrated", "Pre-integrated", "voxels", ErrorSource::Plain);
pub(super) const SAMPLE: Parameter = Parameter {
    coarseness: inverse,
    ..knob("sample_px", "Picture that quality is taken from", "pixels a side", ErrorSource::Sample)
};

/// How a value of a generation parameter is set.
pub(super) type Set = fn(VdiParams, f64) -> Result<VdiParams, Invalid>;

/// A generation parameter and the values it takes.
pub(super) struct ParameterSweep {
    /// What is turned.
    pub knob: Parameter,
    /// Coarsest first.
    pub values: Vec<f64>,
    /// How a value is set.
    pub set: Set,
}

/// The generation parameters that are turned around `base`.
pub(super) fn of_generation(base: &VdiParams) -> [ParameterSweep; 4] {
    let most = f64::from(VdiParams::MAX_RESOLUTION);
    let rays = RESOLUTIONS.map(|share| (share * f64::from(base.resolution())).round().clamp(1.0, most));
    let turned = |knob: Parameter, values: &[f64], at_base, set| ParameterSweep {
        knob,
        values: around(values, at_base, knob.coarseness),
        set,
    };
    [
        ParameterSweep { knob: STEP, values: steps(base), set: with_step },
        turned(CUTOFF, &CUTOFFS, base.opacity_cutoff(), |p, v| p.with_opacity_cutoff(v)),
        turned(GAMMA, &GAMMAS, base.gamma(), |p, v| p.with_gamma(v)),
        turned(RESOLUTION, &rays, base.resolution().into(), |p, v| p.with_resolution(v as u32)),
    ]
}

/// The sampling step, of kernels that integrate the transfer function over it: none longer than those take.
pub(super) fn of_integration(base: &VdiParams, scene: &Scene) -> ParameterSweep {
    let mut values = steps(base);
    values.retain(|&step| scene.effects.check_step(step).is_ok());
    ParameterSweep { knob: STEP_INTEGRATED, values, set: with_step }
}

fn with_step(params: VdiParams, step: f64) -> Result<VdiParams, Invalid> {
    params.with_step_voxels(step)
}

/// Every setting of them, and every combination of some.
///
/// # Errors
/// Never for a valid `base`.
pub(super) fn settings(base: &VdiParams, turned: &[ParameterSweep]) -> Result<Vec<VdiParams>, Invalid> {
    let one = turned.iter().flat_map(|t| t.values.iter().map(|&v| (t.set)(*base, v)));
    let mut all = one.collect::<Result<Vec<_>, _>>()?;
    all.extend(combined(base)?);
    all.sort_by_key(|p| GenerationParams::from(*p).key());
    all.dedup();
    Ok(all)
}

/// Sampling steps, the base's among them, longest first.
pub(super) fn steps(base: &VdiParams) -> Vec<f64> {
    around(&STEPS, base.step_voxels(), STEP.coarseness)
}

/// Several generation parameters turned at once.
fn combined(base: &VdiParams) -> Result<Vec<VdiParams>, Invalid> {
    let mut all = Vec::new();
    for share in [0.5, 1.0, 2.0] {
        let most = f64::from(VdiParams::MAX_RESOLUTION);
        let r = (share * f64::from(base.resolution())).round().clamp(1.0, most) as u32;
        for gamma in [0.08, 0.02, 0.005] {
            for steps in [4.0, 2.0, 1.0] {
                let step_voxels = (steps * base.step_voxels()).min(64.0);
                all.push(base.with_resolution(r)?.with_gamma(gamma)?.with_step_voxels(step_voxels)?);
            }
        }
    }
    Ok(all)
}

/// `values` and that of the base, coarsest first.
fn around(values: &[f64], base: f64, coarseness: fn(f64) -> f64) -> Vec<f64> {
    let mut all = values.to_vec();
    all.push(base);
    all.sort_by(|a, b| coarseness(*b).total_cmp(&coarseness(*a)));
    all.dedup();
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_base_is_among_the_values_and_the_coarsest_comes_first() {
        let base = VdiParams::new(100, 0.03).unwrap().with_step_voxels(0.7).unwrap();
        let turned = of_generation(&base);
        for ParameterSweep { knob, values, set } in &turned {
            let h: Vec<f64> = values.iter().map(|&v| (knob.coarseness)(v)).collect();
            assert!(h.windows(2).all(|w| w[0] > w[1]), "{} {h:?}", knob.key);
            assert!(values.iter().any(|&v| set(base, v).unwrap() == base), "{}", knob.key);
        }
        // The base is in each of the four, and once in the end.
        let one_by_one: usize = turned.iter().map(|t| t.values.len()).sum();
        let all = settings(&base, &turned).unwrap();
        assert!(all.len() > one_by_one && all.iter().filter(|p| **p == base).count() == 1);
    }
}
