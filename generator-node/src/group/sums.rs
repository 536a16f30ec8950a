//! What parts give to a reduced volume, or to the extinction that light meets, as bytes between members: plain records, little-endian.

use lamina_model::Invalid;
use lamina_raycast::PartSums;

fn short() -> Invalid {
    Invalid::new("group", "sums of another member end early")
}

/// Appends a part's: first point and points per axis, whether there are shares, sums, shares.
pub(super) fn write(part: &PartSums, out: &mut Vec<u8>) {
    out.reserve(28 + 4 * (part.sums.len() + part.shares.len()));
    out.extend(part.start.iter().chain(&part.dims).flat_map(|&n| (n as u32).to_le_bytes()));
    out.extend(u32::from(!part.shares.is_empty()).to_le_bytes());
    out.extend(part.sums.iter().chain(&part.shares).flat_map(|x| x.to_le_bytes()));
}

/// Those of all parts in `bytes`.
pub(super) fn read_all(mut bytes: &[u8]) -> Result<Vec<PartSums>, Invalid> {
    let mut parts = Vec::new();
    while !bytes.is_empty() {
        parts.push(read(&mut bytes)?);
    }
    Ok(parts)
}

/// Takes a part's off the front of `bytes`.
fn read(bytes: &mut &[u8]) -> Result<PartSums, Invalid> {
    let (head, rest) = bytes.split_first_chunk::<28>().ok_or_else(short)?;
    let word = |n: usize| u32::from_le_bytes([0, 1, 2, 3].map(|k| head[4 * n + k])) as usize;
    let (start, dims) = ([0, 1, 2].map(word), [3, 4, 5].map(word));
    let count = dims.iter().try_fold(1_usize, |n, d| n.checked_mul(*d)).ok_or_else(short)?;
    let all = count.checked_mul(if word(6) > 0 { 8 } else { 4 }).ok_or_else(short)?;
    let (values, rest) = rest.split_at_checked(all).ok_or_else(short)?;
    *bytes = rest;
    let mut sums: Vec<f32> = values.as_chunks().0.iter().map(|x| f32::from_le_bytes(*x)).collect();
    let shares = sums.split_off(count);
    Ok(PartSums { start, dims, sums, shares })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_come_back_and_cut_ones_are_refused() {
        let plain = PartSums { start: [1, 2, 3], dims: [2, 1, 2], sums: vec![0.5, -1.0, 3.0, 7.5], shares: Vec::new() };
        let masked = PartSums { shares: vec![0.0, 0.25, 1.0, 0.5], ..plain.clone() };
        let mut bytes = Vec::new();
        [&plain, &masked].into_iter().for_each(|part| write(part, &mut bytes));
        assert_eq!(read_all(&bytes).unwrap(), [plain, masked]);
        assert!((0..28 + 16).all(|n| read(&mut &bytes[..n]).is_err()));
        assert!(read(&mut &[0xff; 28][..]).is_err());
    }
}
