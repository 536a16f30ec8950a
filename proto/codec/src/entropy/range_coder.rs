//! A binary range coder whose interval is 64 bits wide, so that it is seldom widened, and then by four bytes at once.
//!
//! G. N. N. Martin, "Range encoding: an algorithm for removing redundancy from a digitised message", Video & Data
//! Recording Conference, 1979; a carry is added to the bytes that are already out.

/// What is coded or read: the one place where both differ.
pub trait Coder {
    /// Codes `bit`, which is set with `probability` in 1/65536 (32..=65504), or reads and returns the next one.
    fn at(&mut self, probability: u32, bit: bool) -> bool;

    /// Codes the lowest `count` bits of `number`, at most 16, all as likely, or reads them.
    fn even(&mut self, count: u32, number: u32) -> u32;
}

/// The interval is widened when it is narrower.
const NARROW: u64 = 1 << 32;

/// Codes decisions into bytes.
#[derive(Debug)]
pub struct Encoder {
    low: u64,
    range: u64,
    out: Vec<u8>,
}

impl Default for Encoder {
    fn default() -> Self {
        Self { low: 0, range: u64::MAX, out: Vec::new() }
    }
}

impl Encoder {
    /// The part of the interval that starts at `start` and is `range` wide.
    #[inline(always)]
    fn narrow(&mut self, start: u64, range: u64) {
        let (low, carry) = self.low.overflowing_add(start);
        (self.low, self.range) = (low, range);
        if carry {
            self.carry();
        }
        if self.range < NARROW {
            self.out.extend_from_slice(&((self.low >> 32) as u32).to_be_bytes());
            self.low <<= 32;
            self.range <<= 32;
        }
    }

    #[cold]
    fn carry(&mut self) {
        for byte in self.out.iter_mut().rev() {
            *byte = byte.wrapping_add(1);
            if *byte != 0 {
                break;
            }
        }
    }

    /// The bytes of all decisions so far.
    pub fn finish(mut self) -> Vec<u8> {
        // The shortest number inside the interval; what a decoder reads beyond the end are zeros.
        for zeros in (0..64).step_by(8).rev() {
            let below = (1_u64 << zeros) - 1;
            let up = (below - (self.low & below)).wrapping_add(1) & below;
            if up < self.range {
                let (low, carry) = self.low.overflowing_add(up);
                if carry {
                    self.carry();
                }
                self.out.extend_from_slice(&low.to_be_bytes());
                break;
            }
        }
        let end = self.out.iter().rposition(|&byte| byte != 0).map_or(0, |last| last + 1);
        self.out.truncate(end);
        self.out
    }
}

impl Coder for Encoder {
    #[inline(always)]
    fn at(&mut self, probability: u32, bit: bool) -> bool {
        let split = (self.range >> 16) * u64::from(probability);
        if bit {
            self.narrow(0, split)
        } else {
            self.narrow(split, self.range - split)
        }
        bit
    }

    #[inline]
    fn even(&mut self, count: u32, number: u32) -> u32 {
        let part = self.range >> count;
        let number = number & ((1 << count) - 1);
        self.narrow(part * u64::from(number), part);
        number
    }
}

/// Reads decisions back. Bytes cut short read as zeros.
#[derive(Debug)]
pub struct Decoder<'a> {
    /// Where in the interval the bytes are.
    code: u64,
    range: u64,
    bytes: &'a [u8],
}

impl<'a> Decoder<'a> {
    /// Starts at the first decision in `bytes`.
    pub fn new(bytes: &'a [u8]) -> Self {
        let mut decoder = Self { code: 0, range: u64::MAX, bytes };
        decoder.code = decoder.four() << 32 | decoder.four();
        decoder
    }

    #[inline(always)]
    fn four(&mut self) -> u64 {
        if let Some((four, rest)) = self.bytes.split_first_chunk() {
            self.bytes = rest;
            return u64::from(u32::from_be_bytes(*four));
        }
        let mut four = [0; 4];
        four[..self.bytes.len()].copy_from_slice(self.bytes);
        self.bytes = &[];
        u64::from(u32::from_be_bytes(four))
    }

    #[inline(always)]
    fn widen(&mut self) {
        if self.range < NARROW {
            self.code = self.code << 32 | self.four();
            self.range <<= 32;
        }
    }
}

impl Coder for Decoder<'_> {
    #[inline(always)]
    fn at(&mut self, probability: u32, _: bool) -> bool {
        let split = (self.range >> 16) * u64::from(probability);
        let bit = self.code < split;
        if bit {
            self.range = split;
        } else {
            self.code -= split;
            self.range -= split;
        }
        self.widen();
        bit
    }

    #[inline]
    fn even(&mut self, count: u32, _: u32) -> u32 {
        let part = self.range >> count;
        // Garbage may lie beyond the last part.
        let number = (self.code / part).min((1 << count) - 1);
        self.code -= number * part;
        self.range = part;
        self.widen();
        number as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Probabilities, bits and numbers of a linear congruential generator.
    fn decisions(n: usize) -> Vec<(u32, bool, u32)> {
        let next = |s: &mut u64| {
            *s = s.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            let probability = [32, 65504, 1 << 15, 60_000][(*s >> 62) as usize];
            Some((probability, (*s >> 40 & 65535) < u64::from(probability), (*s >> 20 & 0xffff) as u32))
        };
        (0..n).scan(7_u64, |s, _| next(s)).collect()
    }

    #[test]
    fn decisions_come_back() {
        for n in (0..200).chain([100_000]) {
            let decisions = decisions(n);
            let mut encoder = Encoder::default();
            for &(probability, bit, number) in &decisions {
                encoder.at(probability, bit);
                encoder.even(number % 17, number);
            }
            let bytes = encoder.finish();
            let mut decoder = Decoder::new(&bytes);
            for &(probability, bit, number) in &decisions {
                assert_eq!(decoder.at(probability, false), bit);
                let count = number % 17;
                assert_eq!(decoder.even(count, 0), number & ((1 << count) - 1));
            }
        }
    }

    #[test]
    fn likely_decisions_take_few_bytes_and_carries_are_carried() {
        let mut encoder = Encoder::default();
        // Always the upper end of the interval, where carries arise.
        (0..10_000).for_each(|_| _ = encoder.at(32, false));
        encoder.even(16, 0xffff);
        let bytes = encoder.finish();
        assert!(bytes.len() < 16, "{} bytes", bytes.len());
        let mut decoder = Decoder::new(&bytes);
        assert!((0..10_000).all(|_| !decoder.at(32, true)));
        assert_eq!(decoder.even(16, 0), 0xffff);
    }
}
