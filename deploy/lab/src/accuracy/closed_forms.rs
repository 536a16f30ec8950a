//! Closed forms that the reference has to meet before it is used.

use super::error::Error;
use super::integrator::Integrator;
use super::optics::Optics;
use super::reference::{AGREEMENT_DB, Reference};
use super::scalars::Scalars;
use anyhow::ensure;
use glam::DVec3;
use lamina_model::{
    ControlPoint, Grid, Invalid, Ray, ScalarRange, Scale, Scene, TransferFunction, Volume, Voxels, suggest,
};

/// Cells along each side of the unit box that is looked through.
const CELLS: usize = 8;
/// A color that is the same everywhere.
const COLOR: [f64; 3] = [0.9, 0.5, 0.2];
/// Opacity of one box length.
const OPACITY: f64 = 0.7;

/// A medium whose light is known.
pub(super) struct ClosedForm {
    /// What it is, with its formula.
    pub name: &'static str,
    scalars: Scalars,
    scene: Scene,
    /// Light along a ray that runs `length` through the box.
    light: fn(f64) -> [f64; 3],
}

/// How a closed form was met.
pub(super) struct Met {
    /// What it is, with its formula.
    pub name: &'static str,
    /// What is left.
    pub error: Error,
}

/// Extinction of a uniform medium of opacity [`OPACITY`].
fn kappa() -> f64 {
    -(-OPACITY).ln_1p()
}

/// All of them: the field runs from 0 to 1 along z, or is 0.5 everywhere.
///
/// # Errors
/// Never.
pub(super) fn all() -> Result<[ClosedForm; 3], Invalid> {
    let white = |at, opacity| ControlPoint { at, color: COLOR, opacity };
    let lit = |at| ControlPoint { at, color: [at; 3], opacity: OPACITY };
    Ok([
        ClosedForm {
            name: "uniform slab: 1 - exp(-kappa L)",
            light: |length| COLOR.map(|c| -c * (-kappa() * length).exp_m1()),
            ..form(|_| 0.5, vec![white(0.0, OPACITY)])?
        },
        ClosedForm {
            name: "opacity a u on a ramp: tau = L ((1 - a) ln(1 - a) + a) / a",
            light: |length| {
                let tau = length * ((1.0 - OPACITY) * (-OPACITY).ln_1p() + OPACITY) / OPACITY;
                COLOR.map(|c| -c * (-tau).exp_m1())
            },
            ..form(|z| z, vec![white(0.0, 0.0), white(1.0, OPACITY)])?
        },
        ClosedForm {
            name: "color u on a ramp in a uniform medium: (1 - exp(-k) (1 + k)) / k, k = kappa L",
            light: |length| {
                let k = kappa() * length;
                [(1.0 - (-k).exp() * (1.0 + k)) / k; 3]
            },
            ..form(|z| z, vec![lit(0.0), lit(1.0)])?
        },
    ])
}

fn form(field: impl Fn(f64) -> f64, points: Vec<ControlPoint>) -> Result<ClosedForm, Invalid> {
    let grid = Grid::new([CELLS + 1; 3], DVec3::splat(1.0 / CELLS as f64), DVec3::ZERO)?;
    let at = |n: usize| field((n / (CELLS + 1).pow(2)) as f64 / CELLS as f64);
    let volume = Volume::new(grid, Voxels::F64((0..grid.voxels()).map(at).collect()))?;
    let range = ScalarRange::new(0.0, 1.0, Scale::Linear)?;
    let transfer = TransferFunction::new(range, Some(1.0), points)?;
    let scene = Scene { transfer, ..suggest::suggest(&[&volume])? };
    let scalars = Scalars::new(volume, scene.transfer.range());
    Ok(ClosedForm { name: "", scalars, scene, light: |_| [0.0; 3] })
}

/// From below the box upwards, each a little more slanted; all leave through the top.
fn rays() -> Vec<Ray> {
    let slanted = |n: u8| {
        let direction = DVec3::new(0.03 * f64::from(n), -0.02 * f64::from(n), 1.0).normalize();
        Ray { origin: DVec3::new(0.4, 0.6, 0.0) - direction, direction }
    };
    (0..12).map(slanted).collect()
}

impl ClosedForm {
    /// What is left between the closed form and what `colors` gives for the same rays.
    pub(super) fn error(&self, colors: impl Fn(&Integrator, &[Ray]) -> Vec<[f64; 3]>) -> Error {
        let optics = Optics::new(&self.scene.transfer, 1.0);
        let rays = rays();
        // The box is one high: a ray's length in it is one over its slope.
        let exact: Vec<[f64; 3]> = rays.iter().map(|ray| (self.light)(1.0 / ray.direction.z)).collect();
        Error::between(&colors(&Integrator::new(&self.scalars, &optics, &self.scene), &rays), &exact)
    }
}

/// Has the reference meet all of them.
///
/// # Errors
/// If it misses one by more than the agreement that it is to reach.
pub(super) fn check() -> anyhow::Result<Vec<Met>> {
    let meet = |form: ClosedForm| {
        let error = form.error(|integrator, rays| Reference::converged(integrator, rays).colors);
        let db = error.decibels();
        ensure!(
            db >= AGREEMENT_DB,
            "the reference misses a closed form, {}: {db:.1} dB; nothing is measured",
            form.name
        );
        Ok(Met { name: form.name, error })
    };
    all()?.into_iter().map(meet).collect()
}
