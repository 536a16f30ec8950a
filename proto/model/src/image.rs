//! Pictures in linear floating-point RGB.

use crate::Invalid;

/// A width x height picture, rows from the top, RGB in 0..1.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    width: u32,
    height: u32,
    pixels: Vec<[f32; 3]>,
}

impl Image {
    /// The most pixels per side.
    pub const MAX_SIDE: u32 = 16384;

    /// Checks a picture's size before work starts.
    ///
    /// # Errors
    /// If a side is 0 or above [`Image::MAX_SIDE`].
    pub fn check_size(width: u32, height: u32) -> Result<(), Invalid> {
        let ok = 1..=Self::MAX_SIDE;
        if ok.contains(&width) && ok.contains(&height) {
            return Ok(());
        }
        Err(Invalid::new(
            "image size",
            format!("{width} x {height}: each side must lie in 1..={} pixels", Self::MAX_SIDE),
        ))
    }

    /// A picture from its pixels.
    ///
    /// # Errors
    /// If the size is out of bounds or not that of `pixels`.
    pub fn new(width: u32, height: u32, pixels: Vec<[f32; 3]>) -> Result<Self, Invalid> {
        Self::check_size(width, height)?;
        if pixels.len() != width as usize * height as usize {
            return Err(Invalid::new("image", format!("{} pixels given for {width} x {height}", pixels.len())));
        }
        Ok(Self { width, height, pixels })
    }

    /// Pixels per row.
    pub fn width(&self) -> u32 {
        self.width
    }
    /// Rows.
    pub fn height(&self) -> u32 {
        self.height
    }
    /// All pixels, row by row.
    pub fn pixels(&self) -> &[[f32; 3]] {
        &self.pixels
    }

    /// The pixels as bytes, rounded to 8 bits.
    pub fn to_rgb8(&self) -> Vec<u8> {
        self.pixels.iter().flatten().map(|&c| (c.clamp(0.0, 1.0) * 255.0).round() as u8).collect()
    }
}
