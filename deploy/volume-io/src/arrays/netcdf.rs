//! netCDF: classic files (CDF-1, 2 and 5), whose header `netcdf-reader` reads; netCDF-4 is HDF5.

use super::coordinates::{Attributes, coordinates};
use super::described::{DescribedArray, GatheredFields};
use super::file::{ArrayFile, ArrayOptions, ArrayStore, MOST_POINTS};
use super::hdf5;
use crate::ReadError;
use crate::scalars::{ByteOrder, ScalarType};
use lamina_model::Voxels;
use netcdf_reader::classic::{data, header};
use netcdf_reader::{NcAttrValue, NcFormat, NcType, NcVariable};
use std::fs::File;
use std::io::Read;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// First read of a header, and the longest that is tried, bytes.
const FIRST_HEADER: u64 = 1 << 16;
const LONGEST_HEADER: u64 = 1 << 26;

/// Opens a file of either kind.
pub(super) fn open(path: &Path, options: ArrayOptions) -> Result<ArrayFile, ReadError> {
    let system = |e| ReadError::while_reading(path, e);
    let mut start = [0; 4];
    let read = File::open(path).and_then(|mut file| file.read(&mut start)).map_err(system)?;
    let format = match &start[..read] {
        b"CDF\x01" => NcFormat::Classic,
        b"CDF\x02" => NcFormat::Offset64,
        b"CDF\x05" => NcFormat::Cdf5,
        _ => return hdf5::open(path, options),
    };
    let file = Classic::open(path, format)?;
    let mut fields = GatheredFields::default();
    for (key, variable) in file.variables.iter().enumerate() {
        let (Some(shape), Some(scalar)) = (file.shape(variable), scalar(&variable.dtype)) else { continue };
        let stored = DescribedArray {
            name: variable.name.clone(),
            key,
            shape,
            width: scalar.size_bytes() as u8,
            axes: Some(variable.dimensions.iter().map(|dimension| dimension.name.clone()).collect()),
            attributes: variable as &dyn Attributes,
        };
        fields.add(stored, options.axes, |axis| file.points(axis));
    }
    fields.into_file(path, None, file)
}

/// A classic file. Its numbers have the most significant byte first.
#[derive(Debug)]
struct Classic {
    path: PathBuf,
    file: File,
    variables: Vec<NcVariable>,
    /// Records of the axis without limit, and the bytes from one to the next.
    records: u64,
    record_stride: u64,
}

impl Classic {
    fn open(path: &Path, format: NcFormat) -> Result<Self, ReadError> {
        let system = |e| ReadError::while_reading(path, e);
        let file = File::open(path).map_err(system)?;
        let size = file.metadata().map_err(system)?.len();
        let mut length = FIRST_HEADER.min(size);
        let parsed = loop {
            let mut bytes = vec![0; length as usize];
            file.read_exact_at(&mut bytes, 0).map_err(system)?;
            match header::parse_header(&bytes, format) {
                Ok(parsed) => break parsed,
                Err(_) if length < size.min(LONGEST_HEADER) => length = (2 * length).min(size),
                Err(error) => return Err(ReadError::damaged(path, error.to_string())),
            }
        };
        let stride = data::compute_record_stride(&parsed.variables);
        let record_stride = stride.map_err(|error| ReadError::damaged(path, error.to_string()))?;
        // While it is written the count may not be stated; then the file's size tells.
        let first = parsed.variables.iter().filter(|v| v.is_record_var).map(|v| v.data_offset).min();
        let held = first.map_or(0, |first| size.saturating_sub(first).checked_div(record_stride).unwrap_or(0));
        Ok(Self {
            path: path.into(),
            file,
            variables: parsed.variables,
            records: parsed.numrecs.min(held),
            record_stride,
        })
    }

    fn shape(&self, variable: &NcVariable) -> Option<Vec<usize>> {
        let length = |(n, size): (usize, u64)| if variable.is_record_var && n == 0 { self.records } else { size };
        variable.dimensions.iter().map(|d| d.size).enumerate().map(|of| usize::try_from(length(of)).ok()).collect()
    }

    /// The coordinates of an axis: the array of its name.
    fn points(&self, axis: &str) -> Option<Vec<f64>> {
        let key = self.variables.iter().position(|v| v.name == axis && v.dimensions.len() == 1)?;
        let [length @ ..=MOST_POINTS] = self.shape(&self.variables[key])?[..] else { return None };
        let voxels = self.read(key, std::slice::from_ref(&(0..length))).ok()?;
        Some(coordinates(&voxels, &self.variables[key]))
    }
}

impl ArrayStore for Classic {
    fn read(&self, key: usize, region: &[Range<usize>]) -> Result<Voxels, ReadError> {
        let variable = &self.variables[key];
        let wrong = || ReadError::damaged(&self.path, format!("\"{}\" has no values of numbers", variable.name));
        let (scalar, shape) = (scalar(&variable.dtype).ok_or_else(wrong)?, self.shape(variable).ok_or_else(wrong)?);
        let system = |e| ReadError::while_reading(&self.path, e);
        let size = self.file.metadata().map_err(system)?.len();
        let count: usize = region.iter().map(Range::len).product();
        let width = scalar.size_bytes();
        if count as u64 * width > size {
            return Err(ReadError::damaged(&self.path, format!("\"{}\" ends beyond the file", variable.name)));
        }
        let mut voxels = scalar.filled(count, 0.0).map_err(system)?;
        let Some((along, outer)) = region.split_last() else { return Ok(voxels) };
        let mut row = vec![0; along.len() * width as usize];
        let mut at = 0;
        // Rows along the fastest axis, one after the other.
        let rows: usize = outer.iter().map(Range::len).product();
        for n in 0..rows {
            let (mut rest, mut offset, mut stride) =
                (n, along.start as u64 * width, width * shape[shape.len() - 1] as u64);
            for (axis, range) in outer.iter().enumerate().rev() {
                let index = (range.start + rest % range.len()) as u64;
                rest /= range.len();
                let is_record = variable.is_record_var && axis == 0;
                offset += index * if is_record { self.record_stride } else { stride };
                stride *= shape[axis] as u64;
            }
            // An array of one axis may have that one without limit.
            let is_record = variable.is_record_var && shape.len() == 1;
            if is_record {
                for (place, index) in along.clone().enumerate() {
                    let bytes = &mut row[place * width as usize..(place + 1) * width as usize];
                    let at = variable.data_offset + index as u64 * self.record_stride;
                    self.file.read_exact_at(bytes, at).map_err(system)?;
                }
            } else {
                self.file.read_exact_at(&mut row, variable.data_offset + offset).map_err(system)?;
            }
            scalar.decode_at(&mut voxels, at, &row, ByteOrder::Big).map_err(system)?;
            at += along.len();
        }
        Ok(voxels)
    }
}

fn scalar(dtype: &NcType) -> Option<ScalarType> {
    Some(match dtype {
        NcType::Byte => ScalarType::I8,
        NcType::UByte => ScalarType::U8,
        NcType::Short => ScalarType::I16,
        NcType::UShort => ScalarType::U16,
        NcType::Int => ScalarType::I32,
        NcType::UInt => ScalarType::U32,
        NcType::Int64 => ScalarType::I64,
        NcType::UInt64 => ScalarType::U64,
        NcType::Float => ScalarType::F32,
        NcType::Double => ScalarType::F64,
        _ => return None,
    })
}

impl Attributes for NcVariable {
    fn text(&self, name: &str) -> Option<String> {
        self.attributes.iter().find(|attribute| attribute.name == name)?.value.as_string()
    }

    fn numbers(&self, name: &str) -> Vec<f64> {
        fn all<T: Copy>(values: &[T], number: impl Fn(T) -> f64) -> Vec<f64> {
            values.iter().map(|&value| number(value)).collect()
        }
        match self.attributes.iter().find(|attribute| attribute.name == name).map(|attribute| &attribute.value) {
            Some(NcAttrValue::Bytes(v)) => all(v, f64::from),
            Some(NcAttrValue::UBytes(v)) => all(v, f64::from),
            Some(NcAttrValue::Shorts(v)) => all(v, f64::from),
            Some(NcAttrValue::UShorts(v)) => all(v, f64::from),
            Some(NcAttrValue::Ints(v)) => all(v, f64::from),
            Some(NcAttrValue::UInts(v)) => all(v, f64::from),
            Some(NcAttrValue::Int64s(v)) => all(v, |v| v as f64),
            Some(NcAttrValue::UInt64s(v)) => all(v, |v| v as f64),
            Some(NcAttrValue::Floats(v)) => all(v, f64::from),
            Some(NcAttrValue::Doubles(v)) => all(v, |v| v),
            _ => Vec::new(),
        }
    }
}
