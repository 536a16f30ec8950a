//! TIFF stacks: each page is a plane of the volume, the first at z = 0.

use super::axes::AxisRole;
use super::coordinates::Placement;
use super::file::{ArrayFile, ArrayOptions, ArrayStore, FieldArray, check_claim};
use crate::ReadError;
use crate::missing::Meaning;
use crate::scalars::{ByteOrder, ScalarType};
use crate::vti::UNNAMED_FIELD;
use lamina_model::Voxels;
use std::fs::File;
use std::io::BufReader;
use std::ops::Range;
use std::path::{Path, PathBuf};
use tiff::decoder::ifd::Value;
use tiff::decoder::{Decoder, Limits};
use tiff::tags::{SampleFormat, Tag};
use tiff::{ColorType, TiffError};

/// Pages of a stack, at most.
const MOST_PAGES: usize = 1 << 16;

type Pages = Decoder<BufReader<File>>;

/// Opens a stack.
pub(super) fn open(path: &Path, _: ArrayOptions) -> Result<ArrayFile, ReadError> {
    let failed = |error| failed(path, error);
    let mut pages = decoder(path)?;
    let (width, height) = pages.dimensions().map_err(failed)?;
    let scalar = scalar(path, &mut pages)?;
    let description = pages.get_tag_ascii_string(Tag::ImageDescription).unwrap_or_default();
    // ImageJ states lines of NAME=VALUE.
    let stated = |name: &str| {
        let of = |line: &str| line.trim().strip_prefix(name)?.strip_prefix('=')?.parse::<f64>().ok();
        description.lines().find_map(of).filter(|_| description.starts_with("ImageJ="))
    };
    let mut count = 1;
    while pages.more_images() {
        pages.next_image().map_err(failed)?;
        count += 1;
        if count > MOST_PAGES {
            return Err(ReadError::damaged(path, format!("more than {MOST_PAGES} pages")));
        }
    }
    if let Some(images) = stated("images").filter(|&images| images > count as f64) {
        let what = format!("a stack of {images} images in {count} pages, as ImageJ writes those above 4 GB,");
        return Err(ReadError::unsupported(path, what, "write it as BigTIFF, each plane a page"));
    }
    let bytes = u64::from(width) * u64::from(height) * scalar.size_bytes();
    check_claim(path, UNNAMED_FIELD, bytes.saturating_mul(count as u64))?;
    let frames = match (stated("channels"), stated("frames").unwrap_or(1.0)) {
        (Some(channels), _) if channels > 1.0 => {
            let what = format!("a stack of {channels} channels");
            return Err(ReadError::unsupported(path, what, "write each channel to a file of its own"));
        }
        (_, frames) if frames >= 1.0 && count % frames as usize == 0 => frames as usize,
        _ => return Err(ReadError::damaged(path, "its pages are no multiple of its frames")),
    };
    // Of ImageJ the resolution is that of the unit in which the planes' distance is stated.
    let mut pixels = |tag| pages.find_tag(tag).ok().flatten().and_then(ratio).filter(|_| stated("spacing").is_some());
    let [x, y] = [Tag::XResolution, Tag::YResolution].map(|tag| pixels(tag).map_or(1.0, |per_unit| 1.0 / per_unit));
    let depth = stated("spacing").map(f64::abs).filter(|spacing| *spacing > 0.0).unwrap_or(1.0);
    let field = FieldArray {
        name: UNNAMED_FIELD.into(),
        key: 0,
        shape: vec![frames, count / frames, height as usize, width as usize],
        roles: vec![AxisRole::Time, AxisRole::Z, AxisRole::Y, AxisRole::X],
        placement: [x, y, depth].map(|spacing| Placement::even_from(0.0, spacing)),
        meaning: Meaning::default(),
    };
    ArrayFile::new(
        path,
        None,
        vec![field],
        Stack { path: path.into(), scalar, page: [width, height], slices: count / frames },
    )
}

fn decoder(path: &Path) -> Result<Pages, ReadError> {
    let file = File::open(path).map_err(|e| ReadError::while_reading(path, e))?;
    let mut limits = Limits::default();
    // A page of 16,384 x 16,384 values of 4 bytes.
    limits.decoding_buffer_size = 1 << 30;
    limits.intermediate_buffer_size = 1 << 30;
    limits.ifd_value_size = 1 << 26;
    Ok(Decoder::new(BufReader::new(file)).map_err(|error| failed(path, error))?.with_limits(limits))
}

/// What the pages hold: one value at a point.
fn scalar(path: &Path, pages: &mut Pages) -> Result<ScalarType, ReadError> {
    let color = pages.colortype().map_err(|error| failed(path, error))?;
    let ColorType::Gray(bits) = color else {
        return Err(ReadError::unsupported(path, format!("a page of {color:?}"), "write one value at a point (gray)"));
    };
    let format =
        pages.find_tag_unsigned::<u16>(Tag::SampleFormat).ok().flatten().map(SampleFormat::from_u16_exhaustive);
    Ok(match (format.unwrap_or(SampleFormat::Uint), bits) {
        (SampleFormat::Uint, 8) => ScalarType::U8,
        (SampleFormat::Uint, 16) => ScalarType::U16,
        (SampleFormat::Uint, 32) => ScalarType::U32,
        (SampleFormat::Int, 8) => ScalarType::I8,
        (SampleFormat::Int, 16) => ScalarType::I16,
        (SampleFormat::Int, 32) => ScalarType::I32,
        (SampleFormat::IEEEFP, 16) => ScalarType::F16,
        (SampleFormat::IEEEFP, 32) => ScalarType::F32,
        (SampleFormat::IEEEFP, 64) => ScalarType::F64,
        (format, bits) => {
            let what = format!("a page of {bits} bits, {format:?}");
            return Err(ReadError::unsupported(path, what, "write 8, 16 or 32 bits, or floating point"));
        }
    })
}

#[derive(Debug)]
struct Stack {
    path: PathBuf,
    scalar: ScalarType,
    /// Width and height.
    page: [u32; 2],
    /// Planes of a step.
    slices: usize,
}

impl ArrayStore for Stack {
    fn read(&self, _: usize, region: &[Range<usize>]) -> Result<Voxels, ReadError> {
        let failed = |error| failed(&self.path, error);
        let mut pages = decoder(&self.path)?;
        let points = self.page[0] as usize * self.page[1] as usize;
        let system = |e| ReadError::while_reading(&self.path, e);
        let mut voxels = self.scalar.filled(points * region[1].len(), 0.0).map_err(system)?;
        let start = region[0].start * self.slices;
        let planes = start + region[1].start..start + region[1].end;
        let mut bytes = vec![0; points * self.scalar.size_bytes() as usize];
        for page in 0..planes.end {
            if page > 0 {
                pages.next_image().map_err(failed)?;
            }
            if page < planes.start {
                continue;
            }
            let dimensions: [u32; 2] = pages.dimensions().map_err(failed)?.into();
            if dimensions != self.page || scalar(&self.path, &mut pages)? != self.scalar {
                let reason = format!("page {page} is not of the size and type of page 0");
                return Err(ReadError::damaged(&self.path, reason));
            }
            pages.read_image_bytes(&mut bytes).map_err(failed)?;
            let at = points * (page - planes.start);
            self.scalar.decode_at(&mut voxels, at, &bytes, NATIVE).map_err(system)?;
        }
        Ok(voxels)
    }
}

/// The number that a ratio is, if it is one.
fn ratio(value: Value) -> Option<f64> {
    let Value::Rational(of, by) = value else { return None };
    let number = f64::from(of) / f64::from(by);
    (number.is_finite() && number > 0.0).then_some(number)
}

const NATIVE: ByteOrder = if cfg!(target_endian = "big") { ByteOrder::Big } else { ByteOrder::Little };

fn failed(path: &Path, error: TiffError) -> ReadError {
    match error {
        TiffError::IoError(source) => ReadError::while_reading(path, source),
        TiffError::UnsupportedError(what) => {
            ReadError::unsupported(path, what.to_string(), "write it plain, or packed by deflate or LZW")
        }
        TiffError::LimitsExceeded => ReadError::unsupported(path, "a page above 1 GiB", "write smaller pages"),
        other => ReadError::damaged(path, other.to_string()),
    }
}
