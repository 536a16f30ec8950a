//! Bytes of a file with something amiss.

use fastrand::Rng;

/// `bytes` cut short, with a part left out, with a larger number, or with other bits.
pub(crate) fn damage(bytes: &[u8], random: &mut Rng) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    match random.usize(..5) {
        0 => bytes.truncate(random.usize(..bytes.len().max(1))),
        1 => {
            let from = random.usize(..bytes.len().max(1));
            let to = bytes.len().min(from + random.usize(..40));
            bytes.drain(from..to);
        }
        2 => bytes = inflate_number(&bytes, random),
        3 => {
            let at = random.usize(..bytes.len().max(1));
            let end = bytes.len().min(at + 8);
            bytes[at..end].fill(0xff);
        }
        _ => {
            for _ in 0..=random.usize(..4) {
                let at = random.usize(..bytes.len().max(1));
                bytes[at] ^= 1 << random.usize(..8);
            }
        }
    }
    bytes
}

/// Makes a number larger wherever it stands between the same neighbors: headers that say a size twice then agree.
fn inflate_number(bytes: &[u8], random: &mut Rng) -> Vec<u8> {
    let digits: Vec<_> = (1..bytes.len().saturating_sub(1)).filter(|&at| bytes[at].is_ascii_digit()).collect();
    let Some(&at) = digits.get(random.usize(..digits.len().max(1))) else { return bytes.to_vec() };
    let count = 1 + random.usize(..12);
    let mut inflated = Vec::new();
    for (index, &byte) in bytes.iter().enumerate() {
        inflated.push(byte);
        if index > 0 && bytes[index - 1..].starts_with(&bytes[at - 1..=at + 1]) {
            inflated.extend(std::iter::repeat_n(b'9', count));
        }
    }
    inflated
}
