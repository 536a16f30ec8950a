//! NRRD volumes: header and data in one file, or a header that names its data file. What axes mean is not known here.

use crate::ReadError;
use crate::nrrd_axes;
use crate::nrrd_header::Fields;
use crate::scalars::{ByteOrder, ScalarType, can_inflate};
use flate2::bufread::MultiGzDecoder;
use lamina_model::{Grid, Volume, Voxels};
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Encoding {
    Raw,
    Gzip,
    Ascii,
}

/// A volume whose header is understood.
#[derive(Debug)]
pub(crate) struct Nrrd {
    grid: Grid,
    scalar: ScalarType,
    order: ByteOrder,
    encoding: Encoding,
    data: PathBuf,
    /// Where in the data file the data, or the lines and bytes to skip before it, begin.
    start: u64,
    skip_lines: u64,
    /// Bytes to skip; none: the data is what the file ends with.
    skip_bytes: Option<u64>,
}

impl Nrrd {
    pub(crate) fn open(path: &Path) -> Result<Self, ReadError> {
        let file = File::open(path).map_err(|e| ReadError::while_reading(path, e))?;
        let fields = Fields::read(path, BufReader::new(file))?;
        let scalar = scalar(path, fields.require(path, "type")?)?;
        let encoding = encoding(path, fields.require(path, "encoding")?)?;
        let order = match fields.get("endian").map(str::to_ascii_lowercase).as_deref() {
            Some("little") => ByteOrder::Little,
            Some("big") => ByteOrder::Big,
            None if scalar.size_bytes() == 1 || encoding == Encoding::Ascii => ByteOrder::Little,
            _ => return Err(ReadError::damaged(path, "its header lacks \"endian: little\" or \"endian: big\"")),
        };
        let (data, start) = data_file(path, &fields)?;
        let skips = (fields.number(path, "lineskip")?, fields.number(path, "byteskip")?);
        let (skip_lines, skip_bytes) = match skips {
            (lines @ 0.., bytes @ 0..) => (lines as u64, Some(bytes as u64)),
            (_, -1) if encoding == Encoding::Raw => (0, None),
            (lines, bytes) => {
                let reason = format!("line skip {lines} and byte skip {bytes} do not go with its encoding");
                return Err(ReadError::damaged(path, reason));
            }
        };
        let grid = nrrd_axes::grid(path, &fields)?;
        Ok(Self { grid, scalar, order, encoding, data, start, skip_lines, skip_bytes })
    }

    pub(crate) fn read(&self) -> Result<Volume, ReadError> {
        let voxels = self.voxels().map_err(|e| ReadError::while_reading(&self.data, e))?;
        Volume::new(self.grid, voxels).map_err(|e| ReadError::grid(&self.data, e))
    }

    /// The grid.
    pub(crate) fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Whether its data has to be read from its beginning.
    pub(crate) fn is_packed(&self) -> bool {
        self.encoding != Encoding::Raw
    }

    /// Some points, x fastest, of data that is not packed.
    pub(crate) fn read_points(&self, points: Range<usize>) -> Result<Voxels, ReadError> {
        self.decoded(points).map_err(|e| ReadError::while_reading(&self.data, e))
    }

    fn voxels(&self) -> io::Result<Voxels> {
        self.decoded(0..self.grid.voxels())
    }

    /// Of packed data only all points can be read.
    fn decoded(&self, points: Range<usize>) -> io::Result<Voxels> {
        let count = self.grid.voxels();
        let want = count as u64 * self.scalar.size_bytes();
        let file = File::open(&self.data)?;
        let bytes = file.metadata()?.len();
        let mut file = BufReader::with_capacity(1 << 16, file);
        file.seek(SeekFrom::Start(self.start))?;
        for _ in 0..self.skip_lines {
            if file.skip_until(b'\n')? == 0 {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
        }
        let at = file.stream_position()?;
        let skip = match self.skip_bytes {
            Some(skip) => skip,
            None => bytes.checked_sub(want).and_then(|start| start.checked_sub(at)).ok_or_else(too_short)?,
        };
        // What there is may be packed, what is needed is not: neither may be believed before they are compared.
        let (need, packed) = (want.saturating_add(skip), bytes.saturating_sub(at));
        match self.encoding {
            Encoding::Raw if need <= packed => {
                file.seek(SeekFrom::Start(at + skip + points.start as u64 * self.scalar.size_bytes()))?;
                self.scalar.decode(&mut file, self.order, points.len())
            }
            Encoding::Gzip if can_inflate(packed, need) => self.unpack(file, skip, count),
            // A value takes a character and the blank before the next.
            Encoding::Ascii if count as u64 <= packed.saturating_sub(skip).div_ceil(2) => {
                skip_exactly(&mut file, skip)?;
                self.scalar.parse(&mut file, count)
            }
            _ => Err(too_short()),
        }
    }

    fn unpack(&self, file: BufReader<File>, skip: u64, count: usize) -> io::Result<Voxels> {
        let mut gzip = MultiGzDecoder::new(file);
        skip_exactly(&mut gzip, skip)?;
        let voxels = self.scalar.decode(&mut gzip, self.order, count)?;
        // Meeting the end has the checksum verified; more data than the grid needs is allowed by the format.
        let _rest = gzip.read(&mut [0])?;
        Ok(voxels)
    }
}

fn too_short() -> io::Error {
    io::ErrorKind::UnexpectedEof.into()
}

fn skip_exactly(source: &mut dyn Read, bytes: u64) -> io::Result<()> {
    match io::copy(&mut source.take(bytes), &mut io::sink())? {
        skipped if skipped == bytes => Ok(()),
        _ => Err(too_short()),
    }
}

/// The file that the data is in and where in it.
fn data_file(path: &Path, fields: &Fields) -> Result<(PathBuf, u64), ReadError> {
    match (fields.get("datafile"), fields.end) {
        (Some(name), _) if name.starts_with("LIST") || name.contains('%') => {
            let what = format!("data in several files ({name})");
            Err(ReadError::unsupported(path, what, "join the data files to one and name it in \"data file:\""))
        }
        (Some(name), _) => Ok((path.parent().unwrap_or(Path::new("")).join(name), 0)),
        (None, Some(end)) => Ok((path.into(), end)),
        (None, None) => Err(ReadError::damaged(path, "it has neither a \"data file:\" nor data behind its header")),
    }
}

fn scalar(path: &Path, name: &str) -> Result<ScalarType, ReadError> {
    Ok(match name.to_ascii_lowercase().as_str() {
        "signed char" | "int8" | "int8_t" => ScalarType::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => ScalarType::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => ScalarType::I16,
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => ScalarType::U16,
        "int" | "signed int" | "int32" | "int32_t" => ScalarType::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => ScalarType::U32,
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => ScalarType::I64,
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => ScalarType::U64,
        "float" => ScalarType::F32,
        "double" => ScalarType::F64,
        _ => {
            let what = format!("data of type {name}");
            return Err(ReadError::unsupported(path, what, "write it as integers of 8 to 64 bits, float or double"));
        }
    })
}

fn encoding(path: &Path, name: &str) -> Result<Encoding, ReadError> {
    match name.to_ascii_lowercase().as_str() {
        "raw" => Ok(Encoding::Raw),
        "gz" | "gzip" => Ok(Encoding::Gzip),
        "txt" | "text" | "ascii" => Ok(Encoding::Ascii),
        _ => Err(ReadError::unsupported(path, format!("encoding {name}"), "write it as raw, gzip or ascii")),
    }
}
