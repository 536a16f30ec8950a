//! The WGSL kernel and all that it reads, as bytes: for this crate's host code ([`crate::gpu`]) and for devices opened elsewhere,
//! as a browser's ([`VdiKernel`]).

pub(crate) mod layout;
pub(crate) mod view;

use crate::reconstruction::sharpness;
use crate::simd::{AccelerationGrid, PreparedRef, magnification};
use crate::{Detail, PreparedVdi};
use bytemuck::cast_slice;
use lamina_compute::kernel::Binding;
use lamina_model::{Camera, Vdi};
use layout::{PictureUniforms, StoredVdi, ViewUniforms};
use rayon::prelude::*;
use std::ops::Deref;

/// Source of all kernels.
pub(crate) const RENDER: &str = concat!(
    include_str!("layout.wgsl"),
    include_str!("leaf.wgsl"),
    include_str!("line.wgsl"),
    include_str!("composite.wgsl"),
    include_str!("dda.wgsl"),
    include_str!("render.wgsl"),
    include_str!("../../../compute/src/gpu/color_pass.wgsl")
);

/// Pictures of VDIs, drawn by a device that the caller drives.
///
/// [`Self::SOURCE`] has the entry point `color_rows` in workgroups of 8 x 8 pixels. Group 0 is what [`Self::arrays`] and
/// [`Self::view`] give; group 1 is [`Self::band`], a storage buffer of at least one word that is not read, and the colors that
/// are written: red, green and blue of each pixel of the band, single precision. A VDI without content has no arrays, and its
/// pictures are its background.
#[derive(Debug, Clone, Copy)]
pub struct VdiKernel;

impl VdiKernel {
    /// WGSL.
    pub const SOURCE: &'static str = RENDER;

    /// The resources that no camera changes; none for a VDI without content.
    pub fn arrays<V: Deref<Target = Vdi>>(vdi: &PreparedVdi<V>) -> Vec<Binding<'_>> {
        if Self::is_visible(vdi) { arrays(vdi.by_ref()).into() } else { Vec::new() }
    }

    /// False for a VDI without content.
    pub fn is_visible<V: Deref<Target = Vdi>>(vdi: &PreparedVdi<V>) -> bool {
        let [near, far] = vdi.by_ref().grid.depths;
        near < far
    }

    /// The rays of a picture from `camera`, `width` x `height` pixels.
    pub fn view<V: Deref<Target = Vdi>>(
        vdi: &PreparedVdi<V>,
        camera: &Camera,
        width: u32,
        height: u32,
        detail: Detail,
    ) -> Binding<'static> {
        Binding::uniform(0, 1, &view_uniforms(vdi.by_ref(), camera, [width, height], detail))
    }

    /// The band of `rows` rows from row `first` on.
    pub fn band(first: u32, rows: u32) -> Binding<'static> {
        Binding::uniform(1, 0, &PictureUniforms { first, count: rows, pad0: [0; 2] })
    }
}

/// The rays of a picture.
pub(crate) fn view_uniforms(prepared: PreparedRef, camera: &Camera, size: [u32; 2], detail: Detail) -> ViewUniforms {
    let sharpness = sharpness(detail, magnification(prepared.vdi, camera, size[1]));
    ViewUniforms::new(prepared.vdi, prepared.grid, camera, size, sharpness)
}

/// The arrays of a VDI with content, in the order of their bindings.
pub(crate) fn arrays(PreparedRef { vdi, grid, .. }: PreparedRef<'_>) -> [Binding<'_>; 6] {
    let masks: Vec<u64> = grid.masks.iter().flatten().copied().collect();
    let ends: Vec<[u32; 2]> = vdi.segments().par_iter().map(|s| [s.start, s.end]).collect();
    [
        Binding::uniform(0, 0, &stored(vdi, grid)),
        Binding::storage(0, 2, cast_slice(&grid.slots)),
        Binding::storage(0, 3, cast_slice(&grid.spans)),
        // Little-endian, so the lower word comes first.
        Binding::storage(0, 4, cast_slice(&masks).to_vec()),
        Binding::storage(0, 5, cast_slice(&ends).to_vec()),
        Binding::storage(0, 6, cast_slice(&contents(vdi, grid)).to_vec()),
    ]
}

/// Rounding error of positions on the scale of depth bins, in bins, besides the part that grows with the volume's extent.
const MARGIN: f64 = 2e-3;
/// Relative rounding error of depths, in units of the box.
const ROUNDING: f64 = 4e-6;

fn stored(vdi: &Vdi, grid: &AccelerationGrid) -> StoredVdi {
    let [near, far] = grid.depths;
    // The depth bins end at a quarter of the farthest depth, as in `DepthBins::new`.
    let thickness = far - near.max(0.25 * far);
    let lost = 64.0 * ROUNDING * vdi.header().bounds.size().length() / thickness;
    let tiles = |level: usize| grid.masks[level].len() as u32;
    StoredVdi {
        size: grid.size,
        first_masks: [tiles(0), tiles(0) + tiles(1)],
        depth: grid.middle as f32,
        far: (far - grid.middle) as f32,
        depth_bins: (grid.depth_bins.per_inverse_depth * grid.depth_bins.far) as f32,
        // A margin of 64 bins disables skipping.
        margin: (MARGIN + lost).clamp(MARGIN, 64.0) as f32,
    }
}

/// Colors and densities (optical depth per step).
fn contents(vdi: &Vdi, grid: &AccelerationGrid) -> Vec<[f32; 4]> {
    let both = vdi.segments().par_iter().zip(&grid.densities);
    both.map(|(s, &density)| [s.color[0], s.color[1], s.color[2], density]).collect()
}
