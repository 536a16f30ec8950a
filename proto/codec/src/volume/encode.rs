//! Encoder of one band.
use super::block_flags::BlockFlags;
use super::grid::{BLOCK, Lattice, PointClass};
use super::multigrid::WEIGHTS;
use super::multigrid::{LevelParams, MultigridField};
use super::predict::{PredictionRow, SCALE, cubic};
use super::quantize::{QuantizationTarget, Quantizer};
use super::regression::fit;
use super::settings::EncoderSettings;
use super::symbols::{
    ClassContext, RAW_VALUE, ResidualContext, ResidualNeighborhood, SATURATED, VolumeModels, block_range, saturated,
};
use super::temporal::{self, Before, TemporalRow};
use super::{BIAS_BITS, HEADER, STEP_BITS, Tolerance, step_and_bias};
use crate::entropy::range_coder::Encoder;

/// The finest levels, which have all but a hundredth of the points.
const FINE_LEVELS: usize = 2;
/// The least weight, in 1 / [`SCALE`], at which the volume before is sure to save bytes.
const LEAST_WEIGHT: i8 = 3;

/// Encodes `values` of a volume of `dims` voxels (x fastest), all finite, so that each decodes within `tolerance` or, where `free`
/// gives an interval for a voxel's index, within that interval, which must hold the value. `before` holds the values of a volume that resembles this one, all finite, if there is one; a decoder has to have it.
///
/// # Panics
/// If `dims` do not multiply to the number of values.
pub(super) fn encode(
    values: &[f32],
    dims: [usize; 3],
    tolerance: Tolerance,
    free: impl Fn(usize) -> Option<(f32, f32)>,
    before: Option<&[f32]>,
) -> PredictedBand {
    assert_eq!(dims.iter().product::<usize>(), values.len(), "a volume has as many values as voxels");
    debug_assert!(values.iter().all(|v| v.is_finite()), "values are finite");
    let Some(&first) = values.first() else {
        return PredictedBand { bytes: Vec::new(), field: MultigridField::new(0.0, [0.0; 2]), is_corrected: false };
    };
    let range = range(values, first);
    let settings = match tolerance {
        Tolerance::Bound(_) => EncoderSettings::default(),
        Tolerance::Integers => EncoderSettings::of_integers(),
    };
    let wanted = QuantizationTarget { values, bound: tolerance.bound(), free };
    let mut bytes: Vec<u8> = [range[0], range[1], first].iter().flat_map(|v| v.to_le_bytes()).collect();
    debug_assert_eq!(bytes.len(), HEADER);
    let mut work = VolumeEncoder {
        quantizer: Quantizer { wanted: &wanted, range, settings },
        voxels: Lattice { dims },
        field: MultigridField::new(first, range),
        models: if before.is_some() { VolumeModels::temporal() } else { VolumeModels::default() },
        before: before.map(|values| Before { values, voxels: Lattice { dims } }),
        is_corrected: false,
        encoder: Encoder::default(),
    };
    let levels = work.voxels.levels() as usize;
    let mut above = None;
    for number in (0..levels).rev() {
        above = Some(work.level(number, above.as_ref()));
    }
    bytes.extend(work.encoder.finish());
    PredictedBand { bytes, field: work.field, is_corrected: work.is_corrected }
}

/// A coded band.
pub(super) struct PredictedBand {
    pub bytes: Vec<u8>,
    field: MultigridField,
    /// Whether the volume before corrects predictions by a share worth its bytes.
    pub is_corrected: bool,
}

impl PredictedBand {
    /// The values as they decode.
    pub(super) fn decoded(mut self) -> Vec<f32> {
        self.field.end(false);
        std::mem::take(&mut self.field.parts[0].values)
    }
}

/// Least and largest value.
pub(super) fn range(values: &[f32], first: f32) -> [f32; 2] {
    // Eight independent comparisons at a time, so that the compiler vectorizes them.
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

/// State of an encoder.
struct VolumeEncoder<'a, F> {
    quantizer: Quantizer<'a, F>,
    voxels: Lattice,
    field: MultigridField,
    models: VolumeModels,
    before: Option<Before<'a>>,
    is_corrected: bool,
    encoder: Encoder,
}

/// A class of points with the choices made for it.
struct PlannedClass {
    class: PointClass,
    weights: Option<[i8; WEIGHTS]>,
    /// Weight of the volume before, in 1 / [`SCALE`].
    temporal_weight: i8,
    surroundings: Vec<u16>,
    /// Octaves of what the prediction misses in the volume before, if there is one.
    missed: Vec<u8>,
    /// Residuals beyond what `i8` holds, with their values, in the order of points.
    large: Vec<(i32, f32)>,
}

impl<F: Fn(usize) -> Option<(f32, f32)>> VolumeEncoder<'_, F> {
    /// Chooses the residuals of a level, then codes them. Returns the level's block flags.
    fn level(&mut self, number: usize, above: Option<&BlockFlags>) -> BlockFlags {
        let settings = &self.quantizer.settings;
        let (step_parts, bias_parts) = (settings.step_parts(number), settings.bias);
        let (step, bias) = step_and_bias(self.quantizer.wanted.bound, step_parts, bias_parts);
        let (integers, scale, weights) = (settings.integers, 1.0 / step, [[0.0; WEIGHTS]; 7]);
        let mut level = LevelParams { number, integers, step, scale, bias, weights, temporal: [0.0; 7] };
        let lattice = self.voxels.lattice(number);
        self.field.begin(lattice);
        let before = self.before.as_ref().map(|before| before.level(number));
        let mut flags = BlockFlags::none(lattice);
        let classes = lattice.classes();
        let planned: Vec<PlannedClass> =
            classes.map(|class| self.plan(&mut level, class, before.as_ref(), &mut flags)).collect();
        self.models.bits(&mut self.encoder, STEP_BITS, step_parts - 1);
        self.models.bits(&mut self.encoder, BIAS_BITS, bias_parts);
        flags.code(&mut self.models, &mut self.encoder, above, number);
        planned.iter().for_each(|planned| self.code(number, planned, &flags));
        if number > 0 {
            self.field.end(true);
        }
        flags
    }

    /// Index of the first voxel of a row of a class, and the distance between its voxels.
    fn voxels(&self, number: usize, class: PointClass, y: usize, z: usize) -> (usize, usize) {
        let at = |axis: usize, i: usize| (2 * i + usize::from(class.odd[axis])) << number;
        (at(0, 0) + self.voxels.row(at(1, y), at(2, z)), 2 << number)
    }

    /// Chooses prediction weights and residuals of a class.
    fn plan(
        &mut self,
        level: &mut LevelParams,
        class: PointClass,
        before: Option<&MultigridField>,
        flags: &mut BlockFlags,
    ) -> PlannedClass {
        let (wanted, number) = (self.quantizer.wanted, level.number);
        let visible = |[x, y, z]: [usize; 3]| {
            let (start, step) = self.voxels(number, class, y, z);
            let at = start + x * step;
            (wanted.free)(at).is_none().then_some(wanted.values[at])
        };
        let weights = fit(&self.field, level, class, visible);
        level.weights[class.number] = weights.unwrap_or(cubic(class.odd_axes())).map(|w| f32::from(w) / SCALE);
        let temporal_weight = before.map_or(0, |before| temporal::fit([&self.field, before], level, class, visible));
        level.temporal[class.number] = f32::from(temporal_weight) / SCALE;
        self.is_corrected |= number < FINE_LEVELS && temporal_weight >= LEAST_WEIGHT;
        let mut part = self.field.take(class);
        let (count, missed) = (part.values.len(), Vec::new());
        let (surroundings, large) = (Vec::with_capacity(count), Vec::new());
        let mut planned = PlannedClass { class, weights, temporal_weight, surroundings, missed, large };
        let (mut row, mut past) = (PredictionRow::default(), TemporalRow::default());
        for (y, z) in part.grid.rows() {
            row.compute_means::<true>(&self.field, class, y, z);
            row.predict::<true>(self.field.range, level, class);
            if let Some(before) = before {
                past.compute(before, level, class, [y, z]);
                past.correct(&mut row.expected, level.temporal[class.number], self.field.range);
                planned.missed.extend_from_slice(&past.octaves);
            }
            planned.surroundings.extend_from_slice(&row.surroundings);
            level.round(&mut row.expected);
            let (start, step) = self.voxels(level.number, class, y, z);
            let from = part.grid.row(y, z);
            let n = part.grid.dims[0];
            let to = part.values[from..from + n].iter_mut().zip(&mut part.residuals[from..from + n]);
            let active = flags.row_mut(y, z);
            for (i, (&expected, (value, residual))) in row.expected.iter().zip(to).enumerate() {
                let (chosen, steps) = self.quantizer.steps(level, start + i * step, expected);
                *value = chosen;
                if steps != 0 {
                    *residual = saturated(steps);
                    active[i / BLOCK] = true;
                    if residual.unsigned_abs() == SATURATED {
                        planned.large.push((steps, chosen));
                    }
                }
            }
        }
        self.field.parts[class.part()] = part;
        planned
    }

    /// Codes the choices made for a class.
    fn code(&mut self, number: usize, planned: &PlannedClass, flags: &BlockFlags) {
        let class = planned.class;
        self.models.weights(&mut self.encoder, class.odd_axes(), planned.weights);
        if self.before.is_some() {
            self.models.temporal_weight(&mut self.encoder, planned.temporal_weight);
        }
        let part = self.field.take(class);
        let kind = ClassContext::new(class, number);
        let mut large = planned.large.iter();
        let mut known = ResidualNeighborhood::default();
        let n = part.grid.dims[0];
        for (y, z) in part.grid.rows() {
            let active = flags.row(y, z);
            if !active.contains(&true) {
                continue;
            }
            known.gather(&self.field, &part, class, [y, z]);
            let residuals = part.residuals([y, z]);
            let at = part.grid.row(y, z);
            let around = &planned.surroundings[at..][..n];
            let missed = planned.missed.get(at..).unwrap_or(&[]);
            for block in (0..active.len()).filter(|&block| active[block]) {
                for i in block_range(block, n) {
                    let before = if i > 0 { residuals[i - 1] } else { 0 };
                    let missed = missed.get(i).copied().unwrap_or(0);
                    let context = ResidualContext::new(kind, &known, i, before, around[i], missed);
                    let (steps, value) = if residuals[i].unsigned_abs() == SATURATED {
                        large.next().copied().unwrap_or_default()
                    } else {
                        (i32::from(residuals[i]), 0.0)
                    };
                    self.models.residual(&mut self.encoder, &context, steps);
                    if steps == RAW_VALUE {
                        self.models.bits(&mut self.encoder, 32, value.to_bits());
                    }
                }
            }
        }
        self.field.parts[class.part()] = part;
    }
}
