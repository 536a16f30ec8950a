//! Pipelines and bind group layouts. Pipelines that march are compiled per voxel type and set of effects, at first use.

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

/// Pipelines that march, for one voxel type and one set of effects.
#[derive(Debug)]
pub(super) struct MarchPipelines {
    pub kind: VoxelKind,
    pub set: EffectSet,
    pub raycast_rows: ComputePipeline,
    pub raycast_pixels: ComputePipeline,
    pub generate: ComputePipeline,
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

    /// Compiles the pipelines for one voxel type and one set of effects.
    pub(super) fn march(&self, gpu: &Gpu, kind: VoxelKind, set: EffectSet) -> MarchPipelines {
        self.march_of(gpu, kind, set, RAYCAST)
    }

    /// Compiles them with the source `raycast` of the ray caster.
    pub(super) fn march_of(&self, gpu: &Gpu, kind: VoxelKind, set: EffectSet, raycast: &str) -> MarchPipelines {
        let (raycast, generate) = (gpu.module("raycast", raycast), gpu.module("generate", GENERATE));
        let constants: Vec<(&str, f64)> =
            std::iter::once(("KIND", f64::from(kind as u32))).chain(set.constants()).collect();
        let raycaster = |entry| gpu.pipeline(&raycast, entry, &[&self.field, &self.raycast, &self.effects], &constants);
        MarchPipelines {
            kind,
            set,
            raycast_rows: raycaster("color_rows"),
            raycast_pixels: raycaster("color_pixels"),
            generate: gpu.pipeline(&generate, "generate", &[&self.field, &self.generate, &self.effects], &constants),
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
