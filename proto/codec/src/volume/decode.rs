//! Decoder of one band.
use super::block_flags::BlockFlags;
use super::grid::{Lattice, PointClass};
use super::multigrid::WEIGHTS;
use super::multigrid::{LevelParams, MultigridField, within};
use super::predict::PredictionRow;
use super::quantize::reconstruct;
use super::symbols::{
    ClassContext, RAW_VALUE, ResidualContext, ResidualNeighborhood, VolumeModels, block_range, saturated,
};
use super::temporal::{Before, TemporalRow};
use super::{BIAS_BITS, HEADER, STEP_BITS, Tolerance, step_and_bias};
use crate::entropy::EntropyError;
use crate::entropy::range_coder::Decoder;

/// Decodes the values of a volume of `dims` voxels (x fastest) coded with `tolerance`, and after `before` if there is one. Corrupt bytes give other finite values or
/// an error, in the time and memory that a volume of `dims` takes.
pub(super) fn decode(
    bytes: &[u8],
    dims: [usize; 3],
    tolerance: Tolerance,
    before: Option<&[f32]>,
) -> Result<Vec<f32>, EntropyError> {
    let count = dims.iter().try_fold(1_usize, |n, &d| n.checked_mul(d)).ok_or(EntropyError::SizeOverflow)?;
    if count > isize::MAX as usize / 16 {
        return Err(EntropyError::SizeOverflow);
    }
    if count == 0 {
        return Ok(Vec::new());
    }
    let ([low, high, first], decisions) = header(bytes)?;
    let mut reader = VolumeDecoder {
        field: MultigridField::new(first, [low, high]),
        models: if before.is_some() { VolumeModels::temporal() } else { VolumeModels::default() },
        before: before.map(|values| Before { values, voxels: Lattice { dims } }),
        decoder: Decoder::new(decisions),
    };
    reader.levels(Lattice { dims }, tolerance);
    let [whole, ..] = reader.field.parts;
    Ok(whole.values)
}

/// The three numbers that a band begins with, and the bytes of the range coder.
pub(super) fn numbers(bytes: &[u8]) -> Result<([f32; 3], &[u8]), EntropyError> {
    let (header, rest) = bytes.split_at_checked(HEADER).ok_or(EntropyError::LengthMismatch)?;
    let mut numbers = [0.0; 3];
    for (number, four) in numbers.iter_mut().zip(header.chunks_exact(4)) {
        *number = f32::from_le_bytes([four[0], four[1], four[2], four[3]]);
    }
    Ok((numbers, rest))
}

/// Least value, largest value and first value, and the bytes of the range coder.
fn header(bytes: &[u8]) -> Result<([f32; 3], &[u8]), EntropyError> {
    let (numbers, rest) = numbers(bytes)?;
    let [low, high, first] = numbers;
    let fit = low.is_finite() && high.is_finite() && low <= first && first <= high;
    if fit { Ok((numbers, rest)) } else { Err(EntropyError::InvalidValue) }
}

/// State of a decoder.
struct VolumeDecoder<'a> {
    field: MultigridField,
    models: VolumeModels,
    before: Option<Before<'a>>,
    decoder: Decoder<'a>,
}

impl VolumeDecoder<'_> {
    fn levels(&mut self, voxels: Lattice, tolerance: Tolerance) {
        let integers = tolerance == Tolerance::Integers;
        let mut above = None;
        for number in (0..voxels.levels() as usize).rev() {
            let step_parts = self.models.bits(&mut self.decoder, STEP_BITS, 0) + 1;
            let bias_parts = self.models.bits(&mut self.decoder, BIAS_BITS, 0);
            let (step, bias) = step_and_bias(tolerance.bound(), step_parts, bias_parts);
            let (scale, weights) = (1.0 / step, [[0.0; WEIGHTS]; 7]);
            let mut level = LevelParams { number, integers, step, scale, bias, weights, temporal: [0.0; 7] };
            let lattice = voxels.lattice(number);
            let mut flags = BlockFlags::none(lattice);
            flags.code(&mut self.models, &mut self.decoder, above.as_ref(), number);
            self.field.begin(lattice);
            let before = self.before.as_ref().map(|before| before.level(number));
            for class in lattice.classes() {
                level.weights[class.number] = self.models.weights(&mut self.decoder, class.odd_axes(), None);
                if before.is_some() {
                    level.temporal[class.number] = self.models.temporal_weight(&mut self.decoder, 0);
                }
                self.class(&level, class, before.as_ref(), &flags);
            }
            self.field.end(number > 0);
            above = Some(flags);
        }
    }

    fn class(&mut self, level: &LevelParams, class: PointClass, before: Option<&MultigridField>, flags: &BlockFlags) {
        let mut part = self.field.take(class);
        let kind = ClassContext::new(class, level.number);
        let (mut row, mut known) = (PredictionRow::default(), ResidualNeighborhood::default());
        let mut past = TemporalRow::default();
        for (y, z) in part.grid.rows() {
            let at = part.grid.row(y, z);
            let active = flags.row(y, z);
            let is_active = active.contains(&true);
            if is_active {
                row.compute_means::<true>(&self.field, class, y, z);
                row.predict::<true>(self.field.range, level, class);
            } else {
                row.compute_means::<false>(&self.field, class, y, z);
                row.predict::<false>(self.field.range, level, class);
            }
            if let Some(before) = before {
                past.compute(before, level, class, [y, z]);
                past.correct(&mut row.expected, level.temporal[class.number], self.field.range);
            }
            level.round(&mut row.expected);
            if is_active {
                known.gather(&self.field, &part, class, [y, z]);
                let residuals = &mut part.residuals[at..at + row.expected.len()];
                self.residuals(level, kind, active, (&mut row, &past.octaves), &known, residuals);
            }
            part.values[at..at + row.expected.len()].copy_from_slice(&row.expected);
        }
        self.field.parts[class.part()] = part;
    }

    /// Decodes the residuals of the active blocks of a row and replaces predictions by values.
    fn residuals(
        &mut self,
        level: &LevelParams,
        kind: ClassContext,
        active: &[bool],
        (row, missed): (&mut PredictionRow, &[u8]),
        known: &ResidualNeighborhood,
        residuals: &mut [i8],
    ) {
        for block in (0..active.len()).filter(|&block| active[block]) {
            for i in block_range(block, residuals.len()) {
                let before = if i > 0 { residuals[i - 1] } else { 0 };
                let missed = missed.get(i).copied().unwrap_or(0);
                let context = ResidualContext::new(kind, known, i, before, row.surroundings[i], missed);
                let steps = self.models.residual(&mut self.decoder, &context, 0);
                if steps == 0 {
                    continue;
                }
                residuals[i] = saturated(steps);
                row.expected[i] = if steps == RAW_VALUE {
                    // NaN becomes the least value.
                    within(self.field.range, f32::from_bits(self.models.bits(&mut self.decoder, 32, 0)))
                } else {
                    reconstruct(self.field.range, level, row.expected[i], steps)
                };
            }
        }
    }
}
