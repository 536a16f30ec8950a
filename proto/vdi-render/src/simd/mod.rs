//! VDI rendering on the processor: a VDI is prepared once and then drawn from any number of cameras.
//!
//! The algorithm is that of [`super::reference`], for eight rays at a time in the vector types of [`lamina_compute::simd`].
//! Neighboring rays cross the same pixels of the VDI: each pixel, list and supersegment is looked up once for all of them.
//!
//! - [`acceleration_grid`]: masks of occupied depth bins for pixels and tiles, and densities of supersegments; [`depth_steps`]:
//!   conversion of depth to steps.
//! - [`ray_setup`]: what all rays of a picture share; [`clip`]: the planes of the visible region; [`packet`]: eight clipped rays as
//!   lines in the VDI's image.
//! - [`mod@picture`]: division of a picture into packets of neighboring rays.
//! - [`dda`]: traversal of tiles and pixels; [`trace`]: skipping of empty ones by their masks; [`composite`]: compositing of a list.
//! - [`cubic`]: the combination of displaced lines.
//!
//! **Agreement.** Rays are clipped in double precision. From there on positions are single precision, relative to the occupied
//! rectangle and to the middle depth, and so are colors and opacities: positions are off by about 1e-6 of the volume, and since
//! neighboring pixels share their boundary as rounded, nothing on the way is left out or counted twice. Tests require every
//! channel within 2e-4 of the oracle's and PSNR above 95 dB. A ray's color depends on the ray alone: not on the rays drawn with
//! it, on threads, on what is skipped, or on the instruction set. A ray that runs exactly in the plane between two pixels or
//! through a pixel's corner (an even r seen from the generation camera by a picture whose pixel centers lie on pixel boundaries)
//! may be assigned to either pixel; both are right, and the two levels may choose differently.

mod acceleration_grid;
mod clip;
mod composite;
mod cubic;
mod dda;
mod depth_steps;
mod packet;
mod picture;
mod ray_setup;
mod trace;

pub(super) use acceleration_grid::AccelerationGrid;
#[cfg(test)]
pub(super) use acceleration_grid::DepthBins;
#[cfg(test)]
pub(super) use depth_steps::DepthSteps;
pub(super) use ray_setup::{homogeneous, margin};

use super::Detail;
use super::reconstruction::sharpness;
use lamina_compute::simd::Level;
use lamina_model::{Camera, Image, Invalid, Vdi};
use picture::{listed, picture};
use ray_setup::RaySetup;
use std::ops::{Deref, Range};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// A VDI with its acceleration grid, built once; it owns, shares or borrows the VDI itself.
#[derive(Debug)]
pub struct PreparedVdi<V: Deref<Target = Vdi> = Arc<Vdi>> {
    vdi: V,
    grid: AccelerationGrid,
    level: Level,
    id: u64,
}

/// What a GPU reads of a [`PreparedVdi`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct PreparedRef<'a> {
    /// The VDI itself.
    pub vdi: &'a Vdi,
    /// The acceleration grid.
    pub grid: &'a AccelerationGrid,
    /// Identity of the prepared VDI, unique within the process.
    pub id: u64,
}

impl<V: Deref<Target = Vdi>> PreparedVdi<V> {
    /// Builds the acceleration grid of `vdi`, in one pass over its supersegments.
    pub fn new(vdi: V) -> Self {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let grid = AccelerationGrid::new(&vdi);
        Self { vdi, grid, level: Level::detect(), id: NEXT.fetch_add(1, Ordering::Relaxed) }
    }

    /// The same VDI, rendered at `level` instead of the best one: all give the same picture.
    pub fn at_level(self, level: Level) -> Self {
        Self { level, ..self }
    }

    /// Borrowed.
    pub(crate) fn by_ref(&self) -> PreparedRef<'_> {
        PreparedRef { vdi: &self.vdi, grid: &self.grid, id: self.id }
    }

    /// The VDI itself.
    pub fn vdi(&self) -> &V {
        &self.vdi
    }

    /// Bytes of the acceleration grid.
    pub fn size_bytes(&self) -> usize {
        self.grid.size_bytes()
    }

    /// Renders the VDI from `camera` with nearest rays. The paper's I.
    ///
    /// # Errors
    /// If the picture's size is out of bounds.
    #[doc(alias = "I")]
    pub fn render(&self, camera: &Camera, width: u32, height: u32) -> Result<Image, Invalid> {
        Image::check_size(width, height)?;
        let colors = self.rows(camera, [width, height], 0..height, Detail::Nearest);
        Image::new(width, height, colors)
    }

    /// Renders some `rows` of a picture of `size` (width, height).
    pub fn rows(&self, camera: &Camera, size: [u32; 2], rows: Range<u32>, detail: Detail) -> Vec<[f32; 3]> {
        picture(self.level, &self.setup(camera, size, detail), size[0], rows)
    }

    /// Renders some `pixels` (column, row) of that picture; returns their colors in order.
    pub fn pixels(&self, camera: &Camera, size: [u32; 2], pixels: &[(u32, u32)], detail: Detail) -> Vec<[f32; 3]> {
        listed(self.level, &self.setup(camera, size, detail), pixels)
    }

    fn setup(&self, camera: &Camera, size: [u32; 2], detail: Detail) -> RaySetup<'_> {
        let sharpness = sharpness(detail, magnification(&self.vdi, camera, size[1]));
        RaySetup::new(&self.vdi, &self.grid, camera, size, sharpness)
    }
}

/// Width of a VDI pixel in pixels of a picture from `camera`, `height` pixels high, at the center of the volume.
pub(super) fn magnification(vdi: &Vdi, camera: &Camera, height: u32) -> f64 {
    let header = vdi.header();
    let pixel = |camera: &Camera, rows: u32| {
        camera.position().distance(header.bounds.center()) * camera.tan_half_fov() / f64::from(rows)
    };
    pixel(&header.camera, vdi.resolution()) / pixel(camera, height)
}

/// Renders `vdi` from `camera` with nearest rays. The paper's I. To render more than once, keep a [`PreparedVdi`].
///
/// # Errors
/// If the picture's size is out of bounds.
#[doc(alias = "I")]
pub fn render(vdi: &Vdi, camera: &Camera, width: u32, height: u32) -> Result<Image, Invalid> {
    PreparedVdi::new(vdi).render(camera, width, height)
}

#[cfg(test)]
mod tests;
