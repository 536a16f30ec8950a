//! Binary range coder with a 64-bit interval, which is renormalized by four bytes at a time.
//!
//! G. N. N. Martin, "Range encoding: an algorithm for removing redundancy from a digitised message", Video & Data
//! Recording Conference, 1979. Carries propagate into the bytes already written.

/// The operations that encoder and decoder have in common, so that one body of model code serves both: an encoder writes
/// the value that is passed, a decoder ignores it and returns the value read.
pub(crate) trait Coder {
    /// Codes `bit`, whose probability of being set is `probability` in 1/65536 (32..=65504). Returns the bit.
    fn code_bit(&mut self, probability: u32, bit: bool) -> bool;

    /// Codes the lowest `count` (at most 16) bits of `number` as equally likely values. Returns them.
    fn code_uniform(&mut self, count: u32, number: u32) -> u32;
}

/// A narrower interval is renormalized.
const MIN_RANGE: u64 = 1 << 32;

/// Range encoder: codes bits into a byte vector.
#[derive(Debug)]
pub(crate) struct Encoder {
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
    /// Replaces the interval by its part that begins `start` above its lower end and is `range` wide.
    #[inline(always)]
    fn select_interval(&mut self, start: u64, range: u64) {
        let (low, carry) = self.low.overflowing_add(start);
        (self.low, self.range) = (low, range);
        if carry {
            self.carry();
        }
        if self.range < MIN_RANGE {
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

    /// Ends the stream and returns the bytes of all bits coded.
    pub(crate) fn finish(mut self) -> Vec<u8> {
        // Choose the number inside the interval with the most trailing zero bytes: a decoder reads zeros beyond the end.
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
    fn code_bit(&mut self, probability: u32, bit: bool) -> bool {
        let split = (self.range >> 16) * u64::from(probability);
        if bit {
            self.select_interval(0, split)
        } else {
            self.select_interval(split, self.range - split)
        }
        bit
    }

    #[inline]
    fn code_uniform(&mut self, count: u32, number: u32) -> u32 {
        let part = self.range >> count;
        let number = number & ((1 << count) - 1);
        self.select_interval(part * u64::from(number), part);
        number
    }
}

/// Range decoder. Reads zeros beyond the end of its bytes.
#[derive(Debug)]
pub(crate) struct Decoder<'a> {
    /// Position of the coded number within the interval.
    code: u64,
    range: u64,
    bytes: &'a [u8],
}

/// Where a decoder is, without its bytes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Position {
    code: u64,
    range: u64,
    left: usize,
}

impl<'a> Decoder<'a> {
    /// A decoder at the first bit of `bytes`.
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        let mut decoder = Self { code: 0, range: u64::MAX, bytes };
        decoder.code = decoder.next_word() << 32 | decoder.next_word();
        decoder
    }

    /// Where it is, for [`Self::at`].
    pub(crate) fn position(&self) -> Position {
        Position { code: self.code, range: self.range, left: self.bytes.len() }
    }

    /// The decoder of `bytes` that was at `position`.
    pub(crate) fn at(position: Position, bytes: &'a [u8]) -> Self {
        let Position { code, range, left } = position;
        Self { code, range, bytes: &bytes[bytes.len() - left.min(bytes.len())..] }
    }

    #[inline(always)]
    fn next_word(&mut self) -> u64 {
        if let Some((word, rest)) = self.bytes.split_first_chunk() {
            self.bytes = rest;
            return u64::from(u32::from_be_bytes(*word));
        }
        let mut word = [0; 4];
        word[..self.bytes.len()].copy_from_slice(self.bytes);
        self.bytes = &[];
        u64::from(u32::from_be_bytes(word))
    }

    #[inline(always)]
    fn renormalize(&mut self) {
        if self.range < MIN_RANGE {
            self.code = self.code << 32 | self.next_word();
            self.range <<= 32;
        }
    }
}

impl Coder for Decoder<'_> {
    #[inline(always)]
    fn code_bit(&mut self, probability: u32, _: bool) -> bool {
        let split = (self.range >> 16) * u64::from(probability);
        let bit = self.code < split;
        if bit {
            self.range = split;
        } else {
            self.code -= split;
            self.range -= split;
        }
        self.renormalize();
        bit
    }

    #[inline]
    fn code_uniform(&mut self, count: u32, _: u32) -> u32 {
        let part = self.range >> count;
        // Corrupt bytes may point beyond the last part.
        let number = (self.code / part).min((1 << count) - 1);
        self.code -= number * part;
        self.range = part;
        self.renormalize();
        number as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Probabilities, bits and numbers, the same on every machine.
    fn decisions(n: usize) -> Vec<(u32, bool, u32)> {
        let mut random = fastrand::Rng::with_seed(7);
        let next = |_| {
            let probability = [32, 65504, 1 << 15, 60_000][random.usize(..4)];
            (probability, random.u32(..65536) < probability, random.u32(..65536))
        };
        (0..n).map(next).collect()
    }

    #[test]
    fn decisions_come_back() {
        for n in (0..200).chain([100_000]) {
            let decisions = decisions(n);
            let mut encoder = Encoder::default();
            for &(probability, bit, number) in &decisions {
                encoder.code_bit(probability, bit);
                encoder.code_uniform(number % 17, number);
            }
            let bytes = encoder.finish();
            let mut decoder = Decoder::new(&bytes);
            for &(probability, bit, number) in &decisions {
                decoder = Decoder::at(decoder.position(), &bytes);
                assert_eq!(decoder.code_bit(probability, false), bit);
                let count = number % 17;
                assert_eq!(decoder.code_uniform(count, 0), number & ((1 << count) - 1));
            }
        }
    }

    #[test]
    fn likely_decisions_take_few_bytes_and_carries_are_carried() {
        let mut encoder = Encoder::default();
        // Always the upper end of the interval, where carries arise.
        (0..10_000).for_each(|_| _ = encoder.code_bit(32, false));
        encoder.code_uniform(16, 0xffff);
        let bytes = encoder.finish();
        assert!(bytes.len() < 16, "{} bytes", bytes.len());
        let mut decoder = Decoder::new(&bytes);
        assert!((0..10_000).all(|_| !decoder.code_bit(32, true)));
        assert_eq!(decoder.code_uniform(16, 0), 0xffff);
    }
}
