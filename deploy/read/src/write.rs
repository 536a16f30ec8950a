//! Writers of the files that [`Series`](crate::Series) reads back, in the plainest form that ParaView opens too.

use crate::ReadError;
use crate::error::invalid;
use crate::pvd::check_order;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use lamina_model::{Volume, VoxelType};
use quick_xml::escape::escape;
use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::Path;

/// Bytes packed at a time: large enough for zlib to find its matches, small enough to be held twice.
const BLOCK_BYTES: usize = 1 << 18;

/// Writes `volume` as VTK image data with one point array named `field`: zlib blocks, appended raw, little-endian.
///
/// # Errors
/// If the file cannot be written.
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
    let header = header(volume, field)?;
    let mut file = BufWriter::new(File::create(path)?);
    file.write_all(header.as_bytes())?;
    let table_at = file.stream_position()?;
    let block = BLOCK_BYTES / volume.voxels().voxel_type().size_bytes();
    let count = volume.voxels().len();
    let blocks = count.div_ceil(block);
    let size_bytes = |voxels: usize| (voxels * volume.voxels().voxel_type().size_bytes()) as u64;
    let mut table = vec![blocks as u64, size_bytes(block), size_bytes(count % block)];
    table.resize(3 + blocks, 0);
    write_table(&mut file, &table)?;
    for index in 0..blocks {
        let range = index * block..count.min((index + 1) * block);
        let mut zlib = ZlibEncoder::new(Vec::new(), Compression::default());
        zlib.write_all(&volume.voxels().to_le_bytes(range))?;
        let packed = zlib.finish()?;
        table[3 + index] = packed.len() as u64;
        file.write_all(&packed)?;
    }
    file.write_all(b"\n  </AppendedData>\n</VTKFile>\n")?;
    // The packed sizes are known only now; their room was kept free.
    file.seek(SeekFrom::Start(table_at))?;
    write_table(&mut file, &table)?;
    file.flush()
}

fn write_table(file: &mut impl Write, table: &[u64]) -> io::Result<()> {
    table.iter().try_for_each(|n| file.write_all(&n.to_le_bytes()))
}

fn header(volume: &Volume, field: &str) -> io::Result<String> {
    let grid = volume.grid();
    let [x, y, z] = grid.dims().map(|n| n - 1);
    let extent = format!("0 {x} 0 {y} 0 {z}");
    let [origin, spacing] = [grid.origin(), grid.spacing()].map(|v| format!("{:?} {:?} {:?}", v.x, v.y, v.z));
    let field = escape(field);
    let kind = match volume.voxels().voxel_type() {
        VoxelType::U8 => "UInt8",
        VoxelType::U16 => "UInt16",
        VoxelType::I16 => "Int16",
        VoxelType::F16 => return Err(invalid("VTK knows no 16-bit floats; write float32")),
        VoxelType::F32 => "Float32",
        VoxelType::F64 => "Float64",
    };
    Ok(format!(
        r#"<?xml version="1.0"?>
<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64" compressor="vtkZLibDataCompressor">
  <ImageData WholeExtent="{extent}" Origin="{origin}" Spacing="{spacing}">
    <Piece Extent="{extent}">
      <PointData Scalars="{field}">
        <DataArray type="{kind}" Name="{field}" format="appended" offset="0"/>
      </PointData>
    </Piece>
  </ImageData>
  <AppendedData encoding="raw">
   _"#
    ))
}
