//! The processor time that a user grants a node, as a number of cores or a percentage of the machine's.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;
use std::thread::available_parallelism;

/// Number of cores that a node may use: above 0, at most the machine's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Written", into = "String")]
pub struct CpuLimit {
    cores: f64,
}

/// An invalid setting of a CPU limit.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("cpu_share: \"{text}\" {reason}; write cores such as 0.5, or percent of this machine's cores such as 25%")]
pub struct InvalidCpuLimit {
    text: String,
    reason: String,
}

/// A CPU limit as written in a configuration file.
#[derive(Deserialize)]
#[serde(untagged)]
enum Written {
    Cores(f64),
    Text(String),
}

impl Default for CpuLimit {
    /// A quarter of the cores, at least half a core.
    fn default() -> Self {
        Self { cores: (0.25 * Self::machine()).max(0.5) }
    }
}

impl CpuLimit {
    /// Number of cores of this machine that this process may run on.
    pub fn machine() -> f64 {
        available_parallelism().map_or(1.0, |n| n.get() as f64)
    }

    /// All cores of the machine.
    pub fn all() -> Self {
        Self { cores: Self::machine() }
    }

    /// Twice this limit, at most the machine's cores: for two nodes in one process.
    #[must_use]
    pub fn doubled(self) -> Self {
        Self { cores: (2.0 * self.cores).min(Self::machine()) }
    }

    /// Number of cores, possibly fractional.
    pub fn cores(self) -> f64 {
        self.cores
    }
}

impl FromStr for CpuLimit {
    type Err = InvalidCpuLimit;

    fn from_str(text: &str) -> Result<Self, InvalidCpuLimit> {
        let refuse = |reason: String| InvalidCpuLimit { text: text.to_owned(), reason };
        let machine = Self::machine();
        let (number, of) = match text.trim().strip_suffix('%') {
            Some(percent) => (percent, machine / 100.0),
            None => (text.trim(), 1.0),
        };
        let number: f64 = number.trim().parse().map_err(|_| refuse("is no number of cores".to_owned()))?;
        let cores = number * of;
        if !(cores > 0.0 && cores.is_finite()) {
            return Err(refuse("leaves nothing to work with".to_owned()));
        }
        if cores > machine {
            return Err(refuse(format!("is more than the {machine} cores there are")));
        }
        Ok(Self { cores })
    }
}

impl TryFrom<Written> for CpuLimit {
    type Error = InvalidCpuLimit;
    fn try_from(written: Written) -> Result<Self, InvalidCpuLimit> {
        match written {
            Written::Cores(cores) => cores.to_string().parse(),
            Written::Text(text) => text.parse(),
        }
    }
}

impl From<CpuLimit> for String {
    fn from(limit: CpuLimit) -> Self {
        limit.to_string()
    }
}

impl fmt::Display for CpuLimit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.cores)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Deserialize)]
    struct File {
        cpu_share: CpuLimit,
    }

    #[test]
    fn cores_and_percent_are_read_and_what_cannot_be_is_refused_with_the_remedy() {
        let machine = CpuLimit::machine();
        let read = |text: &str| toml::from_str::<File>(text).map(|f| f.cpu_share.cores());
        assert_eq!(read("cpu_share = 0.5").unwrap(), 0.5);
        assert_eq!(read("cpu_share = \"50%\"").unwrap(), 0.5 * machine);
        assert_eq!("100%".parse::<CpuLimit>().unwrap(), CpuLimit::all());
        assert!(CpuLimit::default().cores() >= 0.5);
        for bad in ["0", "-1", "nan", "inf", "0%", "101%", "many", "", &(machine + 0.5).to_string()] {
            let error = bad.parse::<CpuLimit>().unwrap_err().to_string();
            assert!(error.contains("cpu_share") && error.contains("write cores"), "{bad}: {error}");
        }
    }
}
