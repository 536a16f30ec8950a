//! Prefix sums against plain addition, at sizes around the blocks.

use super::open;
use crate::gpu::GpuError;
use crate::gpu::scan::PrefixSum;
use lamina_compute::gpu::wgpu::{BufferUsages, ComputePass};

#[test]
fn prefix_sums_are_sums() {
    let Some((gpu, pipelines)) = open() else { return };
    for count in [1_usize, 3, 1023, 1024, 1025, 1 << 20, (1 << 20) + 5] {
        let numbers: Vec<u32> = (0..count).map(|n| (n * 2_654_435_761) as u32 >> 22).collect();
        let sums = gpu.run("a prefix sum", || {
            let usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
            let data = gpu.upload("numbers", bytemuck::cast_slice(&numbers), usage);
            let sum = PrefixSum::new(&gpu, &pipelines, &data, count as u32);
            let record = |pass: &mut ComputePass<'_>| sum.record(&gpu, &pipelines, pass);
            let done = gpu.submit("sum", record, &[(&data, 0..data.size())])?;
            let words = done[0].chunks_exact(4).map(bytemuck::pod_read_unaligned);
            Ok::<Vec<u32>, GpuError>(words.collect())
        });
        let before = |sum: &mut u32, n: &u32| {
            *sum += n;
            Some(*sum - n)
        };
        let expected: Vec<u32> = numbers.iter().scan(0, before).collect();
        assert!(sums.unwrap() == expected, "{count} numbers");
    }
}
