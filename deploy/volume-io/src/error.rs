//! Why a recorded volume cannot be read or written: the file, what is wrong, and what to do about it.

use lamina_codec::CodecError;
use lamina_model::{Invalid, VoxelType};
use std::io;
use std::path::{Path, PathBuf};

/// A file that cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The operating system refuses.
    #[error("{}: cannot be read: {source}; check that it exists and may be read", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The refusal.
        source: io::Error,
    },
    /// The operating system refuses to write.
    #[error("{}: cannot be written: {source}; check that its folder exists and has room", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The refusal.
        source: io::Error,
    },
    /// The name does not tell a format.
    #[error(
        "{}: the name has none of the endings understood, .pvd .vti .nrrd .nhdr .raw .raw.gz .h5 .hdf5 .vtkhdf .nc .zarr .tif, and \
         it is no folder of an AMReX plotfile; rename or convert it",
        path.display()
    )]
    Extension {
        /// The file.
        path: PathBuf,
    },
    /// A raw file says nothing of itself.
    #[error(
        "{}: a raw file does not tell its {missing}; give `--dims 256x256x128 --dtype uint8`, \
         or name it like engine_256x256x128_uint8.raw.gz",
        path.display()
    )]
    RawShape {
        /// The file.
        path: PathBuf,
        /// What is not known: dims, voxel type or both.
        missing: &'static str,
    },
    /// A raw file does not have the size that its shape needs.
    #[error(
        "{}: holds {have} bytes, but {}x{}x{} voxels of {voxel_type} are {want}; correct --dims and --dtype \
         (or the file's name), or copy the file anew if it is cut short",
        path.display(), dims[0], dims[1], dims[2]
    )]
    RawSize {
        /// The file.
        path: PathBuf,
        /// The dims that were given.
        dims: [usize; 3],
        /// The voxel type that was given.
        voxel_type: VoxelType,
        /// Bytes that the shape needs.
        want: u64,
        /// Bytes that there are, as far as that is known without unpacking everything.
        have: String,
    },
    /// The content contradicts itself or ends too early.
    #[error("{}: {reason}; the file is damaged or incomplete: copy or write it anew", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The contradiction.
        reason: String,
    },
    /// The content is in order, but of a kind that this reader leaves out.
    #[error("{}: {what} cannot be read; {remedy}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What is left out.
        what: String,
        /// What would be read.
        remedy: &'static str,
    },
    /// An array is larger than the memory.
    #[error(
        "{}: \"{name}\" takes {:.1} GB, more than the {:.1} GB of memory that are free; \
         read it in slabs (--memory) or write a smaller one",
        path.display(), *bytes as f64 / 1e9, *free as f64 / 1e9
    )]
    Memory {
        /// The file.
        path: PathBuf,
        /// The array.
        name: String,
        /// What reading it takes.
        bytes: u64,
        /// What there is.
        free: u64,
    },
    /// A recorded step cannot be decoded.
    #[error("{}: {source}", path.display())]
    Recorded {
        /// The file.
        path: PathBuf,
        /// What the codec says.
        source: CodecError,
    },
    /// A recorded step was coded after another one, which is not in its folder.
    #[error(
        "{}: coded after another step, the .vdi file with the checksum {checksum:08x}, which is not beside it; \
         keep the files of a run in one folder",
        path.display()
    )]
    Predecessor {
        /// The file.
        path: PathBuf,
        /// The CRC-32 that the other one ends with.
        checksum: u32,
    },
    /// The scalar asked for is not there.
    #[error("{}: {reason}; choose one of the scalar arrays there are: {present}", path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// Which array cannot be taken, and why.
        reason: String,
        /// The arrays that can.
        present: String,
    },
    /// The grid is impossible.
    #[error("{}: {source}; correct the file's header (or --dims and the spacing of a raw file)", path.display())]
    Grid {
        /// The file.
        path: PathBuf,
        /// What is wrong with the grid.
        source: Invalid,
    },
    /// The steps of a collection are in disorder.
    #[error("{}: {reason}; a collection lists one file per step, each with its own time, ascending", path.display())]
    Collection {
        /// The collection.
        path: PathBuf,
        /// The disorder.
        reason: String,
    },
    /// A step beyond the last.
    #[error("{}: has no step {index}; its steps are numbered 0 to {last}", path.display())]
    Step {
        /// The series.
        path: PathBuf,
        /// The step asked for.
        index: usize,
        /// The last step there is.
        last: usize,
    },
}

impl ReadError {
    /// Whether it will be the same when whoever writes the file has finished.
    pub fn is_lasting(&self) -> bool {
        match self {
            Self::Field { present, .. } => present != "none",
            Self::Extension { .. } | Self::RawShape { .. } | Self::Unsupported { .. } | Self::Memory { .. } => true,
            _ => false,
        }
    }

    pub(crate) fn damaged(path: &Path, reason: impl Into<String>) -> Self {
        Self::Damaged { path: path.into(), reason: reason.into() }
    }

    pub(crate) fn unsupported(path: &Path, what: impl Into<String>, remedy: &'static str) -> Self {
        Self::Unsupported { path: path.into(), what: what.into(), remedy }
    }

    pub(crate) fn grid(path: &Path, source: Invalid) -> Self {
        Self::Grid { path: path.into(), source }
    }

    /// Sorts what a chain of decoders reports: their complaints are about the content, the rest is the system's.
    pub(crate) fn while_reading(path: &Path, source: io::Error) -> Self {
        match source.kind() {
            io::ErrorKind::UnexpectedEof => Self::damaged(path, "the data ends too early"),
            io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput => Self::damaged(path, source.to_string()),
            _ => Self::Io { path: path.into(), source },
        }
    }
}

/// The complaint of a decoder, in the form that travels through [`io::Read`].
pub(crate) fn invalid(reason: impl Into<String>) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, reason.into())
}
