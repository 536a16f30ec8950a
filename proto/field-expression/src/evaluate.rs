//! A program's values, row by row.

use super::parse::Binary;
use super::program::{Id, Op, Program, Unary};
use lamina_model::{Grid, Voxels, for_voxels};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// What derivatives are taken of: values of all points.
enum ValueSource<'a> {
    Field(&'a Voxels),
    Kept(&'a [f32]),
}

impl ValueSource<'_> {
    /// Values from point `first` on.
    fn read(&self, first: usize, out: &mut [f64]) {
        let last = first + out.len();
        match self {
            Self::Field(voxels) => for_voxels!(voxels, v => convert(&v[first..last], out)),
            Self::Kept(v) => convert(&v[first..last], out),
        }
    }
}

fn convert<T: Copy + Into<f64>>(from: &[T], to: &mut [f64]) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to = (*from).into());
}

/// The values of the program's root on `grid`; `fields` has all that it reads.
pub(super) fn evaluate(program: &Program, grid: &Grid, fields: &[Option<Voxels>]) -> Vec<f32> {
    let mut values: BTreeMap<Id, Vec<f32>> = BTreeMap::new();
    for id in program.kept() {
        let computed = Stage::new(program, id, grid, fields, &values).compute();
        values.insert(id, computed);
    }
    match values.remove(&program.root) {
        Some(root) => root,
        None => Stage::new(program, program.root, grid, fields, &values).compute(),
    }
}

/// One value at all points, of fields and of values kept before.
struct Stage<'a> {
    program: &'a Program,
    grid: &'a Grid,
    fields: &'a [Option<Voxels>],
    values: &'a BTreeMap<Id, Vec<f32>>,
    /// The operations of a row, in order; the last one is asked for.
    rows: Vec<Id>,
    /// The row of each of them.
    row_of: BTreeMap<Id, usize>,
}

impl<'a> Stage<'a> {
    fn new(
        program: &'a Program,
        target: Id,
        grid: &'a Grid,
        fields: &'a [Option<Voxels>],
        values: &'a BTreeMap<Id, Vec<f32>>,
    ) -> Self {
        let (mut needed, mut open) = (BTreeSet::from([target]), vec![target]);
        while let Some(id) = open.pop() {
            let op = &program.ops[id];
            // What a derivative is taken of has been kept.
            if !values.contains_key(&id) && !matches!(op, Op::Derivative(..)) {
                open.extend(op.inputs().filter(|&input| needed.insert(input)));
            }
        }
        let rows: Vec<Id> = needed.into_iter().collect();
        let row_of = rows.iter().enumerate().map(|(row, &id)| (id, row)).collect();
        Self { program, grid, fields, values, rows, row_of }
    }

    fn compute(&self) -> Vec<f32> {
        let nx = self.grid.dims()[0];
        let mut out = vec![0.0; self.grid.voxels()];
        // Room for each operation's row, and for two rows that a derivative looks at.
        let room = || vec![0.0; (self.rows.len() + 2) * nx];
        out.par_chunks_mut(nx).enumerate().for_each_init(room, |room, (row, out)| {
            let (beside, rows) = room.split_at_mut(2 * nx);
            for (n, &id) in self.rows.iter().enumerate() {
                let (done, rest) = rows.split_at_mut(n * nx);
                self.row(id, row, done, beside, &mut rest[..nx]);
            }
            let last = &rows[(self.rows.len() - 1) * nx..][..nx];
            out.iter_mut().zip(last).for_each(|(out, value)| *out = *value as f32);
        });
        out
    }

    fn source(&self, id: Id) -> Option<ValueSource<'_>> {
        if let Some(kept) = self.values.get(&id) {
            return Some(ValueSource::Kept(kept));
        }
        match self.program.ops[id] {
            Op::Field(field) => self.fields.get(field)?.as_ref().map(ValueSource::Field),
            _ => None,
        }
    }

    /// Operation `id` on row `row` of the grid, those before it being `done`.
    fn row(&self, id: Id, row: usize, done: &[f64], beside: &mut [f64], out: &mut [f64]) {
        let nx = out.len();
        let of = |id: Id| &done[self.row_of[&id] * nx..][..nx];
        if let Some(source) = self.source(id) {
            return source.read(row * nx, out);
        }
        match self.program.ops[id] {
            Op::Constant(bits) => out.fill(f64::from_bits(bits)),
            // There, as was checked.
            Op::Field(_) => out.fill(f64::NAN),
            Op::Unary(operator, a) => {
                let function = match operator {
                    Unary::Negate => |x: f64| -x,
                    Unary::Sqrt => f64::sqrt,
                    Unary::Abs => f64::abs,
                    Unary::Exp => f64::exp,
                    Unary::Log => f64::ln,
                    Unary::Log10 => f64::log10,
                };
                out.iter_mut().zip(of(a)).for_each(|(out, a)| *out = function(*a));
            }
            Op::Binary(operator, a, b) => binary(operator, of(a), of(b), out),
            Op::Derivative(axis, source) => {
                if let Some(source) = self.source(source) {
                    self.derivative(&source, axis, row, beside, out);
                }
            }
            Op::Lambda2(jacobian) => {
                let rows = jacobian.map(of);
                out.iter_mut().enumerate().for_each(|(n, out)| *out = lambda2(rows.map(|row| row[n])));
            }
        }
    }

    fn derivative(&self, of: &ValueSource, axis: usize, row: usize, beside: &mut [f64], out: &mut [f64]) {
        let ([nx, ny, _], h) = (self.grid.dims(), self.grid.spacing()[axis]);
        let points = self.grid.dims()[axis];
        if points == 1 {
            return out.fill(0.0);
        }
        let (before, after) = beside.split_at_mut(nx);
        if axis == 0 {
            of.read(row * nx, before);
            for (n, out) in out.iter_mut().enumerate() {
                let (low, high) = (n.saturating_sub(1), (n + 1).min(nx - 1));
                *out = (before[high] - before[low]) / ((high - low) as f64 * h);
            }
            return;
        }
        let (place, stride) = if axis == 1 { (row % ny, 1) } else { (row / ny, ny) };
        let (down, up) = (place.min(1), (points - 1 - place).min(1));
        of.read((row - down * stride) * nx, before);
        of.read((row + up * stride) * nx, after);
        let scale = 1.0 / ((down + up) as f64 * h);
        for (n, out) in out.iter_mut().enumerate() {
            *out = (after[n] - before[n]) * scale;
        }
    }
}

fn binary(operator: Binary, a: &[f64], b: &[f64], out: &mut [f64]) {
    // One loop for each, so that each is compiled for itself.
    macro_rules! each {
        ($function:expr) => {{
            let function = $function;
            out.iter_mut().zip(a).zip(b).for_each(|((out, a), b)| *out = function(*a, *b))
        }};
    }
    match operator {
        Binary::Add => each!(|a: f64, b: f64| a + b),
        Binary::Subtract => each!(|a: f64, b: f64| a - b),
        Binary::Multiply => each!(|a: f64, b: f64| a * b),
        Binary::Divide => each!(|a: f64, b: f64| a / b),
        Binary::Power => each!(f64::powf),
        // Where a value is missing, so is what comes of it.
        Binary::Min => each!(|a: f64, b: f64| if a < b || a.is_nan() { a } else { b }),
        Binary::Max => each!(|a: f64, b: f64| if a > b || a.is_nan() { a } else { b }),
    }
}

/// The middle eigenvalue of S^2 + R^2 = (J^2 + (J^T)^2) / 2 for the Jacobian J, by the closed form for symmetric matrices (Smith,
/// Eigenvalues of a symmetric 3 x 3 matrix, 1961).
fn lambda2(j: [f64; 9]) -> f64 {
    let square = |r: usize, c: usize| (0..3).map(|k| j[3 * r + k] * j[3 * k + c]).sum::<f64>();
    let entry = |r, c| 0.5 * (square(r, c) + square(c, r));
    let (xx, yy, zz) = (square(0, 0), square(1, 1), square(2, 2));
    let (xy, xz, yz) = (entry(0, 1), entry(0, 2), entry(1, 2));
    let mean = (xx + yy + zz) / 3.0;
    let (a, b, c) = (xx - mean, yy - mean, zz - mean);
    let p = ((a * a + b * b + c * c + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0).sqrt();
    // NaN stays NaN.
    if p == 0.0 {
        return mean;
    }
    let [a, b, c, xy, xz, yz] = [a, b, c, xy, xz, yz].map(|entry| entry / p);
    let half_determinant = 0.5 * (a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz));
    // The middle root of x^3 - 3 x = 2 r.
    mean - 2.0 * p * (half_determinant.clamp(-1.0, 1.0).asin() / 3.0).sin()
}
