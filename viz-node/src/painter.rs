//! A picture of a recorded step from an orbiting camera, as PNG.

use crate::store::{Store, StoreError};
use lamina_model::{ControlPoint, Image, Invalid};
use lamina_vdi_render::{Backend, Detail, Drawable};
use parking_lot::{Mutex, MutexGuard};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What the page asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orbit {
    /// Turn about the camera's up vector, degrees.
    pub azimuth_deg: f64,
    /// Lift, degrees.
    pub elevation_deg: f64,
    /// Distance divided by this.
    pub zoom: f64,
    /// Side of the picture, pixels.
    pub size: u32,
    /// How carefully it is drawn.
    pub detail: Detail,
}

/// A rendered picture.
#[derive(Debug)]
pub struct PaintedPicture {
    /// The step it shows.
    pub step: u64,
    /// PNG.
    pub png: Vec<u8>,
    /// Wall time of rendering, without PNG.
    pub render_time: Duration,
}

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
pub enum PaintError {
    /// The step cannot be had.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The camera or size cannot be.
    #[error(transparent)]
    Invalid(#[from] Invalid),
}

/// Largest side of a picture for the page.
const MAX_SIZE: u32 = 2048;

/// Draws steps, from anywhere and, where they are volumes, in other colors.
#[derive(Debug)]
pub struct Painter {
    store: Arc<Store>,
    backend: Backend,
    recolored: Mutex<Option<Recolored>>,
}

/// The volume last drawn in other colors: the next picture is likely to be of it, in the same; if it is not in other
/// colors, this is dropped.
#[derive(Debug)]
struct Recolored {
    from: Arc<Drawable>,
    points: Vec<ControlPoint>,
    shown: Arc<Drawable>,
}

impl Painter {
    /// Draws what `store` holds with `backend`.
    pub fn new(store: Arc<Store>, backend: Backend) -> Self {
        Self { store, backend, recolored: Mutex::new(None) }
    }

    /// Draws `step`, under `points` if there are any: they take the place of its transfer function's, and what that leaves
    /// transparent stays so. Nothing, if it is no longer `wanted`.
    ///
    /// # Errors
    /// If the step is not held, the orbit is out of bounds, or there are points and they cannot be used.
    pub fn picture(
        &self,
        step: u64,
        orbit: Orbit,
        points: Option<Vec<ControlPoint>>,
        wanted: impl Fn() -> bool,
    ) -> Result<Option<PaintedPicture>, PaintError> {
        if orbit.size > MAX_SIZE {
            return Err(Invalid::new("size", format!("{} exceeds {MAX_SIZE} pixels", orbit.size)).into());
        }
        let mut shown = self.store.prepared(step)?;
        let camera = shown.camera().orbit(orbit.azimuth_deg, orbit.elevation_deg, orbit.zoom)?;
        let start = Instant::now();
        match points {
            Some(points) => shown = self.recolored(shown, points)?,
            None => *self.last() = None,
        }
        let image = self.backend.render_while(&shown, &camera, [orbit.size; 2], orbit.detail, wanted)?;
        let render_time = start.elapsed();
        image.map(|image| Ok(PaintedPicture { step, png: png(&image)?, render_time })).transpose()
    }

    fn last(&self) -> MutexGuard<'_, Option<Recolored>> {
        self.recolored.lock()
    }

    fn recolored(&self, from: Arc<Drawable>, points: Vec<ControlPoint>) -> Result<Arc<Drawable>, Invalid> {
        let mut last = self.last();
        if let Some(last) = last.as_ref().filter(|l| Arc::ptr_eq(&l.from, &from) && l.points == points) {
            return Ok(last.shown.clone());
        }
        let shown = Arc::new(from.with_points(points.clone())?);
        *last = Some(Recolored { from, points, shown: shown.clone() });
        Ok(shown)
    }
}

/// `image` as an 8-bit RGB PNG.
///
/// # Errors
/// If the encoder fails.
pub fn png(image: &Image) -> Result<Vec<u8>, Invalid> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, image.width(), image.height());
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    let failed = |e: png::EncodingError| Invalid::new("png", e.to_string());
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(&image.to_rgb8()).map_err(failed)?;
    writer.finish().map_err(failed)?;
    Ok(bytes)
}
