//! Lists of supersegments as bytes between members: plain records, little-endian.

use lamina_model::{Invalid, Supersegment};
use lamina_raycast::RowBand;

/// Bytes of a supersegment: start, end, three colors, optical depth.
const RECORD: usize = 24;

fn short() -> Invalid {
    Invalid::new("group", "lists of another member end early")
}

/// Appends a band.
pub(super) fn write(band: &RowBand, out: &mut Vec<u8>) {
    out.reserve(8 + 4 * band.counts.len() + RECORD * band.segments.len());
    out.extend((band.counts.len() as u32).to_le_bytes());
    out.extend(band.counts.iter().flat_map(|n| n.to_le_bytes()));
    for s in &band.segments {
        out.extend(s.start.to_le_bytes());
        out.extend(s.end.to_le_bytes());
        out.extend(s.color.iter().chain([&s.optical_depth]).flat_map(|x| x.to_le_bytes()));
    }
}

/// Takes a band off the front of `bytes`.
pub(super) fn read(bytes: &mut &[u8]) -> Result<RowBand, Invalid> {
    let rays = word(bytes)? as usize;
    let counts = (0..rays).map(|_| word(bytes)).collect::<Result<Vec<u32>, _>>()?;
    let all = counts.iter().try_fold(0_usize, |sum, &n| sum.checked_add(n as usize)).ok_or_else(short)?;
    let (records, rest) = all.checked_mul(RECORD).and_then(|n| bytes.split_at_checked(n)).ok_or_else(short)?;
    *bytes = rest;
    let segment = |record: &[u8; RECORD]| {
        let word = |n: usize| [record[4 * n], record[4 * n + 1], record[4 * n + 2], record[4 * n + 3]];
        let real = |n: usize| f32::from_le_bytes(word(n));
        Supersegment {
            start: u32::from_le_bytes(word(0)),
            end: u32::from_le_bytes(word(1)),
            color: [real(2), real(3), real(4)],
            optical_depth: real(5),
        }
    };
    Ok(RowBand { counts, segments: records.as_chunks().0.iter().map(segment).collect() })
}

/// Takes a number off the front.
fn word(bytes: &mut &[u8]) -> Result<u32, Invalid> {
    let (word, rest) = bytes.split_first_chunk().ok_or_else(short)?;
    *bytes = rest;
    Ok(u32::from_le_bytes(*word))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_come_back_and_short_ones_are_refused() {
        let segment =
            |start| Supersegment { start, end: start + 2, color: [0.1, 0.2, 0.3], optical_depth: f32::INFINITY };
        let bands = [
            RowBand { counts: vec![1, 0, 2], segments: vec![segment(0), segment(1), segment(7)] },
            RowBand { counts: vec![0], segments: vec![] },
        ];
        let mut bytes = Vec::new();
        bands.iter().for_each(|band| write(band, &mut bytes));
        let mut rest = &bytes[..];
        assert_eq!([read(&mut rest).unwrap(), read(&mut rest).unwrap()], bands);
        assert!(rest.is_empty());
        for end in 0..bytes.len() {
            let mut rest = &bytes[..end];
            assert!(read(&mut rest).and_then(|_| read(&mut rest)).is_err(), "{end}");
        }
        let mut absurd = &[0xff_u8; 64][..];
        assert!(read(&mut absurd).is_err());
    }
}
