//! From values to bytes.
use super::flags::Flags;
use super::grid::{BLOCK, Class, Grid};
use super::multigrid::{Field, Level};
use super::predict::{Row, SCALE, WEIGHTS, cubic};
use super::quantize::{Quantiser, Wanted};
use super::regression::fit;
use super::settings::Settings;
use super::symbols::{Context, Kind, Known, LARGE, Models, RAW, places, saturated};
use super::{BIAS_BITS, HEADER, STEP_BITS, step_and_bias};
use crate::entropy::range_coder::Encoder;

/// Codes `values` of a volume of `dims` voxels (x fastest), all finite, so that each comes back within `bound` (more
/// than 0, in units of the values), or, where `free` gives an interval for its index, within that, which holds the
/// value.
///
/// # Panics
/// If `dims` do not multiply to the number of values.
pub fn encode(values: &[f32], dims: [usize; 3], bound: f32, free: impl Fn(usize) -> Option<(f32, f32)>) -> Vec<u8> {
    assert_eq!(dims.iter().product::<usize>(), values.len(), "a volume has as many values as voxels");
    debug_assert!(values.iter().all(|v| v.is_finite()), "values are finite");
    let Some(&first) = values.first() else { return Vec::new() };
    let range = range(values, first);
    let wanted = Wanted { values, bound, free };
    let mut bytes: Vec<u8> = [range[0], range[1], first].iter().flat_map(|v| v.to_le_bytes()).collect();
    debug_assert_eq!(bytes.len(), HEADER);
    let mut work = Work {
        quantiser: Quantiser { wanted: &wanted, range, settings: Settings::default() },
        voxels: Grid { dims },
        field: Field::new(first, range),
        models: Models::default(),
        encoder: Encoder::default(),
    };
    let levels = work.voxels.levels() as usize;
    let mut above = None;
    for number in (0..levels).rev() {
        above = Some(work.level(number, above.as_ref()));
    }
    bytes.extend(work.encoder.finish());
    bytes
}

/// Least and largest value.
fn range(values: &[f32], first: f32) -> [f32; 2] {
    // Several at a time, as one would wait for the other.
    let (mut low, mut high) = ([first; 8], [first; 8]);
    let (chunks, rest) = values.as_chunks();
    let mut rest_chunk = [first; 8];
    rest_chunk[..rest.len()].copy_from_slice(rest);
    for chunk in chunks.iter().chain([&rest_chunk]) {
        for (i, &v) in chunk.iter().enumerate() {
            low[i] = if v < low[i] { v } else { low[i] };
            high[i] = if v > high[i] { v } else { high[i] };
        }
    }
    [low.into_iter().fold(first, f32::min), high.into_iter().fold(first, f32::max)]
}

/// An encoder at work.
struct Work<'a, F> {
    quantiser: Quantiser<'a, F>,
    voxels: Grid,
    field: Field,
    models: Models,
    encoder: Encoder,
}

/// A class with all that was chosen for it.
struct Planned {
    class: Class,
    weights: Option<[i8; WEIGHTS]>,
    surroundings: Vec<u16>,
    /// Residuals that marks cannot tell, with the values, in the order of points.
    large: Vec<(i32, f32)>,
}

impl<F: Fn(usize) -> Option<(f32, f32)>> Work<'_, F> {
    /// Chooses the residuals of a level and codes them.
    fn level(&mut self, number: usize, above: Option<&Flags>) -> Flags {
        let settings = &self.quantiser.settings;
        let (step_parts, bias_parts) = (settings.step_parts(number), settings.bias);
        let (step, bias) = step_and_bias(self.quantiser.wanted.bound, step_parts, bias_parts);
        let mut level = Level { number, step, scale: 1.0 / step, bias, weights: [[0.0; WEIGHTS]; 7] };
        let lattice = self.voxels.lattice(number);
        self.field.begin(lattice);
        let mut flags = Flags::none(lattice);
        let classes = lattice.classes();
        let planned: Vec<Planned> = classes.map(|class| self.plan(&mut level, class, &mut flags)).collect();
        self.models.bits(&mut self.encoder, STEP_BITS, step_parts - 1);
        self.models.bits(&mut self.encoder, BIAS_BITS, bias_parts);
        flags.code(&mut self.models, &mut self.encoder, above, number);
        planned.iter().for_each(|planned| self.code(number, planned, &flags));
        if number > 0 {
            self.field.end(true);
        }
        flags
    }

    /// Index of the first voxel of a row of a class, and the distance to the next.
    fn voxels(&self, number: usize, class: Class, y: usize, z: usize) -> (usize, usize) {
        let at = |axis: usize, i: usize| (2 * i + usize::from(class.odd[axis])) << number;
        (at(0, 0) + self.voxels.row(at(1, y), at(2, z)), 2 << number)
    }

    /// Chooses the weights and residuals of a class.
    fn plan(&mut self, level: &mut Level, class: Class, flags: &mut Flags) -> Planned {
        let wanted = self.quantiser.wanted;
        let weights = fit(&self.field, level, class, |[x, y, z]| {
            let (start, step) = self.voxels(level.number, class, y, z);
            let at = start + x * step;
            (wanted.free)(at).is_none().then_some(wanted.values[at])
        });
        level.weights[class.number] = weights.unwrap_or(cubic(class.odds())).map(|w| f32::from(w) / SCALE);
        let mut part = self.field.take(class);
        let mut planned =
            Planned { class, weights, surroundings: Vec::with_capacity(part.values.len()), large: Vec::new() };
        let mut row = Row::default();
        for (y, z) in part.grid.rows() {
            row.look::<true>(&self.field, class, y, z);
            row.predict::<true>(self.field.range, level, class);
            planned.surroundings.extend_from_slice(&row.surroundings);
            let (start, step) = self.voxels(level.number, class, y, z);
            let from = part.grid.row(y, z);
            let n = part.grid.dims[0];
            let to = part.values[from..from + n].iter_mut().zip(&mut part.marks[from..from + n]);
            let active = flags.row_mut(y, z);
            for (i, (&expected, (value, mark))) in row.expected.iter().zip(to).enumerate() {
                let (chosen, steps) = self.quantiser.steps(level, start + i * step, expected);
                *value = chosen;
                if steps != 0 {
                    *mark = saturated(steps);
                    active[i / BLOCK] = true;
                    if mark.unsigned_abs() == LARGE {
                        planned.large.push((steps, chosen));
                    }
                }
            }
        }
        self.field.parts[class.part()] = part;
        planned
    }

    /// Codes what was planned for a class.
    fn code(&mut self, number: usize, planned: &Planned, flags: &Flags) {
        let class = planned.class;
        self.models.weights(&mut self.encoder, class.odds(), planned.weights);
        let part = self.field.take(class);
        let kind = Kind::new(class, number);
        let mut large = planned.large.iter();
        let mut known = Known::default();
        let n = part.grid.dims[0];
        for (y, z) in part.grid.rows() {
            let active = flags.row(y, z);
            if !active.contains(&true) {
                continue;
            }
            known.look(&self.field, &part, class, [y, z]);
            let marks = part.marks([y, z]);
            let around = &planned.surroundings[part.grid.row(y, z)..][..n];
            for block in (0..active.len()).filter(|&block| active[block]) {
                for i in places(block, n) {
                    let before = if i > 0 { marks[i - 1] } else { 0 };
                    let context = Context::new(kind, &known, i, before, around[i]);
                    let (steps, value) = if marks[i].unsigned_abs() == LARGE {
                        large.next().copied().unwrap_or_default()
                    } else {
                        (i32::from(marks[i]), 0.0)
                    };
                    self.models.residual(&mut self.encoder, &context, steps);
                    if steps == RAW {
                        self.models.bits(&mut self.encoder, 32, value.to_bits());
                    }
                }
            }
        }
        self.field.parts[class.part()] = part;
    }
}
