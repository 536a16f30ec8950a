//! Pictures in files: 8-bit PNG, and PFM (Portable FloatMap) for float.

use anyhow::{Context, bail, ensure};
use lamina_model::Image;
use std::fs;
use std::path::Path;

/// Passes a name that pictures can be written to: to be asked before work begins.
pub(crate) fn check(path: &Path) -> anyhow::Result<()> {
    let extension = extension(path);
    ensure!(matches!(extension.as_str(), "png" | "pfm"), unwritable(path, &extension));
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).is_none_or(Path::is_dir);
    ensure!(folder, "{}: cannot be written: its folder is not there", path.display());
    Ok(())
}

fn unwritable(path: &Path, extension: &str) -> String {
    let kind =
        if extension.is_empty() { "a picture without an ending".to_owned() } else { format!("\".{extension}\"") };
    format!("{}: cannot write {kind}; name a .png or .pfm file", path.display())
}

/// Writes `image` as its file name's ending says.
pub(crate) fn write(path: &Path, image: &Image) -> anyhow::Result<()> {
    let bytes = match extension(path).as_str() {
        "png" => lamina_rpc::daemon::png(image)?,
        "pfm" => pfm(image),
        other => bail!(unwritable(path, other)),
    };
    fs::write(path, bytes).with_context(|| format!("{}: cannot be written", path.display()))
}

/// Reads a PNG or PFM.
pub(crate) fn read(path: &Path) -> anyhow::Result<Image> {
    let bytes = fs::read(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    let image = match extension(path).as_str() {
        "png" => from_png(&bytes),
        "pfm" => from_pfm(&bytes),
        other => bail!("{}: cannot read \".{other}\"; name a .png or .pfm file", path.display()),
    };
    image.with_context(|| format!("{}: not a whole picture", path.display()))
}

fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

/// Color, little-endian (scale -1), rows from the bottom.
fn pfm(image: &Image) -> Vec<u8> {
    let mut bytes = format!("PF\n{} {}\n-1.0\n", image.width(), image.height()).into_bytes();
    for row in image.pixels().chunks_exact(image.width() as usize).rev() {
        bytes.extend(row.iter().flatten().flat_map(|c| c.to_le_bytes()));
    }
    bytes
}

fn from_pfm(bytes: &[u8]) -> anyhow::Result<Image> {
    let mut lines = bytes.splitn(4, |&b| b == b'\n');
    let mut line = || lines.next().and_then(|l| std::str::from_utf8(l).ok()).context("header cut short");
    ensure!(line()?.trim() == "PF", "not a color PFM");
    let size: Vec<u32> = line()?.split_whitespace().map(str::parse).collect::<Result<_, _>>()?;
    let &[width, height] = size.as_slice() else { bail!("its second line must be width and height") };
    let little: bool = line()?.trim().parse::<f64>()? < 0.0;
    Image::check_size(width, height)?;
    let data = lines.next().unwrap_or_default();
    ensure!(
        data.len() == 12 * width as usize * height as usize,
        "{} bytes of pixels for {width} x {height}",
        data.len()
    );
    let float = |b: &[u8]| {
        let b = [b[0], b[1], b[2], b[3]];
        if little { f32::from_le_bytes(b) } else { f32::from_be_bytes(b) }
    };
    let pixel = |p: &[u8]| [float(&p[0..4]), float(&p[4..8]), float(&p[8..12])];
    let rows = data.chunks_exact(12 * width as usize).rev();
    let pixels: Vec<[f32; 3]> = rows.flat_map(|row| row.chunks_exact(12).map(pixel)).collect();
    ensure!(pixels.iter().flatten().all(|c| c.is_finite()), "pixels that are not finite");
    Ok(Image::new(width, height, pixels)?)
}

fn from_png(bytes: &[u8]) -> anyhow::Result<Image> {
    let mut decoder = png::Decoder::new_with_limits(std::io::Cursor::new(bytes), png::Limits { bytes: 1 << 30 });
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info()?;
    let mut data = vec![0; reader.output_buffer_size().context("too large")?];
    let info = reader.next_frame(&mut data)?;
    let channels = info.color_type.samples();
    let unit = |v: u8| f32::from(v) / 255.0;
    let pixel = |p: &[u8]| if channels < 3 { [unit(p[0]); 3] } else { [unit(p[0]), unit(p[1]), unit(p[2])] };
    let pixels = data[..info.buffer_size()].chunks_exact(channels).map(pixel).collect();
    Ok(Image::new(info.width, info.height, pixels)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn float_pictures_come_back_exactly_and_png_to_eight_bits() {
        let pixels = (0..6).map(|i| [i as f32 / 7.0, 0.25, 1.0]).collect();
        let image = Image::new(3, 2, pixels).unwrap();
        assert_eq!(from_pfm(&pfm(&image)).unwrap(), image);
        let back = from_png(&lamina_rpc::daemon::png(&image).unwrap()).unwrap();
        assert!(lamina_model::psnr(&back, &image).unwrap() > 50.0);
        assert!(from_pfm(&pfm(&image)[..40]).is_err() && from_png(b"no").is_err());
    }
}
