//! Raw arrays, plain or gzipped: little-endian, x fastest. Their shape comes from the user or from the file's name.

use crate::ReadError;
use crate::scalars::{ByteOrder, ScalarType, can_inflate};
use flate2::read::MultiGzDecoder;
use glam::DVec3;
use lamina_model::volume::MAX_VOXELS;
use lamina_model::{Grid, Volume, VoxelType, Voxels};
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// The shape of a raw file; what is left open is taken from a name like `engine_256x256x128_uint8.raw.gz`.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RawSpec {
    /// Voxels per axis.
    pub dims: Option<[usize; 3]>,
    /// Type of one voxel.
    pub voxel_type: Option<VoxelType>,
    /// Distance between neighboring voxels, 1 on every axis if not given.
    pub spacing: Option<DVec3>,
}

/// A raw file whose shape is known.
#[derive(Debug)]
pub(crate) struct RawFile {
    path: PathBuf,
    grid: Grid,
    voxel_type: VoxelType,
    gzipped: bool,
}

impl RawFile {
    pub(crate) fn open(path: &Path, spec: &RawSpec) -> Result<Self, ReadError> {
        let name = path.file_name().map(|n| n.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        let gzipped = name.ends_with(".gz");
        let (named_dims, named_type) = shape_of_name(name.trim_end_matches(".gz").trim_end_matches(".raw"));
        let (dims, voxel_type) = match (spec.dims.or(named_dims), spec.voxel_type.or(named_type)) {
            (Some(dims), Some(voxel_type)) => (dims, voxel_type),
            (dims, voxel_type) => {
                let missing = match (dims, voxel_type) {
                    (None, None) => "dims and voxel type",
                    (None, _) => "dims",
                    _ => "voxel type",
                };
                return Err(ReadError::RawShape { path: path.into(), missing });
            }
        };
        let spacing = spec.spacing.unwrap_or(DVec3::ONE);
        let grid = Grid::new(dims, spacing, DVec3::ZERO).map_err(|e| ReadError::grid(path, e))?;
        let raw = Self { path: path.into(), grid, voxel_type, gzipped };
        raw.open_sized()?;
        Ok(raw)
    }

    pub(crate) fn read(&self) -> Result<Volume, ReadError> {
        let file = BufReader::new(self.open_sized()?);
        let mut source: Box<dyn Read> = if self.gzipped { Box::new(MultiGzDecoder::new(file)) } else { Box::new(file) };
        let voxels = self.voxels(&mut source)?;
        Volume::new(self.grid, voxels).map_err(|e| ReadError::grid(&self.path, e))
    }

    /// The grid.
    pub(crate) fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Whether it has to be read from its beginning.
    pub(crate) fn is_packed(&self) -> bool {
        self.gzipped
    }

    /// Some points, x fastest, of a file that is not packed.
    pub(crate) fn read_points(&self, points: Range<usize>) -> Result<Voxels, ReadError> {
        let mut file = self.open_sized()?;
        let start = points.start as u64 * self.voxel_type.size_bytes() as u64;
        let read = file
            .seek(SeekFrom::Start(start))
            .and_then(|_| self.scalar().decode(&mut BufReader::new(file), ByteOrder::Little, points.len()));
        read.map_err(|e| ReadError::while_reading(&self.path, e))
    }

    fn scalar(&self) -> ScalarType {
        match self.voxel_type {
            VoxelType::U8 => ScalarType::U8,
            VoxelType::U16 => ScalarType::U16,
            VoxelType::I16 => ScalarType::I16,
            VoxelType::F16 => ScalarType::F16,
            VoxelType::F32 => ScalarType::F32,
            VoxelType::F64 => ScalarType::F64,
        }
    }

    fn voxels(&self, source: &mut dyn Read) -> Result<Voxels, ReadError> {
        let voxels =
            self.scalar().decode(source, ByteOrder::Little, self.grid.voxels()).map_err(|e| match e.kind() {
                io::ErrorKind::UnexpectedEof => self.wrong_size("fewer"),
                _ => ReadError::while_reading(&self.path, e),
            })?;
        // One byte more tells whether the end was met, and has a gzip file's checksum verified.
        match source.read(&mut [0]).map_err(|e| ReadError::while_reading(&self.path, e))? {
            0 => Ok(voxels),
            _ => Err(self.wrong_size("more")),
        }
    }

    /// Opens the file if its size leaves the shape possible.
    fn open_sized(&self) -> Result<File, ReadError> {
        let system = |e| ReadError::while_reading(&self.path, e);
        let file = File::open(&self.path).map_err(system)?;
        let bytes = file.metadata().map_err(system)?.len();
        match self.gzipped {
            false if bytes != self.bytes() => Err(self.wrong_size(bytes.to_string())),
            true if !can_inflate(bytes, self.bytes()) => Err(self.wrong_size("fewer")),
            _ => Ok(file),
        }
    }

    fn bytes(&self) -> u64 {
        self.grid.voxels() as u64 * self.voxel_type.size_bytes() as u64
    }

    fn wrong_size(&self, have: impl Into<String>) -> ReadError {
        let (path, dims) = (self.path.clone(), self.grid.dims());
        ReadError::RawSize { path, dims, voxel_type: self.voxel_type, want: self.bytes(), have: have.into() }
    }
}

/// Dims and type as the last two parts of a stem such as `engine_256x256x128_uint8`, in either order. Parts before them
/// are the data's name, where "short" or "double" mean something else.
fn shape_of_name(stem: &str) -> (Option<[usize; 3]>, Option<VoxelType>) {
    let parts = || stem.rsplit('_').take(2);
    (parts().find_map(parse_dims), parts().find_map(|part| part.parse().ok()))
}

fn parse_dims(text: &str) -> Option<[usize; 3]> {
    let mut sides = text.split('x').map(|side| side.parse().ok().filter(|&n: &usize| n as u64 <= MAX_VOXELS));
    let dims = [sides.next()??, sides.next()??, sides.next()??];
    sides.next().is_none().then_some(dims)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_tells_the_shape() {
        assert_eq!(shape_of_name("engine_256x256x128_uint8"), (Some([256, 256, 128]), Some(VoxelType::U8)));
        assert_eq!(shape_of_name("a_b_uint16_1x2x3"), (Some([1, 2, 3]), Some(VoxelType::U16)));
        assert_eq!(shape_of_name("a_float32"), (None, Some(VoxelType::F32)));
        assert_eq!(shape_of_name("double_jet_4x4x4"), (Some([4, 4, 4]), None));
        assert_eq!(shape_of_name("a_1x2x3x4_9x-1x9_1x2x99999999999999999999"), (None, None));
    }
}
