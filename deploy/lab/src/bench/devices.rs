//! `lamina-lab bench --devices`: the kernels on a GPU beside those on the processor, and how near their results are.
//!
//! Times are medians of wall time, results on the host. The first call, which uploads the data and compiles kernels, is
//! listed apart. Where the GPU fails at something the processor does it, and the log says so.

use super::{NOVEL_ANGLE_DEG, median, params};
use crate::cli;
use lamina::offline::{open, prepare};
use lamina::say;
use lamina_codec::{EncodeOptions, encode};
use lamina_compute::gpu::{Choice, adapter};
use lamina_model::{Image, Segmentation, Vdi, psnr};
use lamina_vdi_render::{Detail, Kernels, PreparedVdi};
use std::time::Instant;

/// Prints the table. Pictures are 16 : 9, the first size their height.
pub(super) fn print(arguments: &cli::BenchArguments) -> anyhow::Result<()> {
    let (volume, scene) = open(&arguments.input)?;
    let field = prepare(volume, &scene);
    let (gpu, cpu) = (Kernels::open(Choice::Gpu)?, Kernels::open(Choice::Cpu)?);
    let height = arguments.size[0];
    let width = (u64::from(height) * 16 / 9) as u32;
    Image::check_size(width, height)?;
    let aside = scene.camera.rotated_about_y(NOVEL_ANGLE_DEG)?;
    let rounds = arguments.rounds;
    let name = adapter().map_or_else(String::new, |facts| facts.name);
    say!(
        "{:?} voxels; pictures of {width} x {height}; {name} beside {} threads",
        field.grid().dims(),
        rayon::current_num_threads()
    );
    say!("{:<24}{:>12}{:>12}{:>12}{:>9}  agreement", "median of rounds", "GPU first", "GPU ms", "CPU ms", "ratio");
    for (name, camera) in [("raycast", &scene.camera), ("raycast from aside", &aside)] {
        let cast = |kernels: &Kernels| Ok(kernels.cast.raycast(&field, camera, width, height)?);
        row(name, rounds, || cast(&gpu), || cast(&cpu), decibels)?;
    }
    let params = params(arguments, arguments.resolution, &scene)?;
    let generate = |kernels: &Kernels| Ok(kernels.cast.generate(&field, &params, Segmentation::Fitted)?.0);
    let name = format!("generate {}", arguments.resolution);
    let [vdi, other] = row(&name, rounds, || generate(&gpu), || generate(&cpu), lists)?;
    let bytes = |vdi| anyhow::Ok(encode(vdi, &EncodeOptions::default())?.len());
    let (ours, others) = (bytes(&vdi)?, bytes(&other)?);
    say!("{:<36}{ours:>12}{others:>12}{:>9.5}", "bytes of it", ours as f64 / others as f64);
    let prepared = PreparedVdi::new(&vdi);
    for (name, detail) in [("render", Detail::Nearest), ("blend", Detail::Cubic)] {
        let render = |kernels: &Kernels| Ok(kernels.draw.render_vdi(&prepared, &aside, width, height, detail)?);
        row(name, rounds, || render(&gpu), || render(&cpu), decibels)?;
    }
    Ok(())
}

/// Measures both in turn, prints a line, and returns what they made.
fn row<T>(
    name: &str,
    rounds: u32,
    on_gpu: impl Fn() -> anyhow::Result<T>,
    on_cpu: impl Fn() -> anyhow::Result<T>,
    agreement: impl Fn(&T, &T) -> anyhow::Result<String>,
) -> anyhow::Result<[T; 2]> {
    let timed = |work: &dyn Fn() -> anyhow::Result<T>, ms: &mut Vec<f64>| {
        let start = Instant::now();
        let made = work()?;
        ms.push(1e3 * start.elapsed().as_secs_f64());
        anyhow::Ok(made)
    };
    let (mut first, mut gpu_ms, mut cpu_ms) = (Vec::new(), Vec::new(), Vec::new());
    let mut made = [timed(&on_gpu, &mut first)?, on_cpu()?];
    for _ in 0..rounds {
        made = [timed(&on_gpu, &mut gpu_ms)?, timed(&on_cpu, &mut cpu_ms)?];
    }
    let [gpu, cpu] = [&gpu_ms, &cpu_ms].map(|ms| median(ms).unwrap_or(f64::NAN));
    let agreement = agreement(&made[0], &made[1])?;
    say!("{name:<24}{:>12.2}{gpu:>12.2}{cpu:>12.2}{:>9.3}  {agreement}", first[0], gpu / cpu);
    Ok(made)
}

fn decibels(a: &Image, b: &Image) -> anyhow::Result<String> {
    Ok(format!("{:.1} dB", psnr(a, b)?))
}

/// Share of rays whose supersegments lie elsewhere.
fn lists(a: &Vdi, b: &Vdi) -> anyhow::Result<String> {
    let r = a.resolution();
    let differs = |&(i, j): &(u32, u32)| {
        let places = |vdi: &Vdi| vdi.list(i, j).iter().map(|s| (s.start, s.end)).collect::<Vec<_>>();
        places(a) != places(b)
    };
    let others = (0..r).flat_map(|j| (0..r).map(move |i| (i, j))).filter(differs).count();
    let share = 100.0 * others as f64 / f64::from(r).powi(2);
    Ok(format!("{share:.3} % of rays differ; {} and {} supersegments", a.segments().len(), b.segments().len()))
}
