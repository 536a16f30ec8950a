//! Prefix sums on the device: from counts per ray to list offsets.

use super::pipelines::Pipelines;
use crate::kernel::layout::ScanUniforms;
use lamina_compute::gpu::Gpu;
use lamina_compute::gpu::wgpu::{BindGroup, Buffer, BufferUsages, ComputePass};

/// Numbers that one workgroup sums.
const BLOCK: u32 = 1024;

/// Bind groups of the passes that sum one buffer.
#[derive(Debug)]
pub(super) struct PrefixSum {
    /// Bind group and number of blocks per level, from the buffer itself to a single block.
    levels: Vec<(BindGroup, u32)>,
}

impl PrefixSum {
    /// Prepares the exclusive prefix sum of the first `count` (one or more) numbers of `data`, in place.
    pub(super) fn new(gpu: &Gpu, pipelines: &Pipelines, data: &Buffer, count: u32) -> Self {
        let (mut data, mut count) = (data.clone(), count);
        let mut levels = Vec::new();
        loop {
            let blocks = count.div_ceil(BLOCK);
            let scan = ScanUniforms { count, blocks, pad0: [0; 2] };
            let scan = gpu.upload("scan", bytemuck::bytes_of(&scan), BufferUsages::UNIFORM);
            let sums = gpu.buffer("sums", 4 * u64::from(blocks), BufferUsages::STORAGE);
            levels.push((gpu.bind(&pipelines.scan, &[&scan, &data, &sums]), blocks));
            if blocks == 1 {
                return Self { levels };
            }
            (data, count) = (sums, blocks);
        }
    }

    /// Records the passes.
    pub(super) fn record(&self, gpu: &Gpu, pipelines: &Pipelines, pass: &mut ComputePass<'_>) {
        pass.set_pipeline(&pipelines.scan_blocks);
        self.levels.iter().for_each(|level| dispatch(gpu, pass, level));
        pass.set_pipeline(&pipelines.add_sums);
        // The last level is one block: nothing is added to it.
        self.levels.iter().rev().skip(1).for_each(|level| dispatch(gpu, pass, level));
    }
}

fn dispatch(gpu: &Gpu, pass: &mut ComputePass<'_>, (bindings, blocks): &(BindGroup, u32)) {
    let [x, y] = gpu.groups((*blocks).into(), 1);
    pass.set_bind_group(0, bindings, &[]);
    pass.dispatch_workgroups(x, y, 1);
}
