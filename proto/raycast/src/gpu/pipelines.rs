//! The compiled kernels and the shape of their bindings. Each kind of voxels has its own, compiled when first met.

use super::effects::{Resources, Set};
use super::resident::{Kind, Resident, Tables};
use lamina_compute::gpu::Gpu;
use lamina_compute::gpu::pipeline::{READ, UNIFORM, WRITE};
use lamina_compute::gpu::wgpu::{
    BindGroup, BindGroupLayout, BindingResource, BindingType, Buffer, ComputePipeline, TextureSampleType,
    TextureViewDimension,
};

/// What every kernel that marches is made of.
macro_rules! march {
    ($kernel:literal) => {
        concat!(
            include_str!("layout.wgsl"),
            include_str!("leaf.wgsl"),
            include_str!("march.wgsl"),
            include_str!("effects.wgsl"),
            include_str!($kernel)
        )
    };
}

pub const RAYCAST: &str = march!("raycast.wgsl");
pub const GENERATE: &str = march!("generate.wgsl");
pub const SCAN: &str = concat!(include_str!("layout.wgsl"), include_str!("scan.wgsl"));

/// The march for one kind of voxels and one set of effects.
#[derive(Debug)]
pub struct March {
    pub kind: Kind,
    pub set: Set,
    pub raycast_rows: ComputePipeline,
    pub raycast_pixels: ComputePipeline,
    pub generate: ComputePipeline,
}

/// Shapes of bindings, and the kernels that no kind of voxels matters to.
#[derive(Debug)]
pub struct Pipelines {
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
    pub fn new(gpu: &Gpu) -> Self {
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

    /// The march for voxels of this kind, with this set of effects.
    pub fn march(&self, gpu: &Gpu, kind: Kind, set: Set) -> March {
        self.march_of(gpu, kind, set, RAYCAST)
    }

    /// The same with the ray caster of `raycast`.
    pub fn march_of(&self, gpu: &Gpu, kind: Kind, set: Set, raycast: &str) -> March {
        let (raycast, generate) = (gpu.module("raycast", raycast), gpu.module("generate", GENERATE));
        let constants: Vec<(&str, f64)> =
            std::iter::once(("KIND", f64::from(kind as u32))).chain(set.constants()).collect();
        let raycaster = |entry| gpu.pipeline(&raycast, entry, &[&self.field, &self.raycast, &self.effects], &constants);
        March {
            kind,
            set,
            raycast_rows: raycaster("raycast_rows"),
            raycast_pixels: raycaster("raycast_pixels"),
            generate: gpu.pipeline(&generate, "generate", &[&self.field, &self.generate, &self.effects], &constants),
        }
    }

    /// Group 2 of every march.
    pub fn bind_effects(&self, gpu: &Gpu, effects: &Resources) -> BindGroup {
        let resources = [
            effects.uniform.as_entire_binding(),
            effects.sums.as_entire_binding(),
            effects.light.as_entire_binding(),
            BindingResource::TextureView(&effects.colors),
        ];
        gpu.bind_all(&self.effects, resources)
    }

    /// Group 0 of every march.
    pub fn bind_field(&self, gpu: &Gpu, field: &Resident, tables: &Tables, view: &Buffer) -> BindGroup {
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
