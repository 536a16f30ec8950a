//! Arrays of a file and their attributes, read by `hdf5-reader`.

use crate::ReadError;
use crate::arrays::coordinates::{Attributes, coordinates};
use crate::arrays::file::{ArrayStore, MOST_POINTS, check_claim};
use half::f16;
use hdf5_reader::error::{ByteOrder, Error};
use hdf5_reader::group::Group;
use hdf5_reader::messages::datatype::Datatype;
use hdf5_reader::{Attribute, Dataset, H5Type, SliceInfo, SliceInfoElem};
use lamina_model::Voxels;
use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Points along each axis.
pub(super) fn shape(dataset: &Dataset) -> Option<Vec<usize>> {
    dataset.shape().iter().map(|&n| usize::try_from(n).ok()).collect()
}

/// Bytes of a value, if it is a number.
pub(super) fn width(dtype: &Datatype) -> Option<u8> {
    match *dtype {
        Datatype::FixedPoint { size, .. } | Datatype::FloatingPoint { size, .. } => Some(size),
        _ => None,
    }
}

/// All numbers of an array of one axis.
pub(super) fn numbers(dataset: &Dataset) -> Option<Vec<f64>> {
    let [length @ ..=MOST_POINTS] = shape(dataset)?[..] else { return None };
    let voxels = read(dataset, std::slice::from_ref(&(0..length))).ok()?;
    Some(coordinates(&voxels, dataset))
}

impl Attributes for Dataset {
    fn text(&self, name: &str) -> Option<String> {
        self.attribute(name).and_then(|attribute| attribute.read_string()).ok()
    }

    fn numbers(&self, name: &str) -> Vec<f64> {
        self.attribute(name).map(|attribute| attribute_numbers(&attribute)).unwrap_or_default()
    }
}

impl Attributes for Group {
    fn text(&self, name: &str) -> Option<String> {
        self.attribute(name).and_then(|attribute| attribute.read_string()).ok()
    }

    fn numbers(&self, name: &str) -> Vec<f64> {
        self.attribute(name).map(|attribute| attribute_numbers(&attribute)).unwrap_or_default()
    }
}

/// The numbers of an attribute, none if it is no number.
pub(super) fn attribute_numbers(attribute: &Attribute) -> Vec<f64> {
    fn of<T: H5Type + Copy>(attribute: &Attribute, number: impl Fn(T) -> f64) -> Vec<f64> {
        attribute.read_1d::<T>().unwrap_or_default().into_iter().map(number).collect()
    }
    match attribute.datatype {
        Datatype::FloatingPoint { size: 4, .. } => of::<f32>(attribute, f64::from),
        Datatype::FloatingPoint { .. } => of::<f64>(attribute, |v| v),
        Datatype::FixedPoint { size: 1, signed: true, .. } => of::<i8>(attribute, f64::from),
        Datatype::FixedPoint { size: 1, .. } => of::<u8>(attribute, f64::from),
        Datatype::FixedPoint { size: 2, signed: true, .. } => of::<i16>(attribute, f64::from),
        Datatype::FixedPoint { size: 2, .. } => of::<u16>(attribute, f64::from),
        Datatype::FixedPoint { size: 4, signed: true, .. } => of::<i32>(attribute, f64::from),
        Datatype::FixedPoint { size: 4, .. } => of::<u32>(attribute, f64::from),
        Datatype::FixedPoint { signed: true, .. } => of::<i64>(attribute, |v| v as f64),
        Datatype::FixedPoint { .. } => of::<u64>(attribute, |v| v as f64),
        _ => Vec::new(),
    }
}

/// Arrays of a file by their places among those found.
pub(super) struct Datasets {
    pub(super) path: PathBuf,
    pub(super) datasets: Vec<Dataset>,
}

impl fmt::Debug for Datasets {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Datasets").field("path", &self.path).finish_non_exhaustive()
    }
}

impl ArrayStore for Datasets {
    fn read(&self, key: usize, region: &[Range<usize>]) -> Result<Voxels, ReadError> {
        let dataset = &self.datasets[key];
        let count = region.iter().fold(1, |n: u64, range| n.saturating_mul(range.len() as u64));
        check_claim(&self.path, dataset.name(), count.saturating_mul(4))?;
        read(dataset, region).map_err(|error| failed(&self.path, dataset.name(), error))
    }
}

/// What of an array in one piece is read at a time, values: `hdf5-reader` holds them twice meanwhile.
const PART: usize = 1 << 17;

/// A region of an array.
fn values<T: H5Type>(dataset: &Dataset, region: &[Range<usize>]) -> Result<Vec<T>, Error> {
    let read = |region: &[Range<usize>]| {
        let of = |r: &Range<usize>| SliceInfoElem::Slice { start: r.start as u64, end: r.end as u64, step: 1 };
        let selection = SliceInfo { selections: region.iter().map(of).collect() };
        Ok(dataset.read_slice_parallel::<T>(&selection)?.into_raw_vec_and_offset().0)
    };
    let count: usize = region.iter().map(Range::len).product();
    let [slowest, rest @ ..] = region else { return read(region) };
    if dataset.chunks().is_some() || count <= PART {
        return read(region);
    }
    let mut all = Vec::new();
    all.try_reserve_exact(count).map_err(|e| Error::ResourceLimit(e.to_string()))?;
    let thickness = (PART / rest.iter().map(Range::len).product::<usize>()).max(1);
    for start in slowest.clone().step_by(thickness) {
        let part = start..slowest.end.min(start + thickness);
        all.extend(read(&[&[part], rest].concat())?);
    }
    Ok(all)
}

/// A region of an array, a range of each axis, as voxels.
fn read(dataset: &Dataset, region: &[Range<usize>]) -> Result<Voxels, Error> {
    fn doubles<T: H5Type>(dataset: &Dataset, of: &[Range<usize>], double: impl Fn(T) -> f64) -> Result<Voxels, Error> {
        let values = values::<T>(dataset, of)?.into_iter().map(double).collect();
        Ok(Voxels::F64(values))
    }
    let of = region;
    Ok(match *dataset.dtype() {
        Datatype::FloatingPoint { size: 2, .. } => {
            Voxels::F16(values::<Half>(dataset, of)?.into_iter().map(|half| half.0).collect())
        }
        Datatype::FloatingPoint { size: 4, .. } => Voxels::F32(values(dataset, of)?),
        Datatype::FloatingPoint { size: 8, .. } => Voxels::F64(values(dataset, of)?),
        Datatype::FixedPoint { size: 1, signed: false, .. } => Voxels::U8(values(dataset, of)?),
        Datatype::FixedPoint { size: 1, .. } => {
            Voxels::I16(values::<i8>(dataset, of)?.into_iter().map(i16::from).collect())
        }
        Datatype::FixedPoint { size: 2, signed: false, .. } => Voxels::U16(values(dataset, of)?),
        Datatype::FixedPoint { size: 2, .. } => Voxels::I16(values(dataset, of)?),
        Datatype::FixedPoint { size: 4, signed: false, .. } => doubles::<u32>(dataset, of, f64::from)?,
        Datatype::FixedPoint { size: 4, .. } => doubles::<i32>(dataset, of, f64::from)?,
        Datatype::FixedPoint { size: 8, signed: false, .. } => doubles::<u64>(dataset, of, |v| v as f64)?,
        Datatype::FixedPoint { size: 8, .. } => doubles::<i64>(dataset, of, |v| v as f64)?,
        ref other => return Err(Error::UnsupportedEncoding(format!("values of type {other:?}"))),
    })
}

/// A half, which `hdf5-reader` has no type for.
#[derive(Clone, Copy)]
struct Half(f16);

impl H5Type for Half {
    fn hdf5_type() -> Datatype {
        Datatype::FloatingPoint { size: 2, byte_order: ByteOrder::LittleEndian }
    }

    fn from_bytes(bytes: &[u8], dtype: &Datatype) -> Result<Self, Error> {
        let two = *bytes.first_chunk().ok_or_else(|| Error::InvalidData("half a half".into()))?;
        Ok(Self(match dtype {
            Datatype::FloatingPoint { byte_order: ByteOrder::BigEndian, .. } => f16::from_be_bytes(two),
            _ => f16::from_le_bytes(two),
        }))
    }

    fn element_size(_: &Datatype) -> usize {
        2
    }
}

/// What `hdf5-reader` says of an array.
pub(super) fn failed(path: &Path, name: &str, error: Error) -> ReadError {
    let inside = if name.is_empty() { String::new() } else { format!("\"{name}\": ") };
    match error {
        Error::Context { source, .. } => failed(path, name, *source),
        Error::Io(source) => ReadError::while_reading(path, source),
        Error::InvalidMagic => ReadError::damaged(path, "it does not begin as an HDF5 file does"),
        Error::UnsupportedFilter(filter) => {
            let known = "deflate, shuffle, Fletcher-32, szip, LZF, LZ4, Zstandard and Blosc are understood: \
                         pack it anew by h5repack, such as with -f GZIP=4";
            ReadError::unsupported(path, format!("{inside}a filter ({filter})"), known)
        }
        Error::UnsupportedEncoding(what) | Error::ResourceLimit(what) => {
            ReadError::unsupported(path, format!("{inside}{what}"), "write it anew as plain numbers (h5repack)")
        }
        other => ReadError::damaged(path, format!("{inside}{other}")),
    }
}
