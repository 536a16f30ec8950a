//! The compiled kernels and the shape of their bindings. Each kind of voxels has its own, compiled when first met.

use super::resident::{Kind, Resident, Tables};
use lamina_device::Gpu;
use lamina_device::wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayout, BindGroupLayoutDescriptor, BindGroupLayoutEntry,
    BindingResource, BindingType, Buffer, BufferBindingType, ComputePipeline, ComputePipelineDescriptor,
    PipelineCompilationOptions, PipelineLayoutDescriptor, ShaderModule, ShaderModuleDescriptor, ShaderSource,
    ShaderStages, TextureSampleType, TextureViewDimension,
};

/// What every kernel that marches is made of.
macro_rules! march {
    ($kernel:literal) => {
        concat!(
            include_str!("layout.wgsl"),
            include_str!("leaf.wgsl"),
            include_str!("march.wgsl"),
            include_str!($kernel)
        )
    };
}

pub const RAYCAST: &str = march!("raycast.wgsl");
pub const GENERATE: &str = march!("generate.wgsl");
pub const SCAN: &str = concat!(include_str!("layout.wgsl"), include_str!("scan.wgsl"));

/// The march for one kind of voxels.
#[derive(Debug)]
pub struct March {
    pub kind: Kind,
    pub raycast_rows: ComputePipeline,
    pub raycast_pixels: ComputePipeline,
    pub generate: ComputePipeline,
}

/// Shapes of bindings, and the kernels that no kind of voxels matters to.
#[derive(Debug)]
pub struct Pipelines {
    field: BindGroupLayout,
    pub raycast: BindGroupLayout,
    pub generate: BindGroupLayout,
    pub scan: BindGroupLayout,
    pub scan_blocks: ComputePipeline,
    pub add_sums: ComputePipeline,
}

const UNIFORM: BindingType = buffer(BufferBindingType::Uniform);
const READ: BindingType = buffer(BufferBindingType::Storage { read_only: true });
const WRITE: BindingType = buffer(BufferBindingType::Storage { read_only: false });
const VOXELS: BindingType = BindingType::Texture {
    sample_type: TextureSampleType::Uint,
    view_dimension: TextureViewDimension::D3,
    multisampled: false,
};

const fn buffer(ty: BufferBindingType) -> BindingType {
    BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None }
}

impl Pipelines {
    /// To be called inside [`Gpu::run`].
    pub fn new(gpu: &Gpu) -> Self {
        let scan = layout(gpu, "scan", &[UNIFORM, WRITE, WRITE]);
        let module = module(gpu, "scan", SCAN);
        let pipeline = |entry| pipeline(gpu, &module, entry, &[&scan], &[]);
        Self {
            field: layout(gpu, "field", &[UNIFORM, UNIFORM, VOXELS, READ, READ, READ]),
            raycast: layout(gpu, "raycast", &[UNIFORM, READ, WRITE]),
            generate: layout(gpu, "generate", &[UNIFORM, WRITE, WRITE, WRITE]),
            scan_blocks: pipeline("scan_blocks"),
            add_sums: pipeline("add_sums"),
            scan,
        }
    }

    /// The march for voxels of this kind.
    pub fn march(&self, gpu: &Gpu, kind: Kind) -> March {
        let (raycast, generate) = (module(gpu, "raycast", RAYCAST), module(gpu, "generate", GENERATE));
        let constants = [("KIND", f64::from(kind as u32))];
        let raycaster = |entry| pipeline(gpu, &raycast, entry, &[&self.field, &self.raycast], &constants);
        March {
            kind,
            raycast_rows: raycaster("raycast_rows"),
            raycast_pixels: raycaster("raycast_pixels"),
            generate: pipeline(gpu, &generate, "generate", &[&self.field, &self.generate], &constants),
        }
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
        bind(gpu, &self.field, resources)
    }
}

/// Binds buffers in order.
pub fn bind_buffers<const N: usize>(gpu: &Gpu, layout: &BindGroupLayout, buffers: [&Buffer; N]) -> BindGroup {
    bind(gpu, layout, buffers.map(Buffer::as_entire_binding))
}

pub fn bind<const N: usize>(gpu: &Gpu, layout: &BindGroupLayout, resources: [BindingResource<'_>; N]) -> BindGroup {
    let numbered = resources.into_iter().enumerate();
    let entries: Vec<_> = numbered.map(|(n, resource)| BindGroupEntry { binding: n as u32, resource }).collect();
    gpu.device().create_bind_group(&BindGroupDescriptor { label: None, layout, entries: &entries })
}

fn layout(gpu: &Gpu, label: &str, types: &[BindingType]) -> BindGroupLayout {
    let numbered = types.iter().enumerate();
    let entry = |(n, &ty): (usize, &BindingType)| BindGroupLayoutEntry {
        binding: n as u32,
        visibility: ShaderStages::COMPUTE,
        ty,
        count: None,
    };
    let entries: Vec<_> = numbered.map(entry).collect();
    gpu.device().create_bind_group_layout(&BindGroupLayoutDescriptor { label: Some(label), entries: &entries })
}

pub fn module(gpu: &Gpu, label: &str, source: &'static str) -> ShaderModule {
    let source = ShaderSource::Wgsl(source.into());
    gpu.device().create_shader_module(ShaderModuleDescriptor { label: Some(label), source })
}

fn pipeline(
    gpu: &Gpu,
    module: &ShaderModule,
    entry: &str,
    groups: &[&BindGroupLayout],
    constants: &[(&str, f64)],
) -> ComputePipeline {
    let groups: Vec<_> = groups.iter().map(|&g| Some(g)).collect();
    let layout = gpu.device().create_pipeline_layout(&PipelineLayoutDescriptor {
        label: Some(entry),
        bind_group_layouts: &groups,
        immediate_size: 0,
    });
    gpu.device().create_compute_pipeline(&ComputePipelineDescriptor {
        label: Some(entry),
        layout: Some(&layout),
        module,
        entry_point: Some(entry),
        compilation_options: PipelineCompilationOptions { constants, ..Default::default() },
        cache: None,
    })
}
