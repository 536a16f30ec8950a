//! Pipelines and bind group layouts. Those that march are of a voxel type and a set of effects.

use super::effects::EffectResources;
use super::resident::{ResidentField, ResidentTables};
use crate::kernel::effects::EffectSet;
use crate::kernel::field::VoxelKind;
use crate::kernel::{GENERATE, RAYCAST, SCAN};
use lamina_compute::gpu::Gpu;
use lamina_compute::gpu::pipeline::{READ, UNIFORM, WRITE};
use lamina_compute::gpu::wgpu::{
    BindGroup, BindGroupLayout, BindingResource, BindingType, Buffer, ComputePipeline, TextureSampleType,
    TextureViewDimension,
};
use std::borrow::Cow;
use std::sync::OnceLock;

/// Pipelines that march, for one voxel type and one set of effects. Each is compiled at its first use, which is inside [`Gpu::run`]: a
/// driver may take seconds.
#[derive(Debug)]
pub(super) struct MarchPipelines {
    pub kind: VoxelKind,
    pub set: EffectSet,
    /// Source of the ray caster.
    raycast: Cow<'static, str>,
    raycast_rows: OnceLock<ComputePipeline>,
    raycast_pixels: OnceLock<ComputePipeline>,
    generate: OnceLock<ComputePipeline>,
}

impl MarchPipelines {
    pub(super) fn new(kind: VoxelKind, set: EffectSet) -> Self {
        Self::with_ray_caster(kind, set, RAYCAST.into())
    }

    /// The ray caster being `raycast`.
    pub(super) fn with_ray_caster(kind: VoxelKind, set: EffectSet, raycast: Cow<'static, str>) -> Self {
        let (raycast_rows, raycast_pixels, generate) = Default::default();
        Self { kind, set, raycast, raycast_rows, raycast_pixels, generate }
    }

    pub(super) fn raycast_rows(&self, gpu: &Gpu, layouts: &Pipelines) -> &ComputePipeline {
        let compile = || self.compile(gpu, (&self.raycast, "color_rows"), layouts, &layouts.raycast);
        self.raycast_rows.get_or_init(compile)
    }

    pub(super) fn raycast_pixels(&self, gpu: &Gpu, layouts: &Pipelines) -> &ComputePipeline {
        let compile = || self.compile(gpu, (&self.raycast, "color_pixels"), layouts, &layouts.raycast);
        self.raycast_pixels.get_or_init(compile)
    }

    pub(super) fn generate(&self, gpu: &Gpu, layouts: &Pipelines) -> &ComputePipeline {
        self.generate.get_or_init(|| self.compile(gpu, (GENERATE, "generate"), layouts, &layouts.generate))
    }

    fn compile(
        &self,
        gpu: &Gpu,
        (source, entry): (&str, &str),
        layouts: &Pipelines,
        own: &BindGroupLayout,
    ) -> ComputePipeline {
        let constants: Vec<(&str, f64)> =
            std::iter::once(("KIND", f64::from(self.kind as u32))).chain(self.set.constants()).collect();
        gpu.pipeline(&gpu.module(entry, source), entry, &[&layouts.field, own, &layouts.effects], &constants)
    }
}

/// Bind group layouts, and the pipelines that do not depend on the field.
#[derive(Debug)]
pub(super) struct Pipelines {
    field: BindGroupLayout,
    effects: BindGroupLayout,
    pub raycast: BindGroupLayout,
    pub generate: BindGroupLayout,
    pub scan: BindGroupLayout,
    pub scan_blocks: ComputePipeline,
    pub add_sums: ComputePipeline,
}

const VOXELS: BindingType = BindingType::Texture {
    sample_type: TextureSampleType::Uint,
    view_dimension: TextureViewDimension::D3,
    multisampled: false,
};

impl Pipelines {
    /// To be called inside [`Gpu::run`].
    pub(super) fn new(gpu: &Gpu) -> Self {
        let scan = gpu.layout("scan", &[UNIFORM, WRITE, WRITE]);
        let module = gpu.module("scan", SCAN);
        let pipeline = |entry| gpu.pipeline(&module, entry, &[&scan], &[]);
        Self {
            field: gpu.layout("field", &[UNIFORM, UNIFORM, VOXELS, READ, READ, READ]),
            effects: gpu.layout("effects", &[UNIFORM, READ, READ, VOXELS]),
            raycast: gpu.layout("raycast", &[UNIFORM, READ, WRITE]),
            generate: gpu.layout("generate", &[UNIFORM, WRITE, WRITE, WRITE]),
            scan_blocks: pipeline("scan_blocks"),
            add_sums: pipeline("add_sums"),
            scan,
        }
    }

    /// Group 2 of every pipeline that marches.
    pub(super) fn bind_effects(&self, gpu: &Gpu, effects: &EffectResources) -> BindGroup {
        let resources = [
            effects.uniform.as_entire_binding(),
            effects.sums.as_entire_binding(),
            effects.light.as_entire_binding(),
            BindingResource::TextureView(&effects.colors),
        ];
        gpu.bind_all(&self.effects, resources)
    }

    /// Group 0 of every pipeline that marches.
    pub(super) fn bind_field(
        &self,
        gpu: &Gpu,
        field: &ResidentField,
        tables: &ResidentTables,
        view: &Buffer,
    ) -> BindGroup {
        let resources = [
            field.volume.as_entire_binding(),
            view.as_entire_binding(),
            BindingResource::TextureView(&field.voxels),
            field.distances.as_entire_binding(),
            tables.step_rows.as_entire_binding(),
            tables.unit_rows.as_entire_binding(),
        ];
        gpu.bind_all(&self.field, resources)
    }
}
