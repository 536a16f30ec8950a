//! Which steps are coded after the one before them, and which alone, as key frames.
//!
//! A reduced volume of a field that moves takes fewer bytes after the one before it, and more time. Who joins or lost a step waits for the next
//! key frame; who wants one step alone decodes all since the last one.

use lamina_codec::volume::{ReferenceVolume, coded_after};
use lamina_model::{GenerationParams, Objective, Setting};

/// Steps from one key frame to the next.
const INTERVAL: u32 = 8;
/// Where the step after a key frame takes more than this share of its bytes, coding it after another one is not worth its time.
const WORTHWHILE: f64 = 0.92;
/// So many steps are coded alone then, and where one was dropped: there is no time to spare.
const ALONE: u32 = 16;
/// Points of larger volumes, whose motion would be searched in copies that nobody has reckoned with.
const MOST_POINTS: u64 = 1 << 24;
/// A key frame that takes this share of the size limit fills it.
const FILLED: f64 = 0.8;

/// What was sent last.
struct Sent {
    run_id: String,
    step: u64,
    dropped_steps: u64,
    reference: ReferenceVolume,
    /// Steps since the key frame.
    after_key: u32,
    /// Parameters that were wanted.
    wanted: GenerationParams,
    key_params: GenerationParams,
    key_bytes: u64,
}

/// The chain of steps since the last key frame.
#[derive(Default)]
pub(crate) struct KeyFrames {
    last: Option<Sent>,
    /// Steps to be coded alone.
    alone: u32,
}

/// What the next step may be coded after.
pub(crate) struct Predecessor<'a> {
    /// Its number.
    pub step: u64,
    /// As it decodes.
    pub volume: &'a ReferenceVolume,
    /// What is saved is to be spent on quality: its key frame fills the size limit.
    pub fills_limit: bool,
}

/// A step as it was sent.
pub(crate) struct SentStep<'a> {
    /// The run's id.
    pub run_id: &'a str,
    /// Its number.
    pub step: u64,
    /// Steps of the run that were dropped before it.
    pub dropped_steps: u64,
    /// Coding it after the one before was tried.
    pub has_predecessor: bool,
    /// What it was to be made with.
    pub wanted: GenerationParams,
    /// What it was made with.
    pub params: GenerationParams,
    /// As encoded.
    pub bytes: &'a [u8],
    /// As it decodes, if it is a volume.
    pub reference: Option<ReferenceVolume>,
}

impl Sent {
    /// True if the next step may be coded after it.
    fn is_followed_by(&self, run_id: &str, dropped_steps: u64, wanted: GenerationParams) -> bool {
        self.run_id == run_id && self.dropped_steps == dropped_steps && self.wanted == wanted
    }
}

impl KeyFrames {
    /// What the next step of `run_id` may be coded after; `None` if it is to be a key frame. That it is where time counts, where nobody has
    /// chosen parameters yet or others are `wanted` than before, where steps are dropped, and where a reader asked for one.
    pub(crate) fn predecessor(
        &self,
        (run_id, dropped_steps): (&str, u64),
        wanted: GenerationParams,
        setting: &Setting,
        key_wanted: bool,
    ) -> Option<Predecessor<'_>> {
        let Setting { limits, objective, .. } = setting;
        let time_counts = *objective == Objective::Time || limits.time_ms.is_some() || limits.overhead.is_some();
        if key_wanted || time_counts || setting.params.is_none() || self.alone > 0 {
            return None;
        }
        let last = self.last.as_ref().filter(|last| last.is_followed_by(run_id, dropped_steps, wanted))?;
        let full = limits.size_bytes.is_some_and(|limit| last.key_bytes as f64 >= FILLED * limit as f64);
        let fills_limit = full && *objective == Objective::Quality;
        (last.after_key + 1 < INTERVAL).then_some(Predecessor { step: last.step, volume: &last.reference, fills_limit })
    }

    /// Takes down a step; true if it was coded after the one before.
    pub(crate) fn sent(&mut self, sent: SentStep<'_>) -> bool {
        let SentStep { run_id, step, dropped_steps, has_predecessor, wanted, params, bytes, reference } = sent;
        let (before, size_bytes) = (self.last.take(), bytes.len() as u64);
        self.alone = self.alone.saturating_sub(1);
        if before.as_ref().is_some_and(|before| before.run_id == run_id && before.dropped_steps < dropped_steps) {
            self.alone = ALONE;
        }
        let is_after = coded_after(bytes).is_some();
        let (mut after_key, mut key_params, mut key_bytes) = (0, params, size_bytes);
        if let Some(before) = before.filter(|_| is_after) {
            (after_key, key_params, key_bytes) = (before.after_key + 1, before.key_params, before.key_bytes);
            let is_finer = params.gamma() < key_params.gamma();
            if after_key == 1 && !is_finer && size_bytes as f64 > WORTHWHILE * key_bytes as f64 {
                self.alone = ALONE;
            }
        } else if has_predecessor {
            self.alone = ALONE;
        }
        self.last = reference.filter(|volume| volume.points() <= MOST_POINTS).map(|reference| Sent {
            run_id: run_id.to_owned(),
            step,
            dropped_steps,
            reference,
            after_key,
            wanted,
            key_params,
            key_bytes,
        });
        is_after
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lamina_codec::{ErrorMeasure, volume::encode_after};
    use lamina_model::{Grid, Limits, ReducedVolume, Volume, VolumeParams, Voxels, suggest::suggest};

    fn params(gamma: f64) -> GenerationParams {
        GenerationParams::volume(24, gamma).unwrap()
    }

    /// The same waves at every step, and at each one another noise of that strength.
    fn reduced(step: u64, noise: f32) -> ReducedVolume {
        let grid = Grid::new([24; 3], glam::DVec3::ONE, glam::DVec3::ZERO).unwrap();
        let mut random = fastrand::Rng::with_seed(step);
        let mut unit = |n: usize| {
            let [x, y, z] = [n % 24, n / 24 % 24, n / 576].map(|i| i as f32);
            0.5 + 0.1 * (x * y).sin() + 0.1 * (1.3 * y + 2.1 * z).sin() + noise * random.f32()
        };
        let units: Vec<f32> = (0..grid.voxels()).map(&mut unit).collect();
        let volume = Volume::new(grid, Voxels::F32(units.clone())).unwrap();
        let mut scene = suggest(&[&volume]).unwrap();
        scene.transfer = scene.transfer.with_unit_length(1.0);
        ReducedVolume::new(grid, scene, VolumeParams::new(24, 0.01).unwrap(), units).unwrap()
    }

    struct Sender {
        keys: KeyFrames,
        setting: Setting,
        step: u64,
    }

    impl Sender {
        fn new() -> Self {
            let setting = Setting { params: Some(params(0.01)), ..Setting::default() };
            Self { keys: KeyFrames::default(), setting, step: 0 }
        }

        /// Sends the next step; true if it was coded after the one before.
        fn send(&mut self, noise: f32, dropped_steps: u64, key_wanted: bool) -> bool {
            self.step += 1;
            let volume = reduced(self.step, noise);
            let wanted = self.setting.params.unwrap_or_default();
            let before = self.keys.predecessor(("r", dropped_steps), wanted, &self.setting, key_wanted);
            assert!(before.as_ref().is_none_or(|before| before.step == self.step - 1));
            let has_predecessor = before.is_some();
            let (bytes, next) = encode_after(&volume, ErrorMeasure::Maximum, before.map(|before| before.volume));
            let (run_id, step, params) = ("r", self.step, params(0.01));
            let reference = Some(next);
            let bytes = &bytes;
            self.keys.sent(SentStep { run_id, step, dropped_steps, has_predecessor, wanted, params, bytes, reference })
        }
    }

    #[test]
    fn every_eighth_step_is_a_key_frame_and_those_asked_for_and_some_after_a_loss() {
        let mut sender = Sender::new();
        let sent: Vec<bool> = (0..17).map(|_| sender.send(0.0, 0, false)).collect();
        let keys: Vec<usize> = (0..17).filter(|&n| !sent[n]).collect();
        assert_eq!(keys, [0, 8, 16]);
        assert!(sender.send(0.0, 0, false));
        assert!(!sender.send(0.0, 0, true), "asked for");
        assert!(sender.send(0.0, 0, false));
        sender.setting.params = Some(params(0.02));
        assert!(!sender.send(0.0, 0, false), "other parameters");
        assert!(sender.send(0.0, 0, false));
        // A step was dropped: this one and some more are coded alone.
        assert!((0..=ALONE).all(|_| !sender.send(0.0, 1, false)));
        assert!(sender.send(0.0, 1, false));
    }

    #[test]
    fn what_resembles_nothing_is_coded_alone_for_a_while() {
        let mut sender = Sender::new();
        sender.send(0.3, 0, false);
        sender.send(0.3, 0, false);
        let next: Vec<bool> = (0..ALONE + 2).map(|_| sender.send(0.0, 0, false)).collect();
        let after = next.iter().position(|is_after| *is_after);
        assert!(after.is_some_and(|n| n as u32 == ALONE || n as u32 == ALONE - 1), "{after:?}");
    }

    #[test]
    fn where_time_counts_or_nothing_is_settled_every_step_is_a_key_frame() {
        let with = |change: &dyn Fn(&mut Setting)| {
            let mut sender = Sender::new();
            change(&mut sender.setting);
            (0..3).any(|_| sender.send(0.0, 0, false))
        };
        assert!(with(&|_| {}));
        assert!(!with(&|setting| setting.objective = Objective::Time));
        assert!(!with(&|setting| setting.limits = Limits { time_ms: Some(9.0), ..Limits::default() }));
        assert!(!with(&|setting| setting.limits = Limits { overhead: Some(0.1), ..Limits::default() }));
        assert!(!with(&|setting| setting.params = None));
    }

    #[test]
    fn what_is_saved_is_spent_where_quality_is_wanted_and_the_key_frame_fills_the_limit() {
        let fills = |objective, limit| {
            let mut sender = Sender::new();
            sender.setting.objective = objective;
            sender.send(0.0, 0, false);
            let key_bytes = sender.keys.last.as_ref().unwrap().key_bytes as f64;
            sender.setting.limits.size_bytes = Some((limit * key_bytes) as u64);
            sender.keys.predecessor(("r", 0), params(0.01), &sender.setting, false).unwrap().fills_limit
        };
        assert!(fills(Objective::Quality, 1.1));
        assert!(!fills(Objective::Quality, 2.0));
        assert!(!fills(Objective::Size, 1.1));
    }
}
