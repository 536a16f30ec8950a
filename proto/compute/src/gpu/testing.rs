//! The device that tests run on.

use super::{Choice, DeviceError, Gpu, Opened};
use wgpu::{BufferUsages, ComputePass};

/// Any device, hardware or software. `None`, with a line on standard output, if there is none.
///
/// # Panics
/// If there is none and REQUIRE_GPU=1 is set.
pub fn gpu() -> Option<Gpu> {
    match Gpu::open(Choice::Gpu) {
        Ok(Opened::Gpu(gpu)) => Some(*gpu),
        Ok(Opened::Cpu(reason)) => panic!("asked for a GPU, got the processor: {reason}"),
        Err(e) if std::env::var_os("REQUIRE_GPU").is_some_and(|v| v == "1") => panic!("REQUIRE_GPU=1, and {e}"),
        Err(e) => {
            println!("skipped: {e}");
            None
        }
    }
}

/// Evaluates the entry point `probe` of `source` for each of `cases`: it reads, from binding 0, a case's `IN` vectors and `tag`, and
/// writes `OUT` vectors to binding 1, in workgroups of 64.
///
/// # Panics
/// If the device fails.
pub fn probe<const IN: usize, const OUT: usize>(
    gpu: &Gpu,
    source: &str,
    tag: f32,
    cases: &[[[f32; 4]; IN]],
) -> Vec<[[f32; 4]; OUT]> {
    let outcomes = gpu.run("probing", || {
        let tag = [tag, 0.0, 0.0, 0.0];
        let input: Vec<[f32; 4]> = cases.iter().flat_map(|case| case.iter().copied().chain([tag])).collect();
        let input = gpu.upload("cases", bytemuck::cast_slice(&input), BufferUsages::STORAGE);
        let size = (16 * OUT * cases.len()) as u64;
        let output = gpu.buffer("outcomes", size, BufferUsages::STORAGE | BufferUsages::COPY_SRC);
        let pipeline = gpu.pipeline(&gpu.module("probe", source), "probe", &[], &[]);
        let bindings = gpu.bind(&pipeline.get_bind_group_layout(0), &[&input, &output]);
        let record = |pass: &mut ComputePass<'_>| {
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &bindings, &[]);
            pass.dispatch_workgroups(cases.len().div_ceil(64) as u32, 1, 1);
        };
        let done = gpu.submit("probe", record, &[(&output, 0..size)])?;
        let vectors: Vec<[f32; 4]> = done[0].chunks_exact(16).map(bytemuck::pod_read_unaligned).collect();
        let outcomes = vectors.chunks_exact(OUT).map(|outcome| std::array::from_fn(|n| outcome[n]));
        Ok::<_, DeviceError>(outcomes.collect())
    });
    outcomes.unwrap_or_else(|e| panic!("{e}"))
}
