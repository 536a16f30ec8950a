//! The writer of VTKHDF image data. The format: <https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/index.html>.

use crate::ReadError;
use crate::error::invalid;
use hdf5_writer::{
    AttributeBuilder, DatasetBuilder, Error, FilterDescription, H5WriteElement, Hdf5Builder, Hdf5Writer, WriteOptions,
};
use lamina_model::{Volume, Voxels};
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Points of a chunk along each axis, which is packed by itself.
const CHUNK: u64 = 64;

/// HDF5's numbers of the filters, and how much deflate tries.
const SHUFFLE: u16 = 2;
const DEFLATE: u16 = 1;
const LEVEL: u32 = 4;

/// Writes `volume` as VTKHDF image data, its scalars a point array named `field`, a second field one more: shuffled and deflated in
/// chunks. All of it is held in memory once more. Halves become single precision.
///
/// # Errors
/// If the file cannot be written, or both fields have one name.
pub fn write_vtkhdf(path: &Path, volume: &Volume, field: &str) -> Result<(), ReadError> {
    let write = || -> io::Result<()> {
        let plan = plan(volume, field)?.into_plan().map_err(said)?;
        let sink = BufWriter::new(File::create(path)?);
        Hdf5Writer::new(sink, WriteOptions::default()).finish(plan).map_err(said)?.flush()
    };
    write().map_err(|source| ReadError::Write { path: path.into(), source })
}

fn said(error: Error) -> io::Error {
    invalid(error.to_string())
}

fn plan(volume: &Volume, field: &str) -> io::Result<Hdf5Builder> {
    let second = volume.color_field();
    if second.is_some_and(|(name, _)| name == field) {
        return Err(invalid(format!("two arrays cannot both be called \"{field}\"")));
    }
    let grid = volume.grid();
    let [nx, ny, nz] = grid.dims().map(|n| n as u64);
    let extent = [0, nx as i64 - 1, 0, ny as i64 - 1, 0, nz as i64 - 1];
    let mut builder = Hdf5Builder::new();
    for attribute in [
        AttributeBuilder::vector("Version", &[2i64, 0]),
        AttributeBuilder::vector("WholeExtent", &extent),
        AttributeBuilder::vector("Origin", &grid.origin().to_array()),
        AttributeBuilder::vector("Spacing", &grid.spacing().to_array()),
        AttributeBuilder::vector("Direction", &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
    ] {
        builder = builder.group_attribute("VTKHDF", attribute.map_err(said)?);
    }
    builder = builder.group_attribute("VTKHDF", AttributeBuilder::fixed_string("Type", "ImageData"));
    builder = builder.group_attribute("VTKHDF/PointData", AttributeBuilder::fixed_string("Scalars", name(field)));
    for (field, voxels) in std::iter::once((field, volume.voxels())).chain(second) {
        let path = format!("VTKHDF/PointData/{}", name(field));
        let shape = [nz, ny, nx];
        let array = match voxels {
            Voxels::U8(v) => array(path, shape, v),
            Voxels::U16(v) => array(path, shape, v),
            Voxels::I16(v) => array(path, shape, v),
            Voxels::F16(v) => array(path, shape, &v.iter().map(|half| half.to_f32()).collect::<Vec<f32>>()),
            Voxels::F32(v) => array(path, shape, v),
            Voxels::F64(v) => array(path, shape, v),
        };
        builder = builder.dataset(array.map_err(said)?);
    }
    Ok(builder)
}

/// A name without what separates groups.
fn name(field: &str) -> String {
    field.replace('/', ".")
}

fn array<T: H5WriteElement>(path: String, shape: [u64; 3], values: &[T]) -> Result<DatasetBuilder, Error> {
    let filter = |id, client_data| FilterDescription { id, name: None, client_data };
    let array = DatasetBuilder::typed_data(path, shape, values)?;
    let chunked = array.chunked(shape.map(|n| n.min(CHUNK)));
    Ok(chunked.filter(filter(SHUFFLE, vec![size_of::<T>() as u32])).filter(filter(DEFLATE, vec![LEVEL])))
}
