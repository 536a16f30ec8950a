//! Conditions: expressions of a step's statistics and of those of steps before, compared.

use exmex::{BinOp, Express, FlatEx, FloatOpsFactory, MakeOperators, Operator};
use lamina_model::Diagnostics;
use std::collections::VecDeque;

/// What is known of a step.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Quantity {
    Step,
    Time,
    Min,
    Max,
    Mean,
    /// Bits.
    Entropy,
    /// Voxels that are NaN or infinite.
    Missing,
    /// From the step before, in ranges.
    Change,
    /// Encoded kilobytes.
    Size,
    /// Milliseconds of generation.
    Generation,
    /// Decibels of the newest step that a viz-node has measured; NaN before any.
    Psnr,
    /// Whether that step kept the contract's limits, 1 or 0; NaN before any.
    Kept,
    /// The value below which such a share of the voxels lies.
    Quantile(f64),
    /// What the simulation tells under this name; NaN where it does not.
    Diagnostic(String),
}

/// What a condition calls them, and what it says of each.
const NAMES: [(&str, Quantity); 12] = [
    ("step", Quantity::Step),
    ("time", Quantity::Time),
    ("min", Quantity::Min),
    ("max", Quantity::Max),
    ("mean", Quantity::Mean),
    ("entropy", Quantity::Entropy),
    ("missing", Quantity::Missing),
    ("change", Quantity::Change),
    ("size", Quantity::Size),
    ("generation", Quantity::Generation),
    ("psnr", Quantity::Psnr),
    ("kept", Quantity::Kept),
];

/// What a variable of the expression stands for: a quantity, at which steps.
#[derive(Debug, Clone, Copy, PartialEq)]
enum When {
    Now,
    Before,
    MaxOver(usize),
    MinOver(usize),
    MeanOver(usize),
}

/// The most steps that a condition looks back.
const LONGEST: usize = 1000;

/// Arithmetic with comparisons, which are 1 or 0.
#[derive(Debug, Clone)]
struct Comparisons;

impl MakeOperators<f64> for Comparisons {
    fn make<'a>() -> Vec<Operator<'a, f64>> {
        let binary = |repr, prio, apply| Operator::make_bin(repr, BinOp { apply, prio, is_commutative: false });
        let mut all = FloatOpsFactory::<f64>::make();
        // Maximum and minimum are quantities here.
        all.retain(|op| !NAMES.iter().any(|(name, _)| *name == op.repr()));
        all.extend([
            binary("||", -4, |a, b| f64::from(a != 0.0 || b != 0.0)),
            binary("&&", -3, |a, b| f64::from(a != 0.0 && b != 0.0)),
            binary("==", -2, |a, b| f64::from(a == b)),
            binary("!=", -2, |a, b| f64::from(a != b)),
            binary("<", -1, |a, b| f64::from(a < b)),
            binary("<=", -1, |a, b| f64::from(a <= b)),
            binary(">", -1, |a, b| f64::from(a > b)),
            binary(">=", -1, |a, b| f64::from(a >= b)),
        ]);
        all
    }
}

/// A condition, and the quantities of the steps that it looks back at.
#[derive(Debug, Clone)]
pub(super) struct Condition {
    expression: FlatEx<f64, Comparisons>,
    /// Variable `v0`, `v1`, ..: the index of its quantity, and at which steps.
    variables: Vec<(usize, When)>,
    quantities: Vec<Quantity>,
    /// Their values, the newest step's last.
    history: VecDeque<Vec<f64>>,
}

impl Condition {
    /// Reads a condition.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let mut reader = Reader { rest: text, plain: String::new(), variables: Vec::new(), quantities: Vec::new() };
        reader.read()?;
        let Reader { plain, variables, quantities, .. } = reader;
        if variables.is_empty() && plain.chars().all(|c| !c.is_ascii_alphabetic()) {
            return Err(format!("{text}: depends on nothing"));
        }
        let expression = FlatEx::<f64, Comparisons>::parse(&plain).map_err(|e| format!("{text}: {e}"))?;
        if let Some(unknown) = expression.var_names().iter().find(|name| number(name, variables.len()).is_none()) {
            return Err(self::unknown(unknown));
        }
        if variables.is_empty() {
            return Err(format!("{text}: depends on nothing"));
        }
        Ok(Self { expression, variables, quantities, history: VecDeque::new() })
    }

    /// Forgets the steps before.
    pub(super) fn forget(&mut self) {
        self.history.clear();
    }

    /// Whether it is true at a step of which `value` says the quantities. What has no value, as before the first step, compares as false.
    pub(super) fn evaluate(&mut self, value: &dyn Fn(&Quantity) -> f64) -> bool {
        self.history.push_back(self.quantities.iter().map(value).collect());
        let reach = self.variables.iter().map(|(_, when)| when.reach()).max().unwrap_or(1);
        while self.history.len() > reach {
            self.history.pop_front();
        }
        let values: Vec<f64> = self
            .expression
            .var_names()
            .iter()
            .map(|name| number(name, self.variables.len()).map_or(f64::NAN, |n| self.of(self.variables[n])))
            .collect();
        self.expression.eval(&values).is_ok_and(|v| v != 0.0 && !v.is_nan())
    }

    fn of(&self, (quantity, when): (usize, When)) -> f64 {
        let newest = |n: usize| self.history.iter().rev().take(n).map(move |step| step[quantity]);
        match when {
            When::Now => newest(1).next().unwrap_or(f64::NAN),
            When::Before => newest(2).nth(1).unwrap_or(f64::NAN),
            When::MaxOver(n) => newest(n).fold(f64::NAN, f64::max),
            When::MinOver(n) => newest(n).fold(f64::NAN, f64::min),
            When::MeanOver(n) => newest(n).sum::<f64>() / newest(n).count() as f64,
        }
    }
}

impl When {
    /// Steps that have to be remembered.
    fn reach(self) -> usize {
        match self {
            Self::Now => 1,
            Self::Before => 2,
            Self::MaxOver(n) | Self::MinOver(n) | Self::MeanOver(n) => n,
        }
    }
}

/// The number of a variable `v0`, `v1`, ..
fn number(name: &str, count: usize) -> Option<usize> {
    name.strip_prefix('v')?.parse().ok().filter(|n| *n < count)
}

/// Puts a variable in the place of each quantity, with what is about it.
struct Reader<'a> {
    rest: &'a str,
    plain: String,
    variables: Vec<(usize, When)>,
    quantities: Vec<Quantity>,
}

impl<'a> Reader<'a> {
    fn read(&mut self) -> Result<(), String> {
        while let Some(first) = self.rest.chars().next() {
            if first.is_ascii_alphabetic() {
                match self.take(|c| c.is_ascii_alphanumeric() || c == '_') {
                    word @ ("prev" | "max_over" | "min_over" | "mean_over") => self.look_back(word)?,
                    word if is_quantity(word) => {
                        let quantity = self.quantity(word)?;
                        self.put(quantity, When::Now);
                    }
                    // What variables are called here.
                    word if number(word, usize::MAX).is_some() => return Err(unknown(word)),
                    // A function, a constant, or what nobody knows.
                    word => self.plain.push_str(word),
                }
            } else if first.is_ascii_digit() {
                let numeral = self.numeral();
                let value: f64 = numeral.parse().map_err(|_| format!("{numeral}: no number"))?;
                // Without an exponent, which the expression's parser does not know.
                self.plain.push_str(&value.to_string());
            } else {
                self.plain.push(first);
                self.rest = &self.rest[first.len_utf8()..];
            }
        }
        Ok(())
    }

    /// Takes what belongs together off the front.
    fn take(&mut self, belongs: impl FnMut(char) -> bool) -> &'a str {
        let mut belongs = belongs;
        let (taken, rest) = self.rest.split_at(self.rest.find(|c| !belongs(c)).unwrap_or(self.rest.len()));
        self.rest = rest;
        taken
    }

    /// Takes a number, such as 1e-3.
    fn numeral(&mut self) -> &'a str {
        let mut before = ' ';
        self.take(|c| {
            let belongs =
                c.is_ascii_digit() || c == '.' || "eE".contains(c) || "+-".contains(c) && "eE".contains(before);
            before = c;
            belongs
        })
    }

    /// Takes `symbol`, with blanks before it.
    fn expect(&mut self, symbol: char, of: &str) -> Result<(), String> {
        self.take(char::is_whitespace);
        self.rest = self.rest.strip_prefix(symbol).ok_or_else(|| format!("{of}: '{symbol}' is missing"))?;
        self.take(char::is_whitespace);
        Ok(())
    }

    /// The number of quantity `word`, whose argument follows if it has one.
    fn quantity(&mut self, word: &str) -> Result<usize, String> {
        let quantity = match NAMES.iter().find(|(name, _)| *name == word) {
            Some((_, quantity)) => quantity.clone(),
            None if word == "quantile" => {
                self.expect('(', word)?;
                let share = self.numeral().parse().ok().filter(|p| (0.0..=1.0).contains(p));
                self.expect(')', word)?;
                Quantity::Quantile(share.ok_or("quantile(p): p is a number from 0 to 1")?)
            }
            None if word == "diagnostic" => {
                self.expect('(', word)?;
                let name = self.take(|c| c.is_ascii_alphanumeric() || c == '_');
                self.expect(')', word)?;
                if !Diagnostics::is_name(name) {
                    return Err(format!("diagnostic({name}): a name has letters, digits and _, a letter first"));
                }
                Quantity::Diagnostic(name.to_owned())
            }
            None => return Err(format!("{word}: no quantity of a step")),
        };
        let known = self.quantities.iter().position(|q| *q == quantity);
        Ok(known.unwrap_or_else(|| {
            self.quantities.push(quantity);
            self.quantities.len() - 1
        }))
    }

    /// `prev(quantity)`, `max_over(quantity, steps)` and the like.
    fn look_back(&mut self, function: &str) -> Result<(), String> {
        self.expect('(', function)?;
        let word = self.take(|c| c.is_ascii_alphanumeric() || c == '_');
        let quantity = self.quantity(word)?;
        let when = if function == "prev" {
            When::Before
        } else {
            self.expect(',', function)?;
            let steps = self.take(|c| c.is_ascii_digit()).parse().ok().filter(|n| (1..=LONGEST).contains(n));
            let steps =
                steps.ok_or_else(|| format!("{function}({word}, n): n is a number of steps from 1 to {LONGEST}"))?;
            match function {
                "max_over" => When::MaxOver(steps),
                "min_over" => When::MinOver(steps),
                _ => When::MeanOver(steps),
            }
        };
        self.expect(')', function)?;
        self.put(quantity, when);
        Ok(())
    }

    /// Puts a variable there.
    fn put(&mut self, quantity: usize, when: When) {
        let known = self.variables.iter().position(|v| *v == (quantity, when));
        let n = known.unwrap_or_else(|| {
            self.variables.push((quantity, when));
            self.variables.len() - 1
        });
        self.plain.push_str(&format!("v{n}"));
    }
}

fn unknown(word: &str) -> String {
    let names: Vec<&str> = NAMES.iter().map(|(name, _)| *name).collect();
    format!("\"{word}\" is none of {}, quantile(p), diagnostic(name)", names.join(", "))
}

fn is_quantity(word: &str) -> bool {
    ["quantile", "diagnostic"].contains(&word) || NAMES.iter().any(|(name, _)| *name == word)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether the condition is true at each of steps whose maximum is that, and whose quantile p is p times it.
    fn holds(text: &str, maxima: &[f64]) -> Vec<bool> {
        let mut condition = Condition::parse(text).unwrap();
        let at = |(step, max): (usize, &f64)| {
            condition.evaluate(&|quantity| match quantity {
                Quantity::Step => step as f64,
                Quantity::Max => *max,
                Quantity::Quantile(p) => p * max,
                Quantity::Diagnostic(name) if name == "half" => max / 2.0,
                Quantity::Diagnostic(_) => f64::NAN,
                _ => 0.0,
            })
        };
        maxima.iter().enumerate().map(at).collect()
    }

    #[test]
    fn arithmetic_binds_before_comparison_and_that_before_and_and_or() {
        assert_eq!(holds("max + 1 > 2 * 3", &[5.0, 5.5]), [false, true]);
        assert_eq!(holds("max > 1 && step == 1 || max < -7", &[5.0, 5.0, -8.0]), [false, true, true]);
        assert_eq!(holds("abs(max) >= 1e+1 && max != 10", &[10.0, -10.0, 11.0]), [false, true, true]);
        assert_eq!(holds("(max > 1) + (max > 2) == 2", &[1.5, 2.5]), [false, true]);
        assert_eq!(holds("max - quantile(0.5) <= 2", &[4.0, 4.1]), [true, false]);
        assert_eq!(holds("-max > 3", &[3.5, -3.5]), [false, true]);
    }

    #[test]
    fn steps_before_are_looked_at() {
        assert_eq!(holds("max > 2 * prev(max)", &[1.0, 2.0, 5.0, 5.0]), [false, false, true, false]);
        assert_eq!(holds("max_over(max, 3) >= 4", &[4.0, 1.0, 1.0, 1.0]), [true, true, true, false]);
        assert_eq!(holds("min_over( max , 2 ) < 2 && max > 2", &[1.0, 3.0, 3.0]), [false, true, false]);
        assert_eq!(holds("mean_over(max, 2) == 2", &[1.0, 3.0, 1.0]), [false, true, true]);
        assert_eq!(holds("prev(quantile(0.5)) == 1", &[2.0, 8.0, 0.0]), [false, true, false]);
        assert_eq!(holds("diagnostic(half) > prev(diagnostic( half ))", &[2.0, 8.0, 0.0]), [false, true, false]);
        assert_eq!(holds("max_over(diagnostic(half), 2) == 4", &[8.0, 2.0, 2.0]), [true, true, false]);
        assert_eq!(holds("diagnostic(other) < 9 || diagnostic(other) >= 9", &[1.0, 1.0]), [false, false]);
        // Nothing before the first step: neither true nor an error.
        assert_eq!(holds("prev(max) < 9 || prev(max) >= 9", &[1.0, 1.0]), [false, true]);
    }

    #[test]
    fn what_cannot_be_is_refused_with_what_could() {
        for (text, word) in [
            ("ssim > 3", "ssim"),
            ("", "nothing"),
            ("1 > 2", "nothing"),
            ("max >", "max >"),
            ("prev(max", "')'"),
            ("prev max", "'('"),
            ("max_over(max)", "','"),
            ("max_over(max, 0)", "1 to 1000"),
            ("max_over(max, 99999)", "1 to 1000"),
            ("quantile(2) > 1", "0 to 1"),
            ("quantile > 1", "'('"),
            ("diagnostic > 1", "'('"),
            ("diagnostic(1) > 1", "letter first"),
            ("diagnostic(a b) > 1", "')'"),
            ("half > 1", "diagnostic(name)"),
            ("prev(prev(max)) > 1", "prev"),
            ("v0 > max", "\"v0\""),
            ("max > 1; max", "max"),
            ("max > \u{1f4a5}", "max"),
        ] {
            let error = Condition::parse(text).err();
            assert!(error.as_ref().is_some_and(|e| e.contains(word)), "{text}: {error:?} does not say {word}");
        }
    }
}
