//! A field on the device: voxels as raw bits, the empty-space map, and transfer function tables for the step lengths in use.

use super::error::GpuError;
use super::layout::VolumeUniforms;
use crate::Field;
use crate::volume::stored::StoredVoxels;
use crate::volume::transfer_lut::TransferLut;
use half::slice::HalfFloatSliceExt;
use lamina_compute::gpu::Gpu;
use lamina_compute::gpu::wgpu::{
    Buffer, BufferUsages, Extent3d, Origin3d, PollType, TexelCopyBufferLayout, TexelCopyTextureInfo, TextureAspect,
    TextureDescriptor, TextureDimension, TextureFormat, TextureUsages, TextureView,
};

/// Storage of voxels; the shader's KIND.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub(super) enum VoxelKind {
    Whole,
    Half,
    Single,
}

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
    pub step_length: f64,
    /// Bins of the range, and rows before it.
    pub bins: u32,
    pub below: u32,
    /// Positions between which the function is not transparent.
    pub visible: [f32; 2],
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
        let (kind, format, bytes): (_, _, &[u8]) = match field.stored() {
            StoredVoxels::U8(v) => (VoxelKind::Whole, TextureFormat::R8Uint, v),
            StoredVoxels::U16(v) => (VoxelKind::Whole, TextureFormat::R16Uint, bytemuck::cast_slice(v)),
            StoredVoxels::F16(v) => {
                (VoxelKind::Half, TextureFormat::R16Uint, bytemuck::cast_slice(v.reinterpret_cast()))
            }
            StoredVoxels::F32(v) => (VoxelKind::Single, TextureFormat::R32Uint, bytemuck::cast_slice(v)),
        };
        let mut distances = field.empty_space().distances().to_vec();
        distances.resize(distances.len().next_multiple_of(4), 0);
        Self {
            id: field.id(),
            kind,
            voxels: voxels(gpu, field.grid().dims().map(|d| d as u32), format, bytes),
            volume: gpu.upload("volume", bytemuck::bytes_of(&volume(field)), BufferUsages::UNIFORM),
            distances: gpu.upload("distances", &distances, BufferUsages::STORAGE),
            light: gpu.upload("light", bytemuck::cast_slice(&super::effects::light(field)), BufferUsages::STORAGE),
            colors: colors(gpu, field),
            tables: Vec::new(),
        }
    }

    /// The tables for `step_length`, created at first use.
    pub(super) fn tables(&mut self, gpu: &Gpu, field: &Field, step_length: f64) -> ResidentTables {
        if let Some(t) = self.tables.iter().find(|t| t.step_length == step_length) {
            return t.clone();
        }
        let table = TransferLut::new(&field.scene().transfer, field.unit_length(), step_length);
        let upload = |label, bytes| gpu.upload(label, bytes, BufferUsages::STORAGE);
        let tables = ResidentTables {
            step_length,
            bins: table.bins() as u32,
            below: table.below,
            // Shaders may not support infinity.
            visible: field.scene().transfer.visible_hull().map(|u| u.clamp(f32::MIN, f32::MAX)),
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

fn volume(field: &Field) -> VolumeUniforms {
    let dims = field.grid().dims();
    // As Grid::bounds: an axis with one sample point is drawn one spacing thick.
    let low = dims.map(|d| if d == 1 { -0.5 } else { 0.0 });
    let high = dims.map(|d| if d == 1 { 0.5 } else { (d - 1) as f32 });
    let (scale, offset) = field.unit_from_stored();
    VolumeUniforms {
        last: dims.map(|d| (d - 1) as u32),
        pad0: 0,
        bricks: field.empty_space().dims().map(|d| d as u32),
        pad1: 0,
        low,
        scale: scale as f32,
        high,
        offset: offset as f32,
    }
}

fn colors(gpu: &Gpu, field: &Field) -> TextureView {
    let format = TextureFormat::R32Uint;
    match field.effects().and_then(|e| e.colors.as_ref()) {
        None => voxels(gpu, [1; 3], format, &[0; 4]),
        Some(colors) => voxels(gpu, field.grid().dims().map(|d| d as u32), format, bytemuck::cast_slice(&colors.units)),
    }
}

fn voxels(gpu: &Gpu, [nx, ny, nz]: [u32; 3], format: TextureFormat, bytes: &[u8]) -> TextureView {
    let texture = gpu.device().create_texture(&TextureDescriptor {
        label: Some("voxels"),
        size: Extent3d { width: nx, height: ny, depth_or_array_layers: nz },
        mip_level_count: 1,
        sample_count: 1,
        dimension: TextureDimension::D3,
        format,
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
