//! Diagnostics: numbers that a simulation tells of a step beside its field, such as a residual or an energy.

use crate::Invalid;
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeMap;

/// The diagnostics of one step, by name. A value may be NaN or infinite: that a residual is may be the very thing to be seen.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[serde(transparent)]
pub struct Diagnostics(BTreeMap<String, f64>);

impl Diagnostics {
    /// The most of a step.
    pub const MOST: usize = 64;
    /// The longest name, bytes.
    pub const LONGEST_NAME: usize = 60;

    /// Sets one, in place of that of the same name.
    ///
    /// # Errors
    /// If the name is no identifier (letters, digits and `_`, a letter first) or too long, or there are [`Diagnostics::MOST`] others.
    pub fn set(&mut self, name: &str, value: f64) -> Result<(), Invalid> {
        if !Self::is_name(name) {
            let most = Self::LONGEST_NAME;
            let reason = format!("\"{name}\": a name has 1 to {most} letters, digits and _, a letter first");
            return Err(Invalid::new("diagnostic", reason));
        }
        if self.0.len() == Self::MOST && !self.0.contains_key(name) {
            return Err(Invalid::new("diagnostic", format!("\"{name}\": a step has at most {}", Self::MOST)));
        }
        self.0.insert(name.to_owned(), value);
        Ok(())
    }

    /// Whether a diagnostic may be called so.
    pub fn is_name(name: &str) -> bool {
        name.len() <= Self::LONGEST_NAME
            && name.starts_with(|c: char| c.is_ascii_alphabetic())
            && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
    }

    /// The value of `name`; `None` if the simulation did not tell it.
    pub fn get(&self, name: &str) -> Option<f64> {
        self.0.get(name).copied()
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Names and values, by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, f64)> {
        self.0.iter().map(|(name, value)| (name.as_str(), *value))
    }

    /// Takes in those of another rank, as many as there may be; false if some are left out.
    pub fn merge(&mut self, other: &Self) -> bool {
        other.iter().fold(true, |all, (name, value)| self.set(name, value).is_ok() && all)
    }
}

impl TryFrom<BTreeMap<String, f64>> for Diagnostics {
    type Error = Invalid;
    fn try_from(told: BTreeMap<String, f64>) -> Result<Self, Invalid> {
        let mut all = Self::default();
        told.iter().try_for_each(|(name, value)| all.set(name, *value))?;
        Ok(all)
    }
}

impl From<Diagnostics> for BTreeMap<String, f64> {
    fn from(told: Diagnostics) -> Self {
        told.0
    }
}

/// `name=value`, joined by semicolons.
impl std::fmt::Display for Diagnostics {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let all: Vec<String> = self.iter().map(|(name, value)| format!("{name}={value}")).collect();
        f.write_str(&all.join(";"))
    }
}

impl std::str::FromStr for Diagnostics {
    type Err = Invalid;
    fn from_str(text: &str) -> Result<Self, Invalid> {
        let mut all = Self::default();
        for pair in text.split(';').filter(|pair| !pair.is_empty()) {
            let (name, value) = pair.split_once('=').unwrap_or((pair, ""));
            let value = value.parse().map_err(|_| Invalid::new("diagnostic", format!("\"{pair}\": no number")))?;
            all.set(name, value)?;
        }
        Ok(all)
    }
}

/// JSON has no word for NaN: it reads as null there.
impl<'de> Deserialize<'de> for Diagnostics {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let told = BTreeMap::<String, Option<f64>>::deserialize(from)?;
        let told: BTreeMap<String, f64> = told.into_iter().map(|(name, of)| (name, of.unwrap_or(f64::NAN))).collect();
        told.try_into().map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_and_json_give_back_what_was_told() {
        let mut told = Diagnostics::default();
        for (name, value) in [("residual", 1.25e-9), ("dt", 0.1), ("E_kin", f64::INFINITY), ("dt", 0.05)] {
            told.set(name, value).unwrap();
        }
        assert_eq!(told.to_string(), "E_kin=inf;dt=0.05;residual=0.00000000125");
        assert_eq!(told.to_string().parse::<Diagnostics>().unwrap(), told);
        told.set("E_kin", f64::NAN).unwrap();
        for read in [told.to_string().parse().unwrap(), serde_json::from_value(serde_json::json!(told)).unwrap()] {
            let read: Diagnostics = read;
            assert!(read.get("E_kin").unwrap().is_nan());
            assert_eq!((read.get("dt"), read.get("residual"), read.get("mass")), (Some(0.05), Some(1.25e-9), None));
        }
        assert_eq!("".parse::<Diagnostics>().unwrap(), Diagnostics::default());
    }

    #[test]
    fn what_is_no_name_or_too_much_is_refused() {
        let mut told = Diagnostics::default();
        for name in ["", "a b", "1a", "_a", "a=b", "a;b", "a,b", "\u{e4}", &"a".repeat(61)] {
            assert!(told.set(name, 1.0).unwrap_err().to_string().contains("letters, digits"), "{name}");
        }
        for text in ["a", "a=", "a=x", "=1", "a b=1"] {
            assert!(text.parse::<Diagnostics>().is_err(), "{text}");
        }
        for n in 0..Diagnostics::MOST {
            told.set(&format!("n{n}"), 0.0).unwrap();
        }
        told.set("n0", 1.0).unwrap();
        let other = Diagnostics::try_from(BTreeMap::from([("one_more".to_owned(), 1.0)])).unwrap();
        assert!(told.set("one_more", 1.0).unwrap_err().to_string().contains("at most 64"));
        assert!(!told.merge(&other) && told.get("one_more").is_none());
        let known = Diagnostics::try_from(BTreeMap::from([("n1".to_owned(), 7.0)])).unwrap();
        assert!(told.merge(&known) && told.get("n1") == Some(7.0));
    }
}
