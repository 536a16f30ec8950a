//! LZF, the fast packing of h5py. The format is that of LibLZF, `lzf_d.c` (<http://oldhome.schmorp.de/marc/liblzf.html>).

/// What `packed` unpacks to, `size` bytes; or `packed` itself, if it has that size already.
pub(crate) fn unpacked(packed: &[u8], size: usize) -> Result<Vec<u8>, String> {
    let wrong = |what: &str| format!("an LZF chunk {what}");
    let mut unpacked = Vec::with_capacity(size.min(packed.len().saturating_mul(264)));
    let mut bytes = packed.iter().copied();
    let mut next = || bytes.next().ok_or_else(|| wrong("ends too early"));
    while unpacked.len() < size {
        let control = usize::from(next()?);
        if control < 32 {
            for _ in 0..=control {
                unpacked.push(next()?);
            }
            continue;
        }
        let mut length = control >> 5;
        if length == 7 {
            length += usize::from(next()?);
        }
        let back = ((control & 31) << 8 | usize::from(next()?)) + 1;
        let start = unpacked.len().checked_sub(back).ok_or_else(|| wrong("refers to what is before it"))?;
        for n in start..start + length + 2 {
            unpacked.push(unpacked[n]);
        }
    }
    if unpacked.len() != size {
        return Err(wrong("unpacks to more than its size"));
    }
    Ok(unpacked)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn literals_and_repeats_are_unpacked_and_lies_refused() {
        // "abc", then 9 bytes from 3 back.
        let packed = [2, b'a', b'b', b'c', 7 << 5, 0, 2];
        assert_eq!(unpacked(&packed, 12).unwrap(), b"abcabcabcabc");
        assert!(unpacked(&packed, 13).unwrap_err().contains("ends too early"));
        assert!(unpacked(&packed, 5).unwrap_err().contains("more than its size"));
        assert!(unpacked(&[32, 9], 3).unwrap_err().contains("before it"));
    }
}
