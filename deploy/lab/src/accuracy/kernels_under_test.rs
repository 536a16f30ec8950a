//! The product's own kernels, timed over whole pictures and compared with the reference on the sampled rays.

use super::curve::Point;
use super::error::Error;
use super::requantize;
use super::views::Views;
use lamina_codec::{DecodeLimits, EncodeOptions};
use lamina_model::{Camera, GenerationParams, ParamsKey, Scene, Segmentation, Vdi, VdiParams, Volume};
use lamina_raycast::Field;
use lamina_vdi_render::{Detail, Kernels, PreparedVdi};
use std::collections::HashMap;
use std::ops::Deref;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How often everything is measured.
pub(super) const ROUNDS: usize = 3;
/// What takes longer is measured once.
const PATIENCE: Duration = Duration::from_secs(3);

/// The median time of three measurements in milliseconds, or of one that takes long by itself; and what came of the last.
pub(super) fn median_ms<T>(mut work: impl FnMut() -> anyhow::Result<(T, Duration)>) -> anyhow::Result<(T, f64)> {
    let (mut made, first) = work()?;
    let mut times = vec![first];
    while times.len() < ROUNDS && first < PATIENCE {
        let (again, time) = work()?;
        made = again;
        times.push(time);
    }
    Ok((made, median(&times)))
}

fn median(times: &[Duration]) -> f64 {
    let mut sorted = times.to_vec();
    sorted.sort_unstable();
    sorted.get(sorted.len() / 2).map_or(f64::NAN, |t| 1e3 * t.as_secs_f64())
}

/// `work` with the wall time it took.
pub(super) fn timed<T>(work: impl FnOnce() -> anyhow::Result<T>) -> anyhow::Result<(T, Duration)> {
    let start = Instant::now();
    let made = work()?;
    Ok((made, start.elapsed()))
}

/// A point, and the colors it was measured by.
pub(super) type TimedPicture = (Point, Vec<[f32; 3]>);

/// A VDI's times, round by round, and what does not change with them.
#[derive(Default)]
struct KernelTimings {
    shot: Option<TimedPicture>,
    generation: Vec<Duration>,
    drawing: Vec<Duration>,
}

/// Both nodes' kernels on one volume.
pub(super) struct KernelsUnderTest<'a> {
    field: &'a Field,
    kernels: &'a Kernels,
    views: &'a Views,
    reference: &'a [[f64; 3]],
    trials: HashMap<ParamsKey, KernelTimings>,
}

impl<'a> KernelsUnderTest<'a> {
    /// Measures on `field`, against the colors `reference` of the rays of `views`.
    pub(super) fn new(field: &'a Field, kernels: &'a Kernels, views: &'a Views, reference: &'a [[f64; 3]]) -> Self {
        Self { field, kernels, views, reference, trials: HashMap::new() }
    }

    /// Ray casting with another step. The step is the field's, which is made anew.
    pub(super) fn raycast(&self, volume: &Volume, step_voxels: f64) -> anyhow::Result<TimedPicture> {
        let scene = Scene { step_voxels, ..self.field.scene().clone() };
        let field = Field::new(volume.clone(), &scene);
        let (backend, size) = (&self.kernels.cast, self.views.size());
        let seen =
            self.views.gather(|camera, pixels| Ok(backend.raycast_pixels(&field, camera, size, size, pixels)?))?;
        let (_, time_ms) = median_ms(|| timed(|| Ok(backend.raycast(&field, self.views.middle(), size, size)?)))?;
        Ok((Point { time_ms, ..self.point(step_voxels, &seen) }, seen))
    }

    /// A VDI generated and drawn once more; encoded too the first time, which then is what is drawn and compared. Rounds of
    /// all settings follow one another, so that whatever else the machine does meets all alike.
    pub(super) fn round(&mut self, params: &VdiParams) -> anyhow::Result<()> {
        let mut trial = self.trials.remove(&GenerationParams::from(*params).key()).unwrap_or_default();
        if trial.generation.first().is_none_or(|&first| first < PATIENCE) {
            let (vdi, time) = self.kernels.cast.generate(self.field, params, Segmentation::Fitted)?;
            trial.generation.push(time);
            let prepared = if trial.shot.is_some() {
                PreparedVdi::new(Arc::new(vdi))
            } else {
                let (decoded, shot) = self.through_codec(0.0, &vdi)?;
                trial.shot = Some(shot);
                decoded
            };
            let size = self.views.size();
            let draw =
                || Ok(self.kernels.draw.render_vdi(&prepared, self.views.middle(), size, size, Detail::Cubic)?);
            trial.drawing.push(timed(draw)?.1);
        }
        self.trials.insert(GenerationParams::from(*params).key(), trial);
        Ok(())
    }

    /// `vdi` encoded, as it comes back, and what it then looks like.
    fn through_codec(&self, value: f64, vdi: &Vdi) -> anyhow::Result<(PreparedVdi, TimedPicture)> {
        let (bytes, time) = timed(|| Ok(lamina_codec::encode(vdi, &EncodeOptions::default())?))?;
        let decoded = PreparedVdi::new(Arc::new(lamina_codec::decode(&bytes, &DecodeLimits::default())?));
        let (point, seen) = self.seen(value, &decoded, Detail::Cubic)?;
        let (encode_ms, size_bytes) = (Some(1e3 * time.as_secs_f64()), Some(bytes.len() as u64));
        Ok((decoded, (Point { encode_ms, size_bytes, params: Some(vdi.header().params), ..point }, seen)))
    }

    /// What the rounds gave for `params`, as the point of `value`.
    pub(super) fn vdi(&self, value: f64, params: &VdiParams) -> Option<TimedPicture> {
        let trial = self.trials.get(&GenerationParams::from(*params).key())?;
        let (point, seen) = trial.shot.as_ref()?;
        let (time_ms, draw_ms) = (median(&trial.generation), Some(median(&trial.drawing)));
        Some((Point { value, time_ms, draw_ms, ..point.clone() }, seen.clone()))
    }

    /// The VDI of `params`.
    pub(super) fn generate(&self, params: &VdiParams) -> anyhow::Result<Vdi> {
        Ok(self.kernels.cast.generate(self.field, params, Segmentation::Fitted)?.0)
    }

    /// `vdi` through the codec and drawn as it comes back.
    pub(super) fn encoded(&self, value: f64, vdi: &Vdi) -> anyhow::Result<TimedPicture> {
        Ok(self.through_codec(value, vdi)?.1)
    }

    fn seen<V: Deref<Target = Vdi>>(
        &self,
        value: f64,
        vdi: &PreparedVdi<V>,
        detail: Detail,
    ) -> anyhow::Result<TimedPicture> {
        let (viewer, size) = (&self.kernels.draw, [self.views.size(); 2]);
        let seen = self.views.gather(|camera, pixels| Ok(viewer.vdi_pixels(vdi, camera, size, pixels, detail)?))?;
        Ok((self.point(value, &seen), seen))
    }

    /// What `vdi` looks like drawn with `detail`; the time is that of drawing a whole picture.
    pub(super) fn drawn(&self, value: f64, vdi: &PreparedVdi<&Vdi>, detail: Detail) -> anyhow::Result<TimedPicture> {
        let size = self.views.size();
        let (point, seen) = self.seen(value, vdi, detail)?;
        let draw = || Ok(self.kernels.draw.render_vdi(vdi, self.views.middle(), size, size, detail)?);
        let (_, time_ms) = median_ms(|| timed(draw))?;
        Ok((Point { time_ms, draw_ms: Some(time_ms), ..point }, seen))
    }

    /// `vdi`, its color and opacity rounded to `bits`.
    pub(super) fn with_color_bits(&self, vdi: &Vdi, bits: u32) -> anyhow::Result<TimedPicture> {
        // The codec stores eight bits: what has more is drawn as it is.
        let rounded = requantize::with_color_bits(vdi, bits)?;
        if bits <= 8 {
            self.encoded(bits.into(), &rounded)
        } else {
            self.seen(bits.into(), &PreparedVdi::new(&rounded), Detail::Cubic)
        }
    }

    fn point(&self, value: f64, seen: &[[f32; 3]]) -> Point {
        let pre_integrated = self.field.scene().effects.pre_integrated;
        Point { pre_integrated, ..Point::new(value, Error::between(seen, self.reference), f64::NAN) }
    }

    /// Everything generated so far.
    pub(super) fn trials(&self) -> Vec<Point> {
        let all = self.trials.values().filter_map(|t| t.shot.as_ref()?.0.params);
        all.filter_map(|params| Some(self.vdi(0.0, &params)?.0)).collect()
    }

    /// RMS error of whole pictures of side `size`, all views, as the product measures it; and the time that takes.
    pub(super) fn whole_pictures(&self, vdi: &PreparedVdi<&Vdi>, size: u32) -> anyhow::Result<(Error, f64)> {
        let cameras: Vec<Camera> = self.views.cameras().to_vec();
        let measure = || {
            timed(|| {
                let mut drawn = Vec::new();
                let mut cast = Vec::new();
                for camera in &cameras {
                    drawn.extend_from_slice(
                        self.kernels.draw.render_vdi(vdi, camera, size, size, Detail::Cubic)?.pixels(),
                    );
                    cast.extend_from_slice(self.kernels.cast.raycast(self.field, camera, size, size)?.pixels());
                }
                Ok(Error::between(&drawn, &cast))
            })
        };
        median_ms(measure)
    }
}
