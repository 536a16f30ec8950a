//! nu: what is best among what keeps the limits.

use exmex::{Express, FlatEx};
use lamina_model::Objective;
use std::fmt;

/// What is wanted.
#[doc(alias = "nu")]
#[derive(Debug, Clone)]
pub enum Utility {
    /// The highest q.
    Quality,
    /// The smallest sigma.
    Size,
    /// The shortest tau.
    Time,
    /// The highest value of an expression of `sigma` (kB), `q` (dB) and `tau` (ms).
    Expression(Box<FlatEx<f64>>),
}

/// Names that an expression may use, in the order it takes their values.
const VARIABLES: [&str; 3] = ["q", "sigma", "tau"];

impl Utility {
    /// Reads what is to be maximised, or minimised: `psnr`, `size`, `time`, or an expression.
    ///
    /// # Errors
    /// Says what is wrong with it.
    pub fn parse(maximise: bool, text: &str) -> Result<Self, String> {
        match (maximise, text.trim()) {
            (true, "psnr") => return Ok(Self::Quality),
            (false, "size") => return Ok(Self::Size),
            (false, "time") => return Ok(Self::Time),
            _ => {}
        }
        let text = if maximise { text.trim().to_owned() } else { format!("-({})", text.trim()) };
        let expression = FlatEx::<f64>::parse(&text).map_err(|e| e.to_string())?;
        if let Some(unknown) = expression.var_names().iter().find(|v| !VARIABLES.contains(&v.as_str())) {
            return Err(format!("\"{unknown}\" is none of q (dB), sigma (kB) and tau (ms)"));
        }
        if expression.var_names().is_empty() {
            return Err("a constant prefers nothing".to_owned());
        }
        Ok(Self::Expression(Box::new(expression)))
    }

    /// True if it depends on the size.
    pub fn weighs_size(&self) -> bool {
        match self {
            Self::Quality | Self::Time => false,
            Self::Size => true,
            Self::Expression(expression) => expression.var_names().iter().any(|v| v == "sigma"),
        }
    }

    /// What a generator-node has to know of it.
    pub fn objective(&self) -> Objective {
        match self {
            Self::Quality => Objective::Quality,
            Self::Size => Objective::Size,
            Self::Time | Self::Expression(_) => Objective::Time,
        }
    }

    /// Lower is better. Size in bytes, quality in decibels, time in milliseconds. +infinity where an expression has no value.
    pub fn cost(&self, size_bytes: u64, psnr_db: f64, time_ms: f64) -> f64 {
        let kilobytes = size_bytes as f64 / 1e3;
        match self {
            Self::Quality => -psnr_db,
            Self::Size => kilobytes,
            Self::Time => time_ms,
            Self::Expression(expression) => {
                let value = |name: &String| match name.as_str() {
                    "q" => psnr_db,
                    "sigma" => kilobytes,
                    _ => time_ms,
                };
                let values: Vec<f64> = expression.var_names().iter().map(value).collect();
                let utility = expression.eval(&values).unwrap_or(f64::NAN);
                // Where only the quality has no bound, neither may the utility.
                let none = utility.is_nan() || (utility.is_infinite() && psnr_db.is_finite());
                if none { f64::INFINITY } else { -utility }
            }
        }
    }
}

impl PartialEq for Utility {
    fn eq(&self, other: &Self) -> bool {
        self.to_string() == other.to_string()
    }
}

impl fmt::Display for Utility {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Quality => f.write_str("maximise psnr"),
            Self::Size => f.write_str("minimise size"),
            Self::Time => f.write_str("minimise time"),
            Self::Expression(expression) => write!(f, "maximise {}", expression.unparse()),
        }
    }
}
