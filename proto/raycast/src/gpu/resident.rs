//! A field on the device: voxels as raw bits, the empty-space map, and transfer function tables for the step lengths in use.

use super::GpuError;
use crate::Field;
use crate::kernel::effects::light;
use crate::kernel::field::{TableFacts, VoxelKind, colors, dims, distances, tables, volume, voxels_of};
use lamina_compute::gpu::Gpu;
use lamina_compute::gpu::wgpu::{
    Buffer, BufferUsages, Extent3d, Origin3d, PollType, TexelCopyBufferLayout, TexelCopyTextureInfo, TextureAspect,
    TextureDescriptor, TextureDimension, TextureFormat, TextureUsages, TextureView,
};
use lamina_compute::kernel::TexelFormat;

/// A field on the device.
#[derive(Debug)]
pub(super) struct ResidentField {
    /// [`Field::id`] of the field.
    pub id: u64,
    pub kind: VoxelKind,
    pub voxels: TextureView,
    pub volume: Buffer,
    pub distances: Buffer,
    /// The light volume.
    pub light: Buffer,
    /// The color field; one point if there is none.
    pub colors: TextureView,
    tables: Vec<ResidentTables>,
}

/// Transfer function tables for one step length.
#[derive(Debug, Clone)]
pub(super) struct ResidentTables {
    pub facts: TableFacts,
    pub step_rows: Buffer,
    pub unit_rows: Buffer,
}

/// Step lengths whose tables are kept: those of pictures, of VDIs, and of one trial.
const TABLES: usize = 3;
/// Bytes of voxels uploaded at a time; the driver holds a copy until they have arrived.
const SLAB_BYTES: usize = 64 << 20;

impl ResidentField {
    /// Uploads `field`. To be called inside [`Gpu::run`], after [`check_size`].
    pub(super) fn new(gpu: &Gpu, field: &Field) -> Self {
        let (kind, format, bytes) = voxels_of(field);
        Self {
            id: field.id(),
            kind,
            voxels: texture(gpu, dims(field), format, bytes),
            volume: gpu.upload("volume", bytemuck::bytes_of(&volume(field)), BufferUsages::UNIFORM),
            distances: gpu.upload("distances", &distances(field), BufferUsages::STORAGE),
            light: gpu.upload("light", bytemuck::cast_slice(&light(field)), BufferUsages::STORAGE),
            colors: {
                let (dims, colors) = colors(field);
                texture(gpu, dims, TexelFormat::R32Uint, bytemuck::cast_slice(&colors))
            },
            tables: Vec::new(),
        }
    }

    /// The tables for `step_length`, created at first use.
    pub(super) fn tables(&mut self, gpu: &Gpu, field: &Field, step_length: f64) -> ResidentTables {
        if let Some(t) = self.tables.iter().find(|t| t.facts.step_length == step_length) {
            return t.clone();
        }
        let (facts, table) = tables(field, step_length);
        let upload = |label, bytes| gpu.upload(label, bytes, BufferUsages::STORAGE);
        let tables = ResidentTables {
            facts,
            step_rows: upload("step rows", bytemuck::cast_slice(&table.step)),
            unit_rows: upload("unit rows", bytemuck::cast_slice(&table.unit)),
        };
        if self.tables.len() == TABLES {
            self.tables.remove(0);
        }
        self.tables.push(tables.clone());
        tables
    }
}

/// Succeeds if `field` fits the device.
pub(super) fn check_size(gpu: &Gpu, field: &Field) -> Result<(), GpuError> {
    let side = field.grid().dims().into_iter().max().unwrap_or(0) as u64;
    let limit = gpu.limits().max_texture_dimension_3d.into();
    if side > limit {
        let (what, unit, remedy) = ("the volume", "voxels along one side", "send every other voxel");
        return Err(GpuError::TooLarge { what, needed: side, limit, unit, remedy });
    }
    let (needed, limit) = (field.empty_space().distances().len() as u64, gpu.max_binding_bytes());
    if needed > limit {
        let (what, unit, remedy) = ("the volume's map of empty space", "bytes", "send every other voxel");
        return Err(GpuError::TooLarge { what, needed, limit, unit, remedy });
    }
    Ok(())
}

fn texture(gpu: &Gpu, [nx, ny, nz]: [u32; 3], format: TexelFormat, bytes: &[u8]) -> TextureView {
    let texture = gpu.device().create_texture(&TextureDescriptor {
        label: Some("voxels"),
        size: Extent3d { width: nx, height: ny, depth_or_array_layers: nz },
        mip_level_count: 1,
        sample_count: 1,
        dimension: TextureDimension::D3,
        format: match format {
            TexelFormat::R8Uint => TextureFormat::R8Uint,
            TexelFormat::R16Uint => TextureFormat::R16Uint,
            TexelFormat::R32Uint => TextureFormat::R32Uint,
        },
        usage: TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST,
        view_formats: &[],
    });
    let row_bytes = bytes.len() / (ny as usize * nz as usize);
    // Upload parts of a layer if a layer is larger than a slab.
    let rows = (SLAB_BYTES / row_bytes).clamp(1, ny as usize);
    let layers = if rows < ny as usize { 1 } else { (SLAB_BYTES / (row_bytes * rows)).clamp(1, nz as usize) };
    let mut last = None;
    for z in (0..nz).step_by(layers) {
        for y in (0..ny).step_by(rows) {
            let (height, depth) = (rows.min((ny - y) as usize), layers.min((nz - z) as usize));
            let start = (z as usize * ny as usize + y as usize) * row_bytes;
            gpu.queue().write_texture(
                TexelCopyTextureInfo {
                    texture: &texture,
                    mip_level: 0,
                    origin: Origin3d { x: 0, y, z },
                    aspect: TextureAspect::All,
                },
                &bytes[start..start + row_bytes * height * depth],
                TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(row_bytes as u32),
                    rows_per_image: Some(height as u32),
                },
                Extent3d { width: nx, height: height as u32, depth_or_array_layers: depth as u32 },
            );
            // One slab is transferred while the next is copied; never more than one waits.
            let this = gpu.queue().submit([]);
            if let Some(submission_index) = last.replace(this) {
                let wait = PollType::Wait { submission_index: Some(submission_index), timeout: None };
                // Without a timeout only a loss of the device can fail, which the caller finds.
                let _ = gpu.device().poll(wait);
            }
        }
    }
    texture.create_view(&Default::default())
}
