//! VDI generation on the GPU; counterpart of `reference/generate.rs`.
//!
//! Works in bands of rows: counts each ray's supersegments, turns the counts into list offsets by a prefix sum, then marches
//! again and writes, in chunks of rays. Memory follows the actual number of supersegments. While the device writes a chunk,
//! all cores convert and segment the one before.

use super::scan::PrefixSum;
use super::{BAND, BoundField, GpuError, GpuKernels, PerspectiveRays};
use crate::Field;
use crate::kernel::layout::{ClusteringUniforms, GpuSegment, UNSURE};
use crate::vdi::assemble::{RowBand, VdiBuilder, header};
use crate::vdi::segmentation::Segmenter;
use lamina_compute::gpu::wgpu::{Buffer, BufferUsages, BufferView};
use lamina_model::composite::optical_depth_from_opacity;
use lamina_model::{Invalid, Segmentation, Supersegment, Vdi, VdiHeader, VdiParams};
use rayon::prelude::*;
use std::ops::Range;
use std::time::{Duration, Instant};

const SEGMENT_BYTES: u64 = size_of::<GpuSegment>() as u64;
/// Rays that one core converts and segments at a time.
const RAYS_AT_A_TIME: usize = 512;
const RESULT: BufferUsages = BufferUsages::STORAGE.union(BufferUsages::COPY_SRC);

impl GpuKernels {
    /// Generates the VDI of `field` from its scene's camera with `segmentation`; also returns the time taken once the field is on
    /// the device. The paper's R.
    ///
    /// # Errors
    /// If the step is so short that rays would have too many of them, the VDI has 2^32 supersegments or more, the field or a
    /// ray's list does not fit the device, or the device fails.
    #[doc(alias = "R")]
    pub fn generate(
        &self,
        field: &Field,
        params: &VdiParams,
        segmentation: Segmentation,
    ) -> Result<(Vdi, Duration), GpuError> {
        let header = header(field.grid(), field.scene(), params).map_err(GpuError::Invalid)?;
        let segmenter = Segmenter::new(&header, segmentation, field.unit_length());
        let gamma = segmenter.initial_gamma(params.gamma());
        let r = params.resolution();
        let rays = PerspectiveRays { camera: &header.camera, width: r, height: r, step_length: header.step_length };
        self.with("a VDI", field, &rays, |bound| {
            let start = Instant::now();
            let work = VdiGeneration {
                bound,
                header: &header,
                segmenter: &segmenter,
                gamma,
                chunk_segments: (self.chunk_bytes / SEGMENT_BYTES).max(1),
            };
            // Lists hold one entry more than rays; bands are whole rows, of at most 32 KB each.
            let rows = (BAND.min(bound.gpu.max_binding_bytes() / 4 - 1) / u64::from(r)).max(1) as u32;
            let mut vdi = VdiBuilder::new((params.resolution() as usize).pow(2));
            for first_row in (0..r).step_by(rows as usize) {
                work.band(first_row, rows.min(r - first_row), &mut vdi)?;
            }
            Ok((vdi.finish(header).map_err(GpuError::Invalid)?, start.elapsed()))
        })
    }
}

/// A VDI being generated.
struct VdiGeneration<'a> {
    bound: &'a BoundField<'a>,
    header: &'a VdiHeader,
    segmenter: &'a Segmenter<'a>,
    gamma: f64,
    /// The most supersegments written by one dispatch.
    chunk_segments: u64,
}

/// The supersegments of some rays of a band, as the device wrote them.
struct WrittenLists<'a> {
    /// Offsets of the rays' lists, and the end of the last one.
    starts: &'a [u32],
    /// Number of the first ray in the VDI.
    first_ray: usize,
    /// The lists; `None` if all are empty.
    bytes: Option<BufferView>,
}

impl VdiGeneration<'_> {
    /// Generates `rows` rows from `first_row` and appends them to `vdi`.
    fn band(&self, first_row: u32, rows: u32, vdi: &mut VdiBuilder) -> Result<(), GpuError> {
        let BoundField { gpu, pipelines, .. } = self.bound;
        let r = self.header.params.resolution();
        let rays = r * rows;
        let lists = gpu.buffer("lists", 4 * (u64::from(rays) + 1), RESULT);
        let sum = PrefixSum::new(gpu, pipelines, &lists, rays + 1);
        let counting = self.clustering(first_row, rows, 0..rays as usize);
        let counted = self.dispatch(&counting, &lists, 1, Some(&sum))?;
        let starts: Vec<u32> = counted.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect();
        drop(counted);
        // No list is near 2^32 long, so an overflow of the sum shows as a decrease.
        if starts.windows(2).any(|w| w[0] > w[1]) {
            let reason = "2^32 supersegments or more in part of it; raise gamma or lower the resolution";
            return Err(GpuError::Invalid(Invalid::new("vdi", reason)));
        }
        let (mut written, mut first) = (None, 0);
        while first < rays as usize {
            let end = self.chunk_end(&starts, first)?;
            let count = starts[end] - starts[first];
            let writing = ClusteringUniforms {
                writing: 1,
                first_segment: starts[first],
                ..self.clustering(first_row, rows, first..end)
            };
            let write = || (count > 0).then(|| self.dispatch(&writing, &lists, count, None)).transpose();
            // The device is driven by this thread; the others convert what it wrote before.
            let bytes = match written.take() {
                Some(before) => {
                    let mut converted = RowBand::default();
                    let bytes = rayon::in_place_scope(|scope| {
                        scope.spawn(|_| converted = self.converted(&before));
                        write()
                    })?;
                    vdi.add(converted);
                    bytes
                }
                None => write()?,
            };
            let first_ray = first_row as usize * r as usize + first;
            written = Some(WrittenLists { starts: &starts[first..=end], first_ray, bytes });
            first = end;
        }
        if let Some(last) = written {
            vdi.add(self.converted(&last));
        }
        Ok(())
    }

    /// End of the longest range of rays, starting at ray `first`, whose lists fit one chunk.
    fn chunk_end(&self, starts: &[u32], first: usize) -> Result<usize, GpuError> {
        let most = u64::from(starts[first]) + self.chunk_segments;
        let end = first + starts[first..].partition_point(|&s| u64::from(s) <= most) - 1;
        if end > first {
            return Ok(end);
        }
        let needed = SEGMENT_BYTES * u64::from(starts[first + 1] - starts[first]);
        let (what, unit, remedy) = ("one ray's list", "bytes", "raise gamma or the step");
        Err(GpuError::TooLarge { what, needed, limit: SEGMENT_BYTES * self.chunk_segments, unit, remedy })
    }

    /// Uniforms to count the supersegments of some `rays` of a band.
    fn clustering(&self, first_row: u32, rows: u32, rays: Range<usize>) -> ClusteringUniforms {
        let params = &self.header.params;
        let cutoff = optical_depth_from_opacity(params.opacity_cutoff()).min(f32::MAX.into()) as f32;
        ClusteringUniforms {
            gamma: self.gamma.min(f32::MAX.into()) as f32,
            cutoff,
            first_row,
            rows,
            first_ray: rays.start as u32,
            end_ray: rays.end as u32,
            first_segment: 0,
            writing: 0,
        }
    }

    /// Counts or writes up to `count` supersegments. Returns the list offsets if a `sum` is given, else the supersegments.
    fn dispatch(
        &self,
        clustering: &ClusteringUniforms,
        lists: &Buffer,
        count: u32,
        sum: Option<&PrefixSum>,
    ) -> Result<BufferView, GpuError> {
        let BoundField { gpu, pipelines, march, field, effects } = self.bound;
        let r = self.header.params.resolution();
        let rows = clustering.end_ray.div_ceil(r) - clustering.first_ray / r;
        let settings = gpu.upload("clustering", bytemuck::bytes_of(clustering), BufferUsages::UNIFORM);
        let size = SEGMENT_BYTES * u64::from(count);
        let segments = gpu.buffer("segments", size, RESULT);
        let mismatches = gpu.buffer("mismatches", 4, RESULT);
        let bindings = gpu.bind(&pipelines.generate, &[&settings, lists, &segments, &mismatches]);
        let wanted = if sum.is_some() { (lists, 0..lists.size()) } else { (&segments, 0..size) };
        let pipeline = march.generate(gpu, pipelines);
        let mut copies = gpu.submit(
            "generate",
            |pass| {
                pass.set_pipeline(pipeline);
                pass.set_bind_group(0, field, &[]);
                pass.set_bind_group(1, &bindings, &[]);
                pass.set_bind_group(2, effects, &[]);
                pass.dispatch_workgroups(r.div_ceil(8), rows.div_ceil(8), 1);
                if let Some(sum) = sum {
                    sum.record(gpu, pipelines, pass);
                }
            },
            &[wanted, (&mismatches, 0..4)],
        )?;
        match bytemuck::pod_read_unaligned(&copies.split_off(1)[0]) {
            0 => Ok(copies.remove(0)),
            rays => Err(GpuError::Inconsistent(rays)),
        }
    }

    /// The lists converted and segmented, on all cores.
    fn converted(&self, written: &WrittenLists<'_>) -> RowBand {
        let WrittenLists { starts, first_ray, bytes } = written;
        let bytes = bytes.as_deref().unwrap_or_default();
        let rays = starts.len() - 1;
        let parts = (0..rays).into_par_iter().step_by(RAYS_AT_A_TIME).map(|first| {
            let starts = &starts[first..=rays.min(first + RAYS_AT_A_TIME)];
            let [from, to] = [starts[0], starts[starts.len() - 1]]
                .map(|n| SEGMENT_BYTES as usize * (n - written.starts[0]) as usize);
            let first_ray = first_ray + first;
            self.segmenter.rays(first_ray, self.lists(first_ray, starts, &bytes[from..to]))
        });
        RowBand::concat(parts.collect())
    }

    /// The lists of the rays from `first_ray` on. `starts` are their offsets, and the end of the last list.
    fn lists(&self, first_ray: usize, starts: &[u32], bytes: &[u8]) -> RowBand {
        let mut lists = bytes.chunks_exact(SEGMENT_BYTES as usize).map(bytemuck::pod_read_unaligned::<GpuSegment>);
        let mut band = RowBand { counts: Vec::with_capacity(starts.len()), segments: Vec::with_capacity(lists.len()) };
        for (n, w) in starts.windows(2).enumerate() {
            let before = band.segments.len();
            let count = (w[1] - w[0]) as usize;
            band.segments.extend(lists.by_ref().take(count).map(supersegment));
            if band.segments[before..].last().is_some_and(|s| s.end & UNSURE != 0) {
                self.cut(&mut band.segments, before, first_ray + n);
            }
            band.counts.push((band.segments.len() - before) as u32);
        }
        band
    }

    /// Cuts the list of a ray, which begins at `before`, at the number of steps that double precision gives.
    fn cut(&self, segments: &mut Vec<Supersegment>, before: usize, ray: usize) {
        let r = self.header.params.resolution() as usize;
        let span = self.header.ray_span((ray % r) as u32, (ray / r) as u32);
        let steps = span.map_or(0, |(t_in, t_out)| self.header.steps(t_out - t_in));
        while segments.len() > before && segments.last().is_some_and(|s| s.start >= steps) {
            segments.pop();
        }
        if let Some(last) = segments[before..].last_mut() {
            last.end = (last.end & !UNSURE).min(steps);
        }
    }
}

fn supersegment(s: GpuSegment) -> Supersegment {
    Supersegment { start: s.start, end: s.end, color: [s.red, s.green, s.blue], optical_depth: s.optical_depth }
}
