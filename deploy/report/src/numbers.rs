//! Numbers formatted for readers: rounded, with units, and with signs for infinite and missing values.

/// `value` to `digits` significant digits, without trailing zeros; digits before the point are never lost.
pub fn significant(value: f64, digits: i32) -> String {
    if !value.is_finite() {
        return if value == f64::INFINITY { "∞".into() } else { "–".into() };
    }
    if value == 0.0 {
        return "0".into();
    }
    let magnitude = value.abs().log10().floor() as i32;
    let decimals = (digits - 1 - magnitude).clamp(0, 17) as usize;
    let text = format!("{value:.decimals$}");
    if decimals == 0 { text } else { text.trim_end_matches('0').trim_end_matches('.').into() }
}

/// `value` with `decimals` places; infinity is written as its sign, and NaN as a dash.
pub fn fixed(value: f64, decimals: usize) -> String {
    if value.is_finite() { format!("{value:.decimals$}") } else { significant(value, 1) }
}

/// A size in B, kB or MB, to four significant digits.
pub fn bytes(bytes: f64) -> String {
    match bytes {
        b if b >= 1e6 => format!("{} MB", significant(b / 1e6, 4)),
        b if b >= 1e3 => format!("{} kB", significant(b / 1e3, 4)),
        b => format!("{} B", significant(b, 4)),
    }
}

/// Bytes as kilobytes, the unit of axes and table columns.
pub fn kilobytes(bytes: u64) -> f64 {
    bytes as f64 / 1e3
}

/// A PSNR in decibels with its unit, to two decimals.
pub fn decibels(psnr_db: f64) -> String {
    format!("{} dB", fixed(psnr_db, 2))
}

/// A count with commas between groups of three digits.
pub fn grouped(count: u64) -> String {
    let digits = count.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A count with its noun in singular or plural: "1 step", "2 steps".
pub fn counted(count: usize, noun: &str) -> String {
    format!("{} {noun}{}", grouped(count as u64), if count == 1 { "" } else { "s" })
}

/// The median of all values that are not NaN; `None` if there is none. Infinite values take part.
pub fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut sorted: Vec<f64> = values.filter(|v| !v.is_nan()).collect();
    sorted.sort_by(f64::total_cmp);
    let upper = *sorted.get(sorted.len() / 2)?;
    let lower = sorted[(sorted.len() - 1) / 2];
    // Equal values first: halving the sum of two infinities is fine, but of two huge numbers is not.
    Some(if lower == upper { upper } else { lower + 0.5 * (upper - lower) })
}

/// The smallest and largest finite value; `None` if there is none.
pub fn finite_range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values.filter(|v| v.is_finite()).fold(None, |range, v| {
        let (low, high) = range.unwrap_or((v, v));
        Some((low.min(v), high.max(v)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn significant_digits_lose_only_trailing_zeros() {
        for (value, digits, text) in [
            (0.0, 3, "0"),
            (0.012345, 3, "0.0123"),
            (0.0100, 3, "0.01"),
            (1200.0, 2, "1200"),
            (-2.5, 3, "-2.5"),
            (0.30000000000000004, 6, "0.3"),
            (f64::INFINITY, 3, "∞"),
            (f64::NAN, 3, "–"),
        ] {
            assert_eq!(significant(value, digits), text);
        }
    }

    #[test]
    fn sizes_choose_their_unit() {
        assert_eq!([bytes(999.0), bytes(1500.0), bytes(2.5e6)], ["999 B", "1.5 kB", "2.5 MB"]);
        assert_eq!([grouped(0), grouped(999), grouped(1000), grouped(1234567)], ["0", "999", "1,000", "1,234,567"]);
    }

    #[test]
    fn medians_of_none_odd_even_and_infinite() {
        let of = |v: &[f64]| median(v.iter().copied());
        assert_eq!(of(&[]), None);
        assert_eq!(of(&[f64::NAN]), None);
        assert_eq!(of(&[3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(of(&[4.0, 1.0, 2.0, 3.0]), Some(2.5));
        assert_eq!(of(&[f64::INFINITY, f64::INFINITY]), Some(f64::INFINITY));
        assert_eq!(of(&[f64::INFINITY, 1.0]), Some(f64::INFINITY));
    }
}
