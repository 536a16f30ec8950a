//! From bytes to values.
use super::flags::Flags;
use super::grid::{Class, Grid};
use super::multigrid::{Field, Level, within};
use super::predict::{Row, WEIGHTS};
use super::quantize::reconstruct;
use super::symbols::{Context, Kind, Known, Models, RAW, places, saturated};
use super::{BIAS_BITS, HEADER, STEP_BITS, step_and_bias};
use crate::entropy::Error;
use crate::entropy::range_coder::Decoder;

/// The values of a volume of `dims` voxels (x fastest) that was coded with `bound`. Bytes that were changed give other
/// finite values or an error, in about the time and memory that the volume asks.
pub fn decode(bytes: &[u8], dims: [usize; 3], bound: f32) -> Result<Vec<f32>, Error> {
    let count = dims.iter().try_fold(1_usize, |n, &d| n.checked_mul(d)).ok_or(Error::Sizes)?;
    if count > isize::MAX as usize / 16 {
        return Err(Error::Sizes);
    }
    if count == 0 {
        return Ok(Vec::new());
    }
    let ([low, high, first], decisions) = header(bytes)?;
    let mut reader =
        Reader { field: Field::new(first, [low, high]), models: Models::default(), decoder: Decoder::new(decisions) };
    reader.levels(Grid { dims }, bound);
    let [whole, ..] = reader.field.parts;
    Ok(whole.values)
}

/// Range and first value, and the bytes after.
fn header(bytes: &[u8]) -> Result<([f32; 3], &[u8]), Error> {
    let (header, rest) = bytes.split_at_checked(HEADER).ok_or(Error::Short)?;
    let mut numbers = [0.0; 3];
    for (number, four) in numbers.iter_mut().zip(header.chunks_exact(4)) {
        *number = f32::from_le_bytes([four[0], four[1], four[2], four[3]]);
    }
    let [low, high, first] = numbers;
    let fit = low.is_finite() && high.is_finite() && low <= first && first <= high;
    if fit { Ok((numbers, rest)) } else { Err(Error::Value) }
}

/// A decoder at work.
struct Reader<'a> {
    field: Field,
    models: Models,
    decoder: Decoder<'a>,
}

impl Reader<'_> {
    fn levels(&mut self, voxels: Grid, bound: f32) {
        let mut above = None;
        for number in (0..voxels.levels() as usize).rev() {
            let step_parts = self.models.bits(&mut self.decoder, STEP_BITS, 0) + 1;
            let bias_parts = self.models.bits(&mut self.decoder, BIAS_BITS, 0);
            let (step, bias) = step_and_bias(bound, step_parts, bias_parts);
            let mut level = Level { number, step, scale: 1.0 / step, bias, weights: [[0.0; WEIGHTS]; 7] };
            let lattice = voxels.lattice(number);
            let mut flags = Flags::none(lattice);
            flags.code(&mut self.models, &mut self.decoder, above.as_ref(), number);
            self.field.begin(lattice);
            for class in lattice.classes() {
                level.weights[class.number] = self.models.weights(&mut self.decoder, class.odds(), None);
                self.class(&level, class, &flags);
            }
            self.field.end(number > 0);
            above = Some(flags);
        }
    }

    fn class(&mut self, level: &Level, class: Class, flags: &Flags) {
        let mut part = self.field.take(class);
        let kind = Kind::new(class, level.number);
        let (mut row, mut known) = (Row::default(), Known::default());
        for (y, z) in part.grid.rows() {
            let at = part.grid.row(y, z);
            let active = flags.row(y, z);
            if active.contains(&true) {
                row.look::<true>(&self.field, class, y, z);
                row.predict::<true>(self.field.range, level, class);
                known.look(&self.field, &part, class, [y, z]);
                let marks = &mut part.marks[at..at + row.expected.len()];
                self.residuals(level, kind, active, &mut row, &known, marks);
            } else {
                row.look::<false>(&self.field, class, y, z);
                row.predict::<false>(self.field.range, level, class);
            }
            part.values[at..at + row.expected.len()].copy_from_slice(&row.expected);
        }
        self.field.parts[class.part()] = part;
    }

    /// Reads the residuals of a row; what was expected becomes what is.
    fn residuals(
        &mut self,
        level: &Level,
        kind: Kind,
        active: &[bool],
        row: &mut Row,
        known: &Known,
        marks: &mut [i8],
    ) {
        for block in (0..active.len()).filter(|&block| active[block]) {
            for i in places(block, marks.len()) {
                let before = if i > 0 { marks[i - 1] } else { 0 };
                let context = Context::new(kind, known, i, before, row.surroundings[i]);
                let steps = self.models.residual(&mut self.decoder, &context, 0);
                if steps == 0 {
                    continue;
                }
                marks[i] = saturated(steps);
                row.expected[i] = if steps == RAW {
                    // A number that is none becomes the least value.
                    within(self.field.range, f32::from_bits(self.models.bits(&mut self.decoder, 32, 0)))
                } else {
                    reconstruct(self.field.range, level, row.expected[i], steps)
                };
            }
        }
    }
}
