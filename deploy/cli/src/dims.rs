//! Grid dimensions as people write them.

use std::str::FromStr;

/// Grid sides: `256x256x128`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Dims(pub [usize; 3]);

impl FromStr for Dims {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let sides: Option<Vec<usize>> = text.split('x').map(|s| s.parse().ok().filter(|&n| n > 0)).collect();
        let sides: Option<[usize; 3]> = sides.and_then(|s| s.try_into().ok());
        sides.map(Self).ok_or_else(|| format!("\"{text}\" is not a grid; write three sides such as 256x256x128"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_are_read_and_nonsense_refused() {
        assert_eq!("4x5x6".parse(), Ok(Dims([4, 5, 6])));
        assert!("4x5".parse::<Dims>().is_err() && "0x1x1".parse::<Dims>().is_err());
    }
}
