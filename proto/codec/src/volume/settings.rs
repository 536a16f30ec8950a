//! How the encoder spends its bytes: what gave the fewest of them at equal mean square error over simulated and
//! scanned volumes. A decoder reads the steps and biases from the bytes and asks none of this.

/// Settings of an encoder.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// Step of the finest level in parts, 1..=64: less than 64 leaves a choice between two numbers of steps.
    pub step: f32,
    /// How many times finer each coarser level's step is: more is predicted from it.
    pub alpha: f32,
    /// How many times finer a step is at most.
    pub beta: f32,
    /// Bias of all levels in parts, 0..=31.
    pub bias: u32,
    /// How much further than half a step a residual must reach to count one step more, in steps.
    pub thrift: f32,
    /// Levels whose free voxels take the cheapest value in their interval; those of coarser levels, from which more is
    /// predicted, take a near one.
    pub loose: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self { step: 56.0, alpha: 1.75, beta: 8.0, bias: 0, thrift: 0.08, loose: 2 }
    }
}

impl Settings {
    /// Step of a level in parts, 1..=64; 0 is the finest.
    pub fn step_parts(&self, level: usize) -> u32 {
        let finer = (0..level).fold(1.0, |finer: f32, _| (finer * self.alpha).min(self.beta));
        (self.step / finer).round().clamp(1.0, 64.0) as u32
    }
}
