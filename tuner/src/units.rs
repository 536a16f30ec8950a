//! Sizes and times as people write them.

use std::str::FromStr;

/// A number of bytes: `300kB`, `1.5MB`, `2MiB`, `4096`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bytes(pub u64);

/// A time in milliseconds: `40ms`, `500us`, `0.5s`, `25`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Millis(pub f64);

/// Splits `text` into its number and unit; the number must be finite and positive.
fn number_and_unit(text: &str) -> Option<(f64, &str)> {
    let end = text.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(text.len());
    let number: f64 = text[..end].parse().ok()?;
    (number.is_finite() && number > 0.0).then_some((number, text[end..].trim()))
}

impl std::fmt::Display for Bytes {
    /// To the last byte: `300kB`, `252.5kB`, `1.000001MB`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 {
            bytes @ 0..1_000 => write!(f, "{bytes}B"),
            bytes @ 1_000..1_000_000 => write!(f, "{}kB", bytes as f64 / 1e3),
            bytes => write!(f, "{}MB", bytes as f64 / 1e6),
        }
    }
}

impl FromStr for Bytes {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let help = || format!("\"{text}\" is not a size; write 300kB, 1.5MB, 512KiB, 2MiB or a number of bytes");
        let (number, unit) = number_and_unit(text).ok_or_else(help)?;
        let factor = match unit {
            "" | "B" => 1.0,
            "kB" | "KB" => 1e3,
            "MB" => 1e6,
            "GB" => 1e9,
            "KiB" => 1024.0,
            "MiB" => 1024.0 * 1024.0,
            "GiB" => 1024.0 * 1024.0 * 1024.0,
            _ => return Err(help()),
        };
        let bytes = (number * factor).round();
        if (1.0..1e18).contains(&bytes) { Ok(Self(bytes as u64)) } else { Err(help()) }
    }
}

impl FromStr for Millis {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let help = || format!("\"{text}\" is not a time; write 40ms, 500us, 0.5s or a number of milliseconds");
        let (number, unit) = number_and_unit(text).ok_or_else(help)?;
        match unit {
            "" | "ms" => Ok(Self(number)),
            "s" => Ok(Self(number * 1e3)),
            "us" => Ok(Self(number * 1e-3)),
            _ => Err(help()),
        }
    }
}

/// Bytes for people: three digits and a unit.
pub fn show_bytes(bytes: u64) -> String {
    match bytes as f64 {
        b if b < 1e3 => format!("{bytes} B"),
        b if b < 1e6 => format!("{:.1} kB", b / 1e3),
        b if b < 1e9 => format!("{:.2} MB", b / 1e6),
        b => format!("{:.2} GB", b / 1e9),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_and_times_are_read_and_nonsense_refused() {
        assert_eq!("300kB".parse(), Ok(Bytes(300_000)));
        assert_eq!("1.5 MB".parse(), Ok(Bytes(1_500_000)));
        assert_eq!("2MiB".parse(), Ok(Bytes(2_097_152)));
        assert_eq!("4096".parse(), Ok(Bytes(4096)));
        assert_eq!("0.5s".parse(), Ok(Millis(500.0)));
        assert_eq!("40ms".parse(), Ok(Millis(40.0)));
        assert_eq!("500us".parse(), Ok(Millis(0.5)));
        for bad in ["", "kB", "-3kB", "3 parsecs", "0", "1e99GB", "nan"] {
            assert!(bad.parse::<Bytes>().is_err() && bad.parse::<Millis>().is_err(), "{bad}");
        }
    }
}
