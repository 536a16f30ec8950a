//! The parts by themselves: raycast, generate, render, compare.

use crate::cli;
use crate::out_of_core::Slabs;
use crate::picture_file;
use crate::scene_file::{scene_for, with_step};
use crate::source::{read_options, with_colors};
use anyhow::{Context, ensure};
use lamina_codec::{Codec, EncodeOptions, EncodedStep, ErrorMeasure, Layout};
use lamina_model::{GenerationParams, Invalid, Representation, Scene, Segmentation, VdiParams, Volume, psnr, ssim};
use lamina_raycast::{Backend, Field};
use lamina_tuner::units::Bytes;
use lamina_vdi_render::{Detail, Drawable};
use lamina_volume_io::{Series, read_recorded};
use std::time::Instant;

/// The volume and scene that an input names.
pub fn open(input: &cli::Input) -> anyhow::Result<(Volume, Scene)> {
    let series = Series::open(&input.input, &read_options(&input.raw))?;
    let volume = read_step(&series, input)?;
    let scene = with_step(scene_for(input.scene.as_deref(), &[&volume])?, input)?;
    Ok((with_colors(&series, input.time_step, volume, &scene)?, scene))
}

/// The step that `--time-step` names.
pub fn read_step(series: &Series, input: &cli::Input) -> anyhow::Result<Volume> {
    let (n, steps) = (input.time_step, series.len());
    ensure!(n < steps, "--time-step {n}: {} has {steps} steps, counted from 0", input.input.display());
    Ok(series.read(n)?)
}

/// `volume` under `scene`, with a warning where voxels are missing.
pub fn prepare(volume: Volume, scene: &Scene) -> Field {
    let field = Field::new(volume, scene);
    if field.empty_voxels() > 0 {
        eprintln!("warning: {} voxels are NaN or infinite; they are drawn as empty", field.empty_voxels());
    }
    field
}

/// `lamina raycast`.
pub fn raycast(arguments: &cli::Raycast) -> anyhow::Result<()> {
    picture_file::check(&arguments.view.out)?;
    let (volume, scene) = open(&arguments.input)?;
    let field = prepare(volume, &scene);
    let (camera, size) = (scene.camera.rotated_about_y(arguments.view.view)?, arguments.view.size);
    let backend = Backend::open(arguments.input.backend)?;
    let start = Instant::now();
    let image = backend.raycast(&field, &camera, size, size)?;
    say!("raycast_ms {:.1}", start.elapsed().as_secs_f64() * 1e3);
    picture_file::write(&arguments.view.out, &image)
}

/// `lamina generate`.
pub fn generate(arguments: &cli::Generate) -> anyhow::Result<()> {
    let layout = match arguments.layout {
        cli::LayoutArgument::Columns => Layout::Columns,
        cli::LayoutArgument::Plain => Layout::Plain,
    };
    let codec = match (arguments.codec, layout) {
        (Some(cli::CodecArgument::Bzip2), _) | (None, Layout::Plain) => Codec::Bzip2,
        (Some(cli::CodecArgument::Zstd), _) => Codec::Zstd,
        (Some(cli::CodecArgument::ContextMixing), _) | (None, Layout::Columns) => Codec::ContextMixing,
    };
    let error = match arguments.error {
        cli::ErrorArgument::Maximum => ErrorMeasure::Maximum,
        cli::ErrorArgument::MeanSquare => ErrorMeasure::MeanSquare,
    };
    let options = EncodeOptions { codec, layout, error }.check()?;
    let usual = (None, Layout::Columns, Segmentation::default());
    ensure!(
        arguments.representation == Representation::Vdi || (arguments.codec, layout, arguments.segmentation) == usual,
        "--codec, --layout and --segmentation are for VDIs; leave them out with --representation volume"
    );
    ensure!(
        arguments.representation == Representation::Volume || error == ErrorMeasure::Maximum,
        "--error is for reduced volumes; leave it out with --representation vdi"
    );
    let backend = Backend::open(arguments.input.backend)?;
    let stated = |scene: &Scene| {
        params(arguments.representation, arguments.resolution, arguments.gamma, arguments.opacity_cutoff, scene)
    };
    let (params, (intermediate, generation_time)) = if let Some(Bytes(memory)) = arguments.memory {
        let series = Series::open(&arguments.input.input, &read_options(&arguments.input.raw))?;
        let is_volume = arguments.representation == Representation::Volume;
        let slabs = Slabs::open(&series, &arguments.input, memory, is_volume)?;
        let params = stated(slabs.scene())?;
        (params, slabs.represent(&backend, &params, arguments.segmentation)?)
    } else {
        let (volume, scene) = open(&arguments.input)?;
        let params = stated(&scene)?;
        (params, backend.represent(&prepare(volume, &scene), &params, arguments.segmentation)?)
    };
    let EncodedStep { bytes, cost, .. } = lamina_codec::encode_timed(&intermediate, generation_time, &options, None)?;
    let [generation_ms, encode_ms] = [cost.generation, cost.encode].map(|t| t.as_secs_f64() * 1e3);
    let elements = match params.representation() {
        Representation::Vdi => "supersegments",
        Representation::Volume => "sample_points",
    };
    say!("{elements} {}", cost.elements);
    say!("generation_ms {generation_ms:.1}");
    say!("encode_ms {encode_ms:.1}");
    say!("size_bytes {}", cost.size_bytes);
    std::fs::write(&arguments.out, bytes).with_context(|| format!("{}: cannot be written", arguments.out.display()))
}

/// Parameters as the command line states them; a volume has neither a cut-off nor a step.
pub(crate) fn params(
    representation: Representation,
    resolution: u32,
    gamma: f64,
    opacity_cutoff: f64,
    scene: &Scene,
) -> Result<GenerationParams, Invalid> {
    match representation {
        Representation::Vdi => {
            let params = VdiParams::new(resolution, gamma)?.with_opacity_cutoff(opacity_cutoff)?;
            Ok(params.with_step_voxels(scene.step_voxels)?.into())
        }
        Representation::Volume => GenerationParams::volume(resolution, gamma),
    }
}

/// `lamina render`.
pub fn render(arguments: &cli::Render) -> anyhow::Result<()> {
    picture_file::check(&arguments.view.out)?;
    let shown = Drawable::new(read_recorded(&arguments.input)?);
    let (camera, size) = (shown.camera().rotated_about_y(arguments.view.view)?, arguments.view.size);
    let backend = lamina_vdi_render::Backend::open(arguments.backend)?;
    let start = Instant::now();
    let image = backend.render(&shown, &camera, size, size, Detail::Cubic)?;
    say!("render_ms {:.1}", start.elapsed().as_secs_f64() * 1e3);
    picture_file::write(&arguments.view.out, &image)
}

/// `lamina compare`.
pub fn compare(arguments: &cli::Compare) -> anyhow::Result<()> {
    let (a, b) = (picture_file::read(&arguments.a)?, picture_file::read(&arguments.b)?);
    let db = psnr(&a, &b)?;
    let least = a.width().min(a.height());
    if least >= ssim::WINDOW as u32 {
        say!("ssim {:.6}", ssim::ssim(&a, &b)?);
    }
    if least >= ssim::LEAST_SIDE_OF_SCALES {
        say!("ms_ssim {:.6}", ssim::ms_ssim(&a, &b)?);
    }
    say!("psnr_db {db:.4}");
    Ok(())
}
