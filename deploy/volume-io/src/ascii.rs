//! Words of a text, one at a time, so that a large array written as text is never held whole.

use crate::error::invalid;
use std::io::{self, BufRead};

/// Longer than any number a program writes: a binary file taken for text is noticed here.
const LONGEST_WORD: usize = 400;

/// The words of a text, separated by white space.
pub(crate) struct Words<'a> {
    text: &'a mut dyn BufRead,
    word: Vec<u8>,
}

impl<'a> Words<'a> {
    pub(crate) fn of(text: &'a mut dyn BufRead) -> Self {
        Self { text, word: Vec::new() }
    }

    /// The next word, or none at the end of the text.
    pub(crate) fn next(&mut self) -> io::Result<Option<&str>> {
        self.word.clear();
        loop {
            let ahead = self.text.fill_buf()?;
            if ahead.is_empty() {
                break;
            }
            let skipped = if self.word.is_empty() { blanks(ahead) } else { 0 };
            let letters = ahead[skipped..].iter().take_while(|b| !b.is_ascii_whitespace()).count();
            let used = skipped + letters;
            let complete = letters > 0 && used < ahead.len() || letters == 0 && !self.word.is_empty();
            self.word.extend_from_slice(&ahead[skipped..used]);
            self.text.consume(used);
            if self.word.len() > LONGEST_WORD {
                return Err(invalid("text was expected where there is none"));
            }
            if complete {
                break;
            }
        }
        if self.word.is_empty() {
            return Ok(None);
        }
        std::str::from_utf8(&self.word).map(Some).map_err(|_| invalid("text was expected where there is none"))
    }
}

fn blanks(text: &[u8]) -> usize {
    text.iter().take_while(|b| b.is_ascii_whitespace()).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::BufReader;

    #[test]
    fn words_come_whole_whatever_the_buffer() {
        for capacity in 1..12 {
            let mut text = BufReader::with_capacity(capacity, &b" 12\n-3.5e+7\t\tnan  x "[..]);
            let mut words = Words::of(&mut text);
            for want in [Some("12"), Some("-3.5e+7"), Some("nan"), Some("x"), None, None] {
                assert_eq!(words.next().unwrap(), want, "buffer of {capacity}");
            }
        }
    }

    #[test]
    fn an_endless_word_is_refused() {
        let bytes = vec![b'7'; 1 << 20];
        assert!(Words::of(&mut &bytes[..]).next().is_err());
    }
}
