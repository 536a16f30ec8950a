//! Writers of the files that [`Series`](crate::Series) reads back, in the plainest form that ParaView opens too.

use crate::ReadError;
use crate::error::invalid;
use crate::pvd::check_order;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use lamina_model::{Volume, VoxelType, Voxels};
use quick_xml::escape::escape;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Bytes packed at a time: large enough for zlib to find its matches.
const BLOCK_BYTES: usize = 1 << 18;

/// Writes `volume` as VTK image data, its scalars a point array named `field`, a second field one more: zlib blocks, appended
/// raw, little-endian. What is packed is held in memory until all is.
///
/// # Errors
/// If the file cannot be written, or both fields have one name.
pub fn write_vti(path: &Path, volume: &Volume, field: &str) -> Result<(), ReadError> {
    image_data(path, volume, field).map_err(|source| ReadError::Write { path: path.into(), source })
}

/// Writes a collection of steps: a time and a file name relative to the collection, for each.
///
/// # Errors
/// If there are no steps, their times do not ascend, or the file cannot be written.
pub fn write_pvd(path: &Path, entries: &[(f64, String)]) -> Result<(), ReadError> {
    check_order(path, entries)?;
    let mut text = String::from(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"0.1\" byte_order=\"LittleEndian\">\n  <Collection>\n",
    );
    for (time, file) in entries {
        let file = escape(file.as_str());
        text += &format!("    <DataSet timestep=\"{time:?}\" group=\"\" part=\"0\" file=\"{file}\"/>\n");
    }
    text += "  </Collection>\n</VTKFile>\n";
    fs::write(path, text).map_err(|source| ReadError::Write { path: path.into(), source })
}

fn image_data(path: &Path, volume: &Volume, field: &str) -> io::Result<()> {
    let second = volume.color_field();
    if second.is_some_and(|(name, _)| name == field) {
        return Err(invalid(format!("two arrays cannot both be called \"{field}\"")));
    }
    let mut arrays = String::new();
    let mut data = Vec::new();
    for (name, voxels) in std::iter::once((field, volume.voxels())).chain(second) {
        let (name, kind, offset) = (escape(name), kind(voxels.voxel_type())?, data.len());
        arrays +=
            &format!("\n        <DataArray type=\"{kind}\" Name=\"{name}\" format=\"appended\" offset=\"{offset}\"/>");
        pack(voxels, &mut data)?;
    }
    let mut file = BufWriter::new(File::create(path)?);
    file.write_all(header(volume, field, &arrays).as_bytes())?;
    file.write_all(&data)?;
    file.write_all(b"\n  </AppendedData>\n</VTKFile>\n")?;
    file.flush()
}

/// Appends `voxels` in zlib blocks, with the table of their sizes before them.
fn pack(voxels: &Voxels, out: &mut Vec<u8>) -> io::Result<()> {
    let size = voxels.voxel_type().size_bytes();
    let (block, count) = (BLOCK_BYTES / size, voxels.len());
    let blocks = count.div_ceil(block);
    let table_at = out.len();
    for n in [blocks, block * size, count % block * size] {
        out.extend((n as u64).to_le_bytes());
    }
    out.resize(out.len() + 8 * blocks, 0);
    for index in 0..blocks {
        let start = out.len();
        let mut zlib = ZlibEncoder::new(&mut *out, Compression::default());
        zlib.write_all(&voxels.to_le_bytes(index * block..count.min((index + 1) * block)))?;
        zlib.finish()?;
        let packed = (out.len() - start) as u64;
        out[table_at + 24 + 8 * index..][..8].copy_from_slice(&packed.to_le_bytes());
    }
    Ok(())
}

fn kind(voxel_type: VoxelType) -> io::Result<&'static str> {
    Ok(match voxel_type {
        VoxelType::U8 => "UInt8",
        VoxelType::U16 => "UInt16",
        VoxelType::I16 => "Int16",
        VoxelType::F16 => return Err(invalid("VTK knows no 16-bit floats; write float32")),
        VoxelType::F32 => "Float32",
        VoxelType::F64 => "Float64",
    })
}

fn header(volume: &Volume, field: &str, arrays: &str) -> String {
    let grid = volume.grid();
    let [x, y, z] = grid.dims().map(|n| n - 1);
    let extent = format!("0 {x} 0 {y} 0 {z}");
    let [origin, spacing] = [grid.origin(), grid.spacing()].map(|v| format!("{:?} {:?} {:?}", v.x, v.y, v.z));
    let field = escape(field);
    format!(
        r#"<?xml version="1.0"?>
<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64" compressor="vtkZLibDataCompressor">
  <ImageData WholeExtent="{extent}" Origin="{origin}" Spacing="{spacing}">
    <Piece Extent="{extent}">
      <PointData Scalars="{field}">{arrays}
      </PointData>
    </Piece>
  </ImageData>
  <AppendedData encoding="raw">
   _"#
    )
}
