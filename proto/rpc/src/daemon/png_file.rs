//! Pictures as PNG, which viz-nodes serve and generator-nodes keep.

use lamina_model::{Image, Invalid};

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
