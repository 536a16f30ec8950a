//! A picture of a recorded step from an orbiting camera, as PNG.

use crate::kernel::Backend;
use crate::store::{Store, StoreError};
use lamina_model::{Image, Invalid};
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
}

/// A rendered picture.
pub struct Picture {
    /// The step it shows.
    pub step: u64,
    /// PNG.
    pub png: Vec<u8>,
    /// Wall time of rendering, without PNG.
    pub render_time: Duration,
}

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// The step cannot be had.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The camera or size cannot be.
    #[error(transparent)]
    Invalid(#[from] Invalid),
}

/// Largest side of a picture for the page.
const MAX_SIZE: u32 = 2048;

/// Draws `step` of `store` with `backend`.
///
/// # Errors
/// If the step is not held, or the orbit is out of bounds.
pub fn picture(store: &Store, backend: &Backend, step: u64, orbit: Orbit) -> Result<Picture, ViewError> {
    if orbit.size > MAX_SIZE {
        return Err(Invalid::new("size", format!("{} exceeds {MAX_SIZE} pixels", orbit.size)).into());
    }
    let shown = store.prepared(step)?;
    let camera = shown.camera().orbit(orbit.azimuth_deg, orbit.elevation_deg, orbit.zoom)?;
    let start = Instant::now();
    let image = backend.show(&shown, &camera, orbit.size, orbit.size)?;
    let render_time = start.elapsed();
    Ok(Picture { step, png: png(&image)?, render_time })
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
