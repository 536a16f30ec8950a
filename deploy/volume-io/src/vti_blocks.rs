//! The numbers that VTK writes in front of an array's bytes, and the compressed blocks behind them.
//!
//! Every number is checked before it is believed: sizes must add up to what the grid needs and fit into the file.

use crate::error::invalid;
use crate::scalars::{ByteOrder, can_inflate};
use flate2::read::ZlibDecoder;
use std::io::{self, Read};

/// Bytes by which zlib exceeds what deflate itself needs; generous.
const ZLIB_FRAME_BYTES: u64 = 64;

/// How arrays are framed in one file.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Framing {
    pub(crate) wide: bool,
    pub(crate) order: ByteOrder,
    pub(crate) zlib: bool,
}

impl Framing {
    /// The array's `want` bytes out of `source`, which has at most `available`.
    pub(crate) fn open<'a>(
        self,
        mut source: impl Read + 'a,
        available: u64,
        want: u64,
    ) -> io::Result<Box<dyn Read + 'a>> {
        if self.zlib {
            let blocks = self.table(&mut source, available, want)?;
            return Ok(Box::new(Blocks { source, blocks: blocks.into_iter(), bytes: Vec::new(), taken: 0 }));
        }
        let bytes = self.number(&mut source)?;
        if bytes != want {
            return Err(invalid(format!("an array of {bytes} bytes is there, the grid needs {want}")));
        }
        if want > available {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        Ok(Box::new(source.take(want)))
    }

    fn number(self, source: &mut dyn Read) -> io::Result<u64> {
        let (mut wide, mut narrow) = ([0; 8], [0; 4]);
        if self.wide {
            source.read_exact(&mut wide)?;
        } else {
            source.read_exact(&mut narrow)?;
        }
        Ok(match (self.wide, self.order) {
            (true, ByteOrder::Little) => u64::from_le_bytes(wide),
            (true, ByteOrder::Big) => u64::from_be_bytes(wide),
            (false, ByteOrder::Little) => u32::from_le_bytes(narrow).into(),
            (false, ByteOrder::Big) => u32::from_be_bytes(narrow).into(),
        })
    }

    /// The sizes of the blocks: how many, how large unpacked, how large the last one, how large each packed.
    fn table(self, source: &mut dyn Read, available: u64, want: u64) -> io::Result<Vec<VtiBlock>> {
        let count = self.number(source)?;
        let full = self.number(source)?;
        let partial = self.number(source)?;
        let last = if partial == 0 { full } else { partial };
        let sum = count.checked_sub(1).and_then(|n| n.checked_mul(full)).and_then(|n| n.checked_add(last));
        if sum != Some(want) {
            let has = format!("{count} blocks of {full} bytes, the last of {last}");
            return Err(invalid(format!("{has}, do not make the {want} bytes that the grid needs")));
        }
        let width = if self.wide { 8 } else { 4 };
        let mut left = available.saturating_sub(3 * width);
        left =
            count.checked_mul(width).and_then(|table| left.checked_sub(table)).ok_or(io::ErrorKind::UnexpectedEof)?;
        let mut blocks = Vec::new();
        for index in 0..count {
            let packed = self.number(source)?;
            left = left.checked_sub(packed).ok_or(io::ErrorKind::UnexpectedEof)?;
            let unpacked = if index + 1 == count { last } else { full };
            if !can_inflate(packed.saturating_add(ZLIB_FRAME_BYTES), unpacked) {
                return Err(invalid(format!("block {index} cannot be {unpacked} bytes in {packed} packed ones")));
            }
            blocks.push(VtiBlock { packed: packed as usize, unpacked: unpacked as usize });
        }
        Ok(blocks)
    }
}

#[derive(Debug)]
struct VtiBlock {
    packed: usize,
    unpacked: usize,
}

/// Unpacks block after block; each must yield exactly its size, so that a bomb goes no further.
struct Blocks<R> {
    source: R,
    blocks: std::vec::IntoIter<VtiBlock>,
    bytes: Vec<u8>,
    taken: usize,
}

impl<R: Read> Blocks<R> {
    fn unpack(&mut self, block: &VtiBlock) -> io::Result<()> {
        let mut packed = vec![0; block.packed];
        self.source.read_exact(&mut packed)?;
        self.bytes.clear();
        self.bytes.resize(block.unpacked, 0);
        self.taken = 0;
        let mut zlib = ZlibDecoder::new(&packed[..]);
        zlib.read_exact(&mut self.bytes)?;
        match zlib.read(&mut [0])? {
            0 => Ok(()),
            _ => Err(invalid(format!("a block unpacks to more than its {} bytes", block.unpacked))),
        }
    }
}

impl<R: Read> Read for Blocks<R> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        while self.taken == self.bytes.len() {
            let Some(block) = self.blocks.next() else { return Ok(0) };
            self.unpack(&block)?;
        }
        let ready = &self.bytes[self.taken..];
        let n = ready.len().min(into.len());
        into[..n].copy_from_slice(&ready[..n]);
        self.taken += n;
        Ok(n)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::Compression;
    use flate2::write::ZlibEncoder;
    use std::io::Write;

    const FRAMING: Framing = Framing { wide: false, order: ByteOrder::Little, zlib: true };

    fn packed(bytes: &[u8]) -> Vec<u8> {
        let mut zlib = ZlibEncoder::new(Vec::new(), Compression::best());
        zlib.write_all(bytes).unwrap();
        zlib.finish().unwrap()
    }

    fn unpack(table: &[u32], data: &[u8], want: u64) -> Result<Vec<u8>, String> {
        let mut file: Vec<u8> = table.iter().flat_map(|n| n.to_le_bytes()).collect();
        file.extend(data);
        let mut bytes = Vec::new();
        let mut source = FRAMING.open(&file[..], file.len() as u64, want).map_err(|e| e.to_string())?;
        source.read_to_end(&mut bytes).map_err(|e| e.to_string())?;
        Ok(bytes)
    }

    #[test]
    fn a_table_that_lies_is_found_out_before_anything_is_unpacked() {
        let data = packed(&[7; 100]);
        let size = data.len() as u32;
        assert_eq!(unpack(&[1, 100, 0, size], &data, 100).unwrap(), [7; 100]);
        assert_eq!(unpack(&[1, 4096, 100, size], &data, 100).unwrap(), [7; 100]);
        let refused = |table: &[u32], want, why: &str| {
            let error = unpack(table, &data, want).unwrap_err();
            assert!(error.contains(why), "{table:?}: {error}");
        };
        refused(&[0, 100, 0], 100, "do not make");
        refused(&[1, 99, 0, size], 100, "do not make");
        refused(&[u32::MAX, u32::MAX, 0, size], 100, "do not make");
        refused(&[u32::MAX, 1, 0, size], u32::MAX.into(), "end of file");
        refused(&[1, 100, 0, size + 1], 100, "end of file");
        refused(&[1, u32::MAX, 0, size], u32::MAX.into(), "cannot be");
        refused(&[1, 100, 0, size - 5], 100, "");
    }

    #[test]
    fn a_bomb_stops_at_the_size_that_was_announced() {
        let bomb = packed(&vec![0; 1 << 24]);
        let error = unpack(&[1, 100, 0, bomb.len() as u32], &bomb, 100).unwrap_err();
        assert!(error.contains("more than its 100 bytes"), "{error}");
    }
}
