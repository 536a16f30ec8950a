//! `lamina-lab accuracy`: what each step of accuracy costs, for the user's data on this machine.
//!
//! Every knob is turned by itself around a base setting. Pictures are compared with a converged reference in double
//! precision that is made here by a plain integrator and first has to meet closed forms. The product's own kernels are
//! what is timed for everything the product can set; what it cannot (interpolation, pre-integration, sums in double
//! precision) is measured with variants of the plain integrator, whose times compare with each other only.

mod choice;
mod closed_forms;
mod csv;
mod curve;
mod error;
mod figures;
mod integrator;
mod kernels_under_test;
mod optics;
mod page;
mod reference;
mod requantize;
mod run_sweeps;
mod scalars;
mod sweeps;
mod tradeoffs;
mod views;

use crate::cli;
use anyhow::{Context, ensure};
use curve::{Convergence, ErrorCurve, Point};
use error::Error;
use integrator::Integrator;
use kernels_under_test::KernelsUnderTest;
use lamina::offline::{open, prepare};
use lamina::say;
use lamina_model::{Effects, Image, Scene, VdiParams, Volume};
use lamina_raycast::Field;
use lamina_vdi_render::Kernels;
use optics::Optics;
use reference::Reference;
use run_sweeps::Plain;
use scalars::Scalars;
use std::time::Instant;
use views::Views;

/// Everything that was found.
pub(crate) struct Findings {
    /// The setting around which knobs are turned.
    base: VdiParams,
    /// Side of the pictures.
    size: u32,
    /// Rays compared.
    rays: usize,
    closed_forms: Vec<closed_forms::Met>,
    reference: Reference,
    curves: Vec<ErrorCurve>,
    /// Every VDI generated, whatever was turned.
    trials: Vec<Point>,
    /// Sums in single precision against double, where they differ most.
    single: Error,
    /// What was asked for.
    psnr_db: f64,
}

impl Findings {
    /// How the error of a curve falls. A quality sample has no reference but the whole pictures.
    fn convergence(&self, curve: &ErrorCurve) -> Convergence {
        let own = if curve.knob.source == curve::ErrorSource::Sample { 0.0 } else { self.reference.own_rms() };
        curve.convergence(2.0 * own)
    }

    /// The curve of `key`.
    fn curve(&self, key: &str) -> Option<&ErrorCurve> {
        self.curves.iter().find(|c| c.knob.key == key)
    }
}

/// `lamina-lab accuracy`.
pub(crate) fn accuracy(arguments: &cli::Accuracy) -> anyhow::Result<()> {
    let base = VdiParams::new(arguments.resolution, arguments.gamma)?;
    Image::check_size(arguments.size, arguments.size)?;
    ensure!(
        arguments.size >= 16,
        "--size {}: quality is taken from pictures of 16 pixels a side or more",
        arguments.size
    );
    let db = arguments.psnr;
    ensure!(db > 0.0 && db <= 150.0, "--psnr {db}: must lie above 0 and up to 150 dB");
    let (volume, scene) = open(&arguments.input)?;
    let base = base.with_step_voxels(scene.step_voxels)?;
    let field = visible(&volume, &scene)?;
    std::fs::create_dir_all(&arguments.out)
        .with_context(|| format!("{}: cannot be created", arguments.out.display()))?;
    let kernels = Kernels::open(arguments.input.backend)?;
    let findings = measure(arguments, &volume, &field, base, &kernels)?;
    csv::write(&arguments.out, &findings)?;
    let command: Vec<String> = std::env::args().skip(1).collect();
    page::write(&arguments.out, &findings, &volume, &format!("lamina {}", command.join(" ")))?;
    for line in tradeoffs::cheapest(&findings) {
        say!("{line}");
    }
    say!("report, table and picture: {}", arguments.out.join("report.html").display());
    Ok(())
}

/// The field, if there is something in it to see.
fn visible(volume: &Volume, scene: &Scene) -> anyhow::Result<Field> {
    ensure!(
        scene.effects.is_none(),
        "effects: the reference knows emission and absorption only; take [effects] out of the scene (pre-integration is \
         measured without being asked for)"
    );
    let voxels = volume.voxels();
    let finite = (0..voxels.len()).any(|n| voxels.get(n).is_finite());
    ensure!(finite, "no voxel is a finite number: there is nothing to measure");
    let field = prepare(volume.clone(), scene);
    let empty = field.empty_space().distances().iter().all(|&d| d > 0);
    ensure!(!empty, "the scene's transfer function leaves all of this volume transparent: there is nothing to measure");
    Ok(field)
}

fn measure(
    arguments: &cli::Accuracy,
    volume: &Volume,
    field: &Field,
    base: VdiParams,
    kernels: &Kernels,
) -> anyhow::Result<Findings> {
    let start = Instant::now();
    let progress = |what: &str| eprintln!("{:6.1} s  {what}", start.elapsed().as_secs_f64());
    let closed_forms = closed_forms::check()?;
    progress(&format!("the reference meets {} closed forms", closed_forms.len()));
    let scene = field.scene();
    let views = Views::new(scene, arguments.size)?;
    let rays = views.rays();
    let scalars = Scalars::new(volume.clone(), scene.transfer.range());
    let optics = Optics::new(&scene.transfer, field.unit_length());
    let integrator = Integrator::new(&scalars, &optics, scene);
    let reference = Reference::converged(&integrator, &rays);
    let background = scene.background.map(f64::from);
    ensure!(
        reference.colors.iter().any(|c| *c != background),
        "none of {} rays meets anything visible: the camera looks past the volume",
        rays.len()
    );
    progress(&page::reference_words(&reference));
    let effects = Effects { pre_integrated: true, ..Effects::default() };
    let integrated = prepare(volume.clone(), &Scene { effects, ..scene.clone() });
    let mut product = KernelsUnderTest::new(field, kernels, &views, &reference.colors);
    let mut integrating = KernelsUnderTest::new(&integrated, kernels, &views, &reference.colors);
    let (turned, by_integration) = (sweeps::of_generation(&base), sweeps::of_integration(&base, integrated.scene()));
    let mut curves = vec![
        run_sweeps::raycast(&product, volume, sweeps::RAYCAST_STEP, &sweeps::steps(&base))?,
        run_sweeps::raycast(&integrating, volume, sweeps::RAYCAST_INTEGRATED, &by_integration.values)?,
    ];
    progress("ray casting");
    let settings = sweeps::settings(&base, &turned)?;
    let also = by_integration.values.iter().map(|&v| (by_integration.set)(base, v)).collect::<Result<Vec<_>, _>>()?;
    for round in 1..=kernels_under_test::ROUNDS {
        settings.iter().try_for_each(|params| product.round(params))?;
        also.iter().try_for_each(|params| integrating.round(params))?;
        progress(&format!("{} VDIs, round {round} of {}", settings.len() + also.len(), kernels_under_test::ROUNDS));
    }
    for turned in &turned {
        curves.push(run_sweeps::generation(&product, &base, turned)?);
    }
    curves.push(run_sweeps::generation(&integrating, &base, &by_integration)?);
    curves.extend(run_sweeps::bits(&product, &base)?);
    progress("bits of color and depth");
    curves.push(run_sweeps::blended(&product, &base)?);
    let trials = [product.trials(), integrating.trials()].concat();
    curves.push(run_sweeps::sample(&product, &views, &base)?);
    let plain =
        Plain { integrator, scalars: &scalars, rays: &rays, reference: &reference.colors, pictures: views.pictures() };
    let (steps, single) = plain.steps(&base)?;
    curves.extend(steps);
    curves.extend(plain.interpolations(&base, arguments.tricubic)?);
    progress("the plain integrator's variants");
    let (size, rays, psnr_db) = (arguments.size, rays.len(), arguments.psnr);
    Ok(Findings { base, size, rays, closed_forms, reference, curves, trials, single, psnr_db })
}

#[cfg(test)]
mod tests;
