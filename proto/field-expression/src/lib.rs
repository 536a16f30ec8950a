//! Scalars computed from named fields: what a user writes, such as `magnitude(curl(v)) / rho`, and its values on a grid.
//!
//! Fields are scalars; those named `v.x`, `v.y`, `v.z` are together the vector `v`. Derivatives are central differences between
//! neighboring sample points, one-sided at the grid's ends, in world units; along an axis of one point they are 0. Arithmetic is in
//! double precision; what a derivative is taken of, unless it is a field itself, is kept in single precision, and so is the result.

mod evaluate;
mod parse;
mod program;

use lamina_model::{Grid, Invalid, Scene, Volume, Voxels};
use program::{Op, Program};
use std::collections::BTreeSet;

/// An expression over the fields of a run or a file, checked against their names.
#[derive(Debug, Clone)]
pub struct FieldExpression {
    program: Program,
}

impl FieldExpression {
    /// What may be written, for people to read.
    pub const GRAMMAR: &str = "fields, numbers, + - * / ^ and parentheses; sqrt, abs, exp, log, log10, min(a, b), max(a, b); vectors: \
        v for v.x, v.y and v.z, vector(a, b, c), magnitude, dot, cross, gradient, divergence, curl, lambda2, q_criterion, .x .y .z";

    /// Reads `text`, whose fields are among `names`; the name of a field alone stands for it, whatever its letters are.
    ///
    /// # Errors
    /// If it is no expression, names a field that is not there, or gives a vector.
    pub fn new(text: &str, names: &[&str]) -> Result<Self, Invalid> {
        let compiled = match names.iter().position(|name| *name == text.trim()) {
            Some(field) => Ok(Program::of_field(field)),
            None => parse::parse(text)
                .map_err(|why| format!("{why}. Understood are {}", Self::GRAMMAR))
                .and_then(|syntax| Program::new(&syntax, names)),
        };
        let program = compiled.map_err(|why| {
            let reason = format!("\"{}\": {why}. Fields: {}", shortened(text), names.join(", "));
            Invalid::new("field", reason)
        })?;
        Ok(Self { program })
    }

    /// The fields that it reads, by their places among the names.
    pub fn sources(&self) -> BTreeSet<usize> {
        self.program.ops.iter().filter_map(|op| if let Op::Field(field) = op { Some(*field) } else { None }).collect()
    }

    /// The field that it is, unchanged.
    pub fn plain(&self) -> Option<usize> {
        match self.program.ops[self.program.root] {
            Op::Field(field) => Some(field),
            _ => None,
        }
    }

    /// How many sample points beside its own a value depends on, along each axis.
    pub fn reach(&self) -> usize {
        self.program.reach()
    }

    /// How many computed values are kept, in single precision for all points, while it is evaluated.
    pub fn kept(&self) -> usize {
        self.program.kept().len()
    }

    /// Its values on `grid`, single precision. `fields` has, at their places, at least its [`Self::sources`], with a scalar for each
    /// point.
    ///
    /// # Errors
    /// If one is not there, or has another number of scalars.
    pub fn evaluate(&self, grid: &Grid, fields: &[Option<Voxels>]) -> Result<Vec<f32>, Invalid> {
        for source in self.sources() {
            let have = fields.get(source).and_then(Option::as_ref).map_or(0, Voxels::len);
            if have != grid.voxels() {
                let reason = format!("field {source} has {have} values on a grid of {}", grid.voxels());
                return Err(Invalid::new("field", reason));
            }
        }
        Ok(evaluate::evaluate(&self.program, grid, fields))
    }
}

/// Of a text that may be long, its beginning.
fn shortened(text: &str) -> String {
    const MOST: usize = 80;
    if text.chars().count() <= MOST { text.to_owned() } else { text.chars().take(MOST).chain("..".chars()).collect() }
}

/// What is drawn of a run's or a file's fields: one expression, and perhaps a second, for colors.
#[derive(Debug, Clone)]
pub struct ShownFields {
    shown: FieldExpression,
    colors: Option<(String, FieldExpression)>,
}

impl ShownFields {
    /// `shown` and, if there is one, `colors`, over fields of these names.
    ///
    /// # Errors
    /// As of [`FieldExpression::new`]; of the colors it names `effects.color_field`.
    pub fn new(shown: &str, colors: Option<&str>, names: &[&str]) -> Result<Self, Invalid> {
        let of_colors = |text: &str| {
            let colors = FieldExpression::new(text, names).map_err(|e| Invalid::new("effects.color_field", e.reason));
            colors.map(|colors| (text.to_owned(), colors))
        };
        Ok(Self { shown: FieldExpression::new(shown, names)?, colors: colors.map(of_colors).transpose()? })
    }

    /// The same with the colors that `scene` asks for.
    ///
    /// # Errors
    /// As of [`Self::new`].
    pub fn under(shown: &str, scene: &Scene, names: &[&str]) -> Result<Self, Invalid> {
        Self::new(shown, scene.effects.color_field.as_ref().map(|map| map.name.as_str()), names)
    }

    fn expressions(&self) -> impl Iterator<Item = &FieldExpression> {
        std::iter::once(&self.shown).chain(self.colors.as_ref().map(|(_, colors)| colors))
    }

    /// The fields that are read, by their places among the names.
    pub fn sources(&self) -> BTreeSet<usize> {
        self.expressions().flat_map(FieldExpression::sources).collect()
    }

    /// True if colors come from a field.
    pub fn has_colors(&self) -> bool {
        self.colors.is_some()
    }

    /// The field that is shown, if it is one unchanged.
    pub fn plain(&self) -> Option<usize> {
        self.shown.plain()
    }

    /// True if something is computed.
    pub fn is_derived(&self) -> bool {
        self.expressions().any(|expression| expression.plain().is_none())
    }

    /// See [`FieldExpression::reach`].
    pub fn reach(&self) -> usize {
        self.expressions().map(FieldExpression::reach).max().unwrap_or(0)
    }

    /// Bytes for each point while it is made, beside the sources: what is computed and what is kept meanwhile.
    pub fn point_bytes(&self) -> usize {
        let floats = |e: &FieldExpression| if e.plain().is_some() { 0 } else { 1 + e.kept() };
        4 * self.expressions().map(floats).sum::<usize>()
    }

    /// What is drawn, made of `fields`, which has the [`Self::sources`] at their places.
    ///
    /// # Errors
    /// As of [`FieldExpression::evaluate`].
    pub fn volume(&self, grid: Grid, mut fields: Vec<Option<Voxels>>) -> Result<Volume, Invalid> {
        let colors = match &self.colors {
            // Another expression may need the same field.
            Some((name, colors)) => Some((name, values(colors, &grid, &fields)?)),
            None => None,
        };
        let shown = match self.shown.plain() {
            Some(field) => fields.get_mut(field).and_then(Option::take),
            None => None,
        };
        let volume = Volume::new(grid, shown.map_or_else(|| values(&self.shown, &grid, &fields), Ok)?)?;
        match colors {
            Some((name, colors)) => volume.with_color_field(name, colors),
            None => Ok(volume),
        }
    }
}

fn values(expression: &FieldExpression, grid: &Grid, fields: &[Option<Voxels>]) -> Result<Voxels, Invalid> {
    match expression.plain().and_then(|field| fields.get(field)?.clone()) {
        Some(voxels) => Ok(voxels),
        None => Ok(Voxels::F32(expression.evaluate(grid, fields)?)),
    }
}

#[cfg(test)]
mod tests;
