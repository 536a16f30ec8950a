//! Regions put together of chunks, each a file, or a part of one that holds many (a shard).

use super::codecs::{ChunkCodec, CodecChain};
use super::metadata::ZarrArray;
use crate::ReadError;
use crate::scalars::ScalarType;
use lamina_model::Voxels;
use rayon::prelude::*;
use std::fs::File;
use std::io::{self, Read};
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Chunks of a region, at most: metadata may state any number.
const MOST_CHUNKS: u64 = 1 << 20;

/// Chunks that are unpacked side by side, a thread, and their bytes in all.
const BATCH: usize = 4;
const BATCH_BYTES: usize = 1 << 28;

/// A chunk that a region touches.
struct Piece {
    file: Arc<PathBuf>,
    /// Where in the file it lies; all of it, if it is no shard.
    bytes: Option<Range<u64>>,
    /// Its first point.
    first: Vec<usize>,
}

/// The region of an array, a range of each axis. What has no chunk is the fill value.
pub(super) fn read(array: &ZarrArray, region: &[Range<usize>]) -> Result<Voxels, ReadError> {
    let chunks = region.iter().zip(&array.chunk).map(|(range, &length)| range.len().div_ceil(length) as u64);
    let chunks = chunks.fold(1, u64::saturating_mul);
    if chunks > MOST_CHUNKS {
        let what = format!("a region of {chunks} chunks");
        return Err(ReadError::unsupported(&array.folder, what, "write larger chunks, such as 64 x 64 x 64"));
    }
    let files = chunks_within(region, &array.chunk).map(|index| {
        let first: Vec<usize> = index.iter().zip(&array.chunk).map(|(n, length)| n * length).collect();
        (chunk_path(array, &index), first)
    });
    let (mut pieces, chunk, codecs) = match array.codecs.0.first() {
        Some(ChunkCodec::Shards { chunk, codecs, index, at_start }) => {
            let shards = Shards { length: &array.chunk, chunk, index, at_start: *at_start };
            let pieces: Result<Vec<Vec<Piece>>, ReadError> =
                files.map(|(path, first)| shards.pieces(path, &first, region)).collect();
            (pieces?.into_iter().flatten().collect(), chunk, codecs)
        }
        _ => {
            let whole = |(path, first)| Piece { file: Arc::new(path), bytes: None, first };
            let written = files.filter(|(path, _)| path.exists());
            (written.map(whole).collect::<Vec<_>>(), &array.chunk, &array.codecs)
        }
    };
    let count: usize = region.iter().map(Range::len).product();
    let system = |e| ReadError::while_reading(&array.folder, e);
    let voxels = array.scalar.filled(count, array.fill).map_err(system)?;
    let size = array.scalar.size_bytes() as usize * chunk.iter().product::<usize>();
    let mut into = Destination { region, scalar: array.scalar, voxels, chunk, codecs };
    let most = (BATCH_BYTES / size).clamp(1, BATCH * rayon::current_num_threads());
    while !pieces.is_empty() {
        let batch = pieces.split_off(pieces.len().saturating_sub(most));
        let unpacked: Vec<Option<Vec<u8>>> =
            batch.par_iter().map(|piece| piece.unpacked(codecs, size)).collect::<Result<_, _>>()?;
        for (piece, bytes) in batch.iter().zip(unpacked) {
            into.place(&piece.file, &piece.first, bytes.as_deref())?;
        }
    }
    Ok(into.voxels)
}

impl Piece {
    /// Its `size` bytes; none if there is no such file.
    fn unpacked(&self, codecs: &CodecChain, size: usize) -> Result<Option<Vec<u8>>, ReadError> {
        let system = |e| ReadError::while_reading(&self.file, e);
        let packed = match (&self.bytes, opened(&self.file)?) {
            (_, None) => return Ok(None),
            (None, Some(mut file)) => {
                let mut packed = Vec::new();
                file.read_to_end(&mut packed).map_err(system)?;
                packed
            }
            (Some(range), Some(file)) => {
                let mut packed = vec![0; (range.end - range.start) as usize];
                file.read_exact_at(&mut packed, range.start).map_err(system)?;
                packed
            }
        };
        let bytes = codecs.unpacked(packed, size).map_err(|reason| ReadError::damaged(&self.file, reason))?;
        if bytes.len() != size {
            let reason = format!("a chunk of {} bytes, which its shape makes {size}", bytes.len());
            return Err(ReadError::damaged(&self.file, reason));
        }
        Ok(Some(bytes))
    }
}

/// The indices of the chunks that a region touches.
fn chunks_within(region: &[Range<usize>], chunk: &[usize]) -> impl Iterator<Item = Vec<usize>> {
    let ranges: Vec<Range<usize>> =
        region.iter().zip(chunk).map(|(range, &length)| range.start / length..range.end.div_ceil(length)).collect();
    let count: usize = ranges.iter().map(Range::len).product();
    (0..count).map(move |n| {
        let mut rest = n;
        let mut index: Vec<usize> = ranges
            .iter()
            .rev()
            .map(|range| {
                let at = range.start + rest % range.len();
                rest /= range.len();
                at
            })
            .collect();
        index.reverse();
        index
    })
}

fn chunk_path(array: &ZarrArray, index: &[usize]) -> PathBuf {
    let separator = array.separator.to_string();
    let numbers: Vec<String> = index.iter().map(usize::to_string).collect();
    // An array without axes has one chunk, "0" in version 2 and "c" in 3.
    let name = match (index, array.prefix) {
        ([], "") => "0".to_owned(),
        ([], _) => "c".to_owned(),
        (_, prefix) => format!("{prefix}{}", numbers.join(&separator)),
    };
    array.folder.join(name)
}

fn opened(path: &Path) -> Result<Option<File>, ReadError> {
    match File::open(path) {
        Ok(file) => Ok(Some(file)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(ReadError::while_reading(path, error)),
    }
}

/// Files of many chunks.
struct Shards<'a> {
    length: &'a [usize],
    chunk: &'a [usize],
    index: &'a CodecChain,
    at_start: bool,
}

/// Where a chunk lies that is not there.
const ABSENT: u64 = u64::MAX;

impl Shards<'_> {
    /// The chunks of the shard at `path` that the region touches; `first` is the shard's first point.
    fn pieces(&self, path: PathBuf, first: &[usize], region: &[Range<usize>]) -> Result<Vec<Piece>, ReadError> {
        let Some(file) = opened(&path)? else { return Ok(Vec::new()) };
        let system = |e| ReadError::while_reading(&path, e);
        let wrong = |reason: String| ReadError::damaged(&path, reason);
        let size = file.metadata().map_err(system)?.len();
        let counts: Vec<usize> = self.length.iter().zip(self.chunk).map(|(whole, part)| whole / part).collect();
        let plain = counts.iter().fold(16, |bytes: usize, &count| bytes.saturating_mul(count));
        let checksum = self.index.0.iter().filter(|step| matches!(step, ChunkCodec::TrailingChecksum)).count();
        let stored = plain.saturating_add(4 * checksum);
        let at = if self.at_start { Some(0) } else { size.checked_sub(stored as u64) };
        let at = at.filter(|at| (*at).saturating_add(stored as u64) <= size);
        let at = at.ok_or_else(|| wrong(format!("a shard of {size} bytes, with an index of {stored}")))?;
        let mut packed = vec![0; stored];
        file.read_exact_at(&mut packed, at).map_err(system)?;
        let index = self.index.unpacked(packed, plain).map_err(&wrong)?;
        let places: Vec<u64> = index.as_chunks::<8>().0.iter().map(|bytes| u64::from_le_bytes(*bytes)).collect();
        // The region as it lies within the shard.
        let local: Vec<Range<usize>> = (region.iter().zip(first).zip(self.length))
            .map(|((range, &first), &length)| range.start.saturating_sub(first)..(range.end - first).min(length))
            .collect();
        let shared = Arc::new(path.clone());
        let mut pieces = Vec::new();
        for inner in chunks_within(&local, self.chunk) {
            let n = inner.iter().zip(&counts).fold(0, |n, (&at, &count)| n * count + at);
            let [offset, bytes] = places.get(2 * n..2 * n + 2).and_then(|p| p.try_into().ok()).unwrap_or([ABSENT; 2]);
            if offset == ABSENT && bytes == ABSENT {
                continue;
            }
            let Some(end) = offset.checked_add(bytes).filter(|end| *end <= size) else {
                return Err(wrong(format!("a chunk of {bytes} bytes at {offset} of {size}")));
            };
            let first =
                (first.iter().zip(&inner).zip(self.chunk)).map(|((first, n), length)| first + n * length).collect();
            pieces.push(Piece { file: Arc::clone(&shared), bytes: Some(offset..end), first });
        }
        Ok(pieces)
    }
}

/// A region that chunks are placed in.
struct Destination<'a> {
    region: &'a [Range<usize>],
    scalar: ScalarType,
    voxels: Voxels,
    /// Points of a chunk along each axis, and how they are stored.
    chunk: &'a [usize],
    codecs: &'a CodecChain,
}

impl Destination<'_> {
    /// Places what of a chunk lies in the region. `first`: the chunk's first point in the array.
    fn place(&mut self, path: &Path, first: &[usize], bytes: Option<&[u8]>) -> Result<(), ReadError> {
        let Some(bytes) = bytes else { return Ok(()) };
        let (width, chunk, order) = (self.scalar.size_bytes() as usize, self.chunk, self.codecs.order());
        let system = |e| ReadError::while_reading(path, e);
        // Strides of the array's axes in the chunk as it is stored, and in the region.
        let (mut strides, mut stride) = (vec![0; chunk.len()], 1);
        for &axis in self.codecs.stored_axes(chunk.len()).iter().rev() {
            strides[axis] = stride;
            stride *= chunk[axis];
        }
        let both: Vec<Range<usize>> = (self.region.iter().zip(first).zip(chunk))
            .map(|((range, &first), &length)| range.start.max(first)..range.end.min(first + length))
            .collect();
        let Some((along, outer)) = both.split_last() else {
            return self.scalar.decode_at(&mut self.voxels, 0, bytes, order).map_err(system);
        };
        let (last, inner) = (outer.len(), strides[outer.len()]);
        let rows: usize = outer.iter().map(Range::len).product();
        for n in 0..rows {
            let mut rest = n;
            let (mut from, mut to) = ((along.start - first[last]) * inner, along.start - self.region[last].start);
            let mut in_region = self.region[last].len();
            for axis in (0..last).rev() {
                let at = outer[axis].start + rest % outer[axis].len();
                rest /= outer[axis].len();
                from += (at - first[axis]) * strides[axis];
                to += (at - self.region[axis].start) * in_region;
                in_region *= self.region[axis].len();
            }
            if inner == 1 {
                let row = &bytes[from * width..(from + along.len()) * width];
                self.scalar.decode_at(&mut self.voxels, to, row, order).map_err(system)?;
            } else {
                for x in 0..along.len() {
                    let value = &bytes[(from + x * inner) * width..][..width];
                    self.scalar.decode_at(&mut self.voxels, to + x, value, order).map_err(system)?;
                }
            }
        }
        Ok(())
    }
}
