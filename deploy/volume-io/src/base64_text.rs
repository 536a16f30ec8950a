//! Bytes behind base64 text as VTK writes it: units that are each padded on their own, one after another.
//!
//! A plain decoder stops at the first padding; here the number in front of an array may be its own unit or not.

use crate::error::invalid;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::io::{self, BufRead, Read};

/// The bytes that `text` stands for, up to its end or to the next markup.
pub(crate) struct Base64Text<R> {
    text: R,
    /// Characters not yet decoded; fewer than four between two calls.
    characters: Vec<u8>,
    bytes: Vec<u8>,
    taken: usize,
    ended: bool,
}

impl<R: BufRead> Base64Text<R> {
    pub(crate) fn new(text: R) -> Self {
        Self { text, characters: Vec::new(), bytes: Vec::new(), taken: 0, ended: false }
    }

    fn refill(&mut self) -> io::Result<()> {
        self.bytes.clear();
        self.taken = 0;
        while !self.ended && self.characters.len() < 4 {
            let ahead = self.text.fill_buf()?;
            let text = ahead.split(|&b| b == b'<').next().unwrap_or_default();
            self.ended = ahead.is_empty() || text.len() < ahead.len();
            self.characters.extend(text.iter().filter(|b| !b.is_ascii_whitespace()));
            let used = ahead.len();
            self.text.consume(used);
        }
        let whole = self.characters.len() / 4 * 4;
        if whole == 0 && !self.characters.is_empty() {
            return Err(invalid("the base64 text ends within a group of four"));
        }
        let mut from = 0;
        while from < whole {
            let rest = &self.characters[from..whole];
            // A padded group ends its unit: what follows starts afresh.
            let unit = rest.iter().position(|&b| b == b'=').map_or(rest.len(), |at| at / 4 * 4 + 4);
            STANDARD.decode_vec(&rest[..unit], &mut self.bytes).map_err(|e| invalid(format!("base64 text: {e}")))?;
            from += unit;
        }
        self.characters.drain(..whole);
        Ok(())
    }
}

impl<R: BufRead> Read for Base64Text<R> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        if self.taken == self.bytes.len() {
            self.refill()?;
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
    use std::io::BufReader;

    fn decoded(text: &str, capacity: usize) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        Base64Text::new(BufReader::with_capacity(capacity, text.as_bytes())).read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    #[test]
    fn padded_units_follow_one_another_and_blanks_do_not_count() {
        let text =
            format!(" {}\n {} {}</DataArray>!", STANDARD.encode("a"), STANDARD.encode("bc"), STANDARD.encode("def"));
        for capacity in 1..40 {
            assert_eq!(decoded(&text, capacity).unwrap(), b"abcdef", "buffer of {capacity}");
        }
    }

    #[test]
    fn a_broken_group_is_refused() {
        assert!(decoded("QUJ", 8).is_err());
        assert!(decoded("QU J*", 8).is_err());
    }
}
