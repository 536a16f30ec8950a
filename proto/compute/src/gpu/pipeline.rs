//! Compute pipelines, bind group layouts and bind groups, in the order of binding numbers.

use super::Gpu;
use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayout, BindGroupLayoutDescriptor, BindGroupLayoutEntry,
    BindingResource, BindingType, Buffer, BufferBindingType, ComputePipeline, ComputePipelineDescriptor,
    PipelineCompilationOptions, PipelineLayoutDescriptor, ShaderModule, ShaderModuleDescriptor, ShaderSource,
    ShaderStages,
};

/// A uniform buffer.
pub const UNIFORM: BindingType = buffer(BufferBindingType::Uniform);
/// A storage buffer that kernels read.
pub const READ: BindingType = buffer(BufferBindingType::Storage { read_only: true });
/// A storage buffer that kernels write.
pub const WRITE: BindingType = buffer(BufferBindingType::Storage { read_only: false });

const fn buffer(ty: BufferBindingType) -> BindingType {
    BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None }
}

/// To be called inside [`Gpu::run`].
impl Gpu {
    /// Compiles WGSL.
    pub fn module(&self, label: &str, source: &str) -> ShaderModule {
        let source = ShaderSource::Wgsl(source.into());
        self.device().create_shader_module(ShaderModuleDescriptor { label: Some(label), source })
    }

    /// The layout of a bind group.
    pub fn layout(&self, label: &str, types: &[BindingType]) -> BindGroupLayout {
        let entry = |(n, &ty): (usize, &BindingType)| BindGroupLayoutEntry {
            binding: n as u32,
            visibility: ShaderStages::COMPUTE,
            ty,
            count: None,
        };
        let entries: Vec<_> = types.iter().enumerate().map(entry).collect();
        self.device().create_bind_group_layout(&BindGroupLayoutDescriptor { label: Some(label), entries: &entries })
    }

    /// The pipeline of entry point `entry` of `module` with values of its override `constants`. Without `groups` the bind group
    /// layouts are inferred from the shader.
    pub fn pipeline(
        &self,
        module: &ShaderModule,
        entry: &str,
        groups: &[&BindGroupLayout],
        constants: &[(&str, f64)],
    ) -> ComputePipeline {
        let groups: Vec<_> = groups.iter().map(|&g| Some(g)).collect();
        let layout = (!groups.is_empty()).then(|| {
            self.device().create_pipeline_layout(&PipelineLayoutDescriptor {
                label: Some(entry),
                bind_group_layouts: &groups,
                immediate_size: 0,
            })
        });
        self.device().create_compute_pipeline(&ComputePipelineDescriptor {
            label: Some(entry),
            layout: layout.as_ref(),
            module,
            entry_point: Some(entry),
            compilation_options: PipelineCompilationOptions { constants, ..Default::default() },
            cache: None,
        })
    }

    /// A bind group of buffers.
    pub fn bind(&self, layout: &BindGroupLayout, buffers: &[&Buffer]) -> BindGroup {
        self.bind_all(layout, buffers.iter().map(|b| b.as_entire_binding()))
    }

    /// A bind group of buffers and textures.
    pub fn bind_all<'a>(
        &self,
        layout: &BindGroupLayout,
        resources: impl IntoIterator<Item = BindingResource<'a>>,
    ) -> BindGroup {
        let entry = |(n, resource): (usize, _)| BindGroupEntry { binding: n as u32, resource };
        let entries: Vec<_> = resources.into_iter().enumerate().map(entry).collect();
        self.device().create_bind_group(&BindGroupDescriptor { label: None, layout, entries: &entries })
    }
}
