//! Parameters of the encoder: those with the fewest bytes at equal mean square error over simulated and scanned volumes. A
//! decoder reads steps and biases from the bytes and needs none of these.

/// Parameters of an encoder.
#[derive(Debug, Clone, Copy)]
pub(super) struct EncoderSettings {
    /// All values are integers, the bound is 1/2, and the step 1.
    pub integers: bool,
    /// Quantizer step of the finest level in 1/64 of twice the bound, 1..=64; below 64 most values have two residuals to choose from.
    pub step: f32,
    /// Ratio of a level's step to the next coarser level's, which must be finer because more is predicted from it.
    pub alpha: f32,
    /// Largest ratio of the finest level's step to a coarser level's.
    pub beta: f32,
    /// Bias of all levels in 1/64 of the step, 0..=31.
    pub bias: u32,
    /// Dead zone: excess over half a step, in steps, that a prediction error needs for the residual to grow by one.
    pub dead_zone: f32,
    /// Number of finest levels on which invisible voxels take the cheapest value of their interval; on coarser levels, from
    /// which more is predicted, they take one near their own.
    pub relaxed_levels: usize,
}

impl Default for EncoderSettings {
    fn default() -> Self {
        Self { integers: false, step: 56.0, alpha: 1.75, beta: 8.0, bias: 0, dead_zone: 0.08, relaxed_levels: 2 }
    }
}

impl EncoderSettings {
    /// Those for integers.
    pub(super) fn of_integers() -> Self {
        Self { integers: true, step: 64.0, alpha: 1.0, beta: 1.0, ..Self::default() }
    }

    /// Quantizer step of a level in 1/64 of twice the bound, 1..=64; level 0 is the finest.
    pub(super) fn step_parts(&self, level: usize) -> u32 {
        let finer = (0..level).fold(1.0, |finer: f32, _| (finer * self.alpha).min(self.beta));
        (self.step / finer).round().clamp(1.0, 64.0) as u32
    }
}
