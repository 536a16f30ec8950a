//! Sections: arrays of fixed-width elements, cut into blocks, compressed block by block. First the table of all
//! sections (width, then the compressed length of each block), then all blocks.

use super::compress::{self, BLOCK_BYTES, ByteCompressor};
use crate::error::{CodecError, invalid};
use rayon::prelude::*;
use std::ops::RangeInclusive;

/// An uncompressed array of fixed-width elements.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Section {
    /// Bytes per element; 0 for integers that are all zero.
    pub width: u8,
    pub bytes: Vec<u8>,
}

/// The shape that the header prescribes for a section.
pub(super) struct SectionShape {
    pub name: &'static str,
    pub elements: u64,
    pub widths: RangeInclusive<u8>,
}

pub(super) fn write(sections: &[Section], codec: ByteCompressor, out: &mut Vec<u8>) -> Result<(), CodecError> {
    let pack = |s: &Section| s.bytes.par_chunks(BLOCK_BYTES).map(|b| compress::compress(codec, b)).collect();
    let packed: Vec<Vec<Vec<u8>>> = sections.par_iter().map(pack).collect::<Result<_, CodecError>>()?;
    for (section, blocks) in sections.iter().zip(&packed) {
        out.push(section.width);
        // A block of 899,900 bytes grows by a few percent at worst, so its length always fits 32 bits.
        blocks.iter().for_each(|b| out.extend((b.len() as u32).to_le_bytes()));
    }
    packed.iter().flatten().for_each(|b| out.extend(b));
    Ok(())
}

/// Reads sections of the given shapes, which together must fill `bytes`. Allocates nothing for a section before its blocks
/// are known to lie within `bytes`.
pub(super) fn read(
    mut bytes: &[u8],
    codec: ByteCompressor,
    shapes: &[SectionShape],
) -> Result<Vec<Section>, CodecError> {
    let mut table = Vec::with_capacity(shapes.len());
    for shape in shapes {
        let width = take(&mut bytes, 1)?[0];
        if !shape.widths.contains(&width) {
            return Err(invalid(format!("{} of {width} bytes each; expected {:?}", shape.name, shape.widths)));
        }
        let raw_bytes = shape.elements * u64::from(width);
        let lengths = take(&mut bytes, 4 * raw_bytes.div_ceil(BLOCK_BYTES as u64))?;
        table.push((shape, width, raw_bytes, lengths));
    }
    let mut found = Vec::with_capacity(shapes.len());
    for (shape, width, raw_bytes, lengths) in table {
        let length = |l: &[u8]| u64::from(u32::from_le_bytes([l[0], l[1], l[2], l[3]]));
        let blocks =
            lengths.chunks_exact(4).map(|l| take(&mut bytes, length(l))).collect::<Result<Vec<&[u8]>, CodecError>>()?;
        found.push((shape, width, raw_bytes, blocks));
    }
    if !bytes.is_empty() {
        return Err(invalid(format!("{} bytes follow the last block", bytes.len())));
    }
    found
        .into_par_iter()
        .map(|(shape, width, raw_bytes, blocks)| {
            let size = usize::try_from(raw_bytes)
                .map_err(|_| invalid(format!("{} of {raw_bytes} bytes cannot be addressed here", shape.name)))?;
            let mut raw = vec![0; size];
            raw.par_chunks_mut(BLOCK_BYTES)
                .zip(blocks)
                .try_for_each(|(raw, packed)| compress::decompress(codec, packed, raw))
                .map_err(|e| invalid(format!("a block of {} cannot be decompressed: {e}", shape.name)))?;
            Ok(Section { width, bytes: raw })
        })
        .collect()
}

/// Splits `count` bytes off the front.
fn take<'a>(bytes: &mut &'a [u8], count: u64) -> Result<&'a [u8], CodecError> {
    match usize::try_from(count).ok().and_then(|n| bytes.split_at_checked(n)) {
        Some((front, rest)) => {
            *bytes = rest;
            Ok(front)
        }
        None => Err(invalid(format!("it claims {count} bytes where {} are left", bytes.len()))),
    }
}
