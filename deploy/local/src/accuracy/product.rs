//! The product's own kernels, timed over whole pictures and compared with the reference on the sampled rays.

use super::curve::Point;
use super::error::Error;
use super::stored;
use super::views::Views;
use lamina_generator_node::kernel::{Backend, Field};
use lamina_model::{Camera, GenerationParams, ParamsKey, Scene, Vdi, Volume};
use lamina_viz_node::kernel::{self as viz, PreparedVdi};
use lamina_wire::codec::{self, DecodeLimits, EncodeOptions};
use std::collections::HashMap;
use std::time::{Duration, Instant};

/// What takes longer is measured once.
const PATIENCE: Duration = Duration::from_secs(2);

/// The median of three measurements in milliseconds, or one that takes long by itself; and what came of the last.
pub fn median_ms<T>(mut work: impl FnMut() -> anyhow::Result<(T, Duration)>) -> anyhow::Result<(T, f64)> {
    let (mut made, first) = work()?;
    let mut times = vec![first];
    while times.len() < 3 && first < PATIENCE {
        let (again, time) = work()?;
        made = again;
        times.push(time);
    }
    times.sort_unstable();
    Ok((made, 1e3 * times[times.len() / 2].as_secs_f64()))
}

/// `work` with the wall time it took.
pub fn timed<T>(work: impl FnOnce() -> anyhow::Result<T>) -> anyhow::Result<(T, Duration)> {
    let start = Instant::now();
    let made = work()?;
    Ok((made, start.elapsed()))
}

/// A point, and the colours it was measured by.
pub type Shot = (Point, Vec<[f32; 3]>);

/// Both nodes' kernels on one volume.
pub struct Product<'a> {
    field: &'a Field,
    backends: (Backend, viz::Backend),
    views: &'a Views,
    reference: &'a [[f64; 3]],
    known: HashMap<ParamsKey, Shot>,
}

impl<'a> Product<'a> {
    /// Measures on `field`, against the colours `reference` of the rays of `views`.
    pub fn new(
        field: &'a Field,
        backends: (Backend, viz::Backend),
        views: &'a Views,
        reference: &'a [[f64; 3]],
    ) -> Self {
        Self { field, backends, views, reference, known: HashMap::new() }
    }

    /// Ray casting with another step. The step is the field's, which is made anew.
    pub fn raycast(&self, volume: &Volume, step_voxels: f64) -> anyhow::Result<Shot> {
        let scene = Scene { step_voxels, ..self.field.scene().clone() };
        let field = Field::new(volume.clone(), &scene);
        let (backend, size) = (&self.backends.0, self.views.size());
        let seen =
            self.views.gather(|camera, pixels| Ok(backend.raycast_pixels(&field, camera, size, size, pixels)?))?;
        let (_, time_ms) = median_ms(|| timed(|| Ok(backend.raycast(&field, self.views.middle(), size, size)?)))?;
        Ok((Point { time_ms, ..self.point(step_voxels, &seen) }, seen))
    }

    /// A VDI generated, encoded, decoded and drawn; measured once for each parameters.
    pub fn vdi(&mut self, value: f64, params: &GenerationParams) -> anyhow::Result<Shot> {
        if let Some((point, seen)) = self.known.get(&params.key()) {
            return Ok((Point { value, ..point.clone() }, seen.clone()));
        }
        let (vdi, time_ms) = self.generate(params)?;
        let (point, seen) = self.encoded(value, &vdi)?;
        let shot = (Point { time_ms, ..point }, seen);
        self.known.insert(params.key(), shot.clone());
        Ok(shot)
    }

    /// A VDI, and the median time of its generation.
    pub fn generate(&self, params: &GenerationParams) -> anyhow::Result<(Vdi, f64)> {
        median_ms(|| Ok(self.backends.0.generate(self.field, params)?))
    }

    /// `vdi` through the codec and drawn as it comes back.
    pub fn encoded(&self, value: f64, vdi: &Vdi) -> anyhow::Result<Shot> {
        let (bytes, encode_ms) = median_ms(|| timed(|| Ok(codec::encode(vdi, &EncodeOptions::default())?)))?;
        let (point, seen) = self.drawn(value, codec::decode(&bytes, &DecodeLimits::default())?)?;
        Ok((Point { encode_ms: Some(encode_ms), size_bytes: Some(bytes.len() as u64), ..point }, seen))
    }

    /// `vdi` drawn as it is.
    pub fn drawn(&self, value: f64, vdi: Vdi) -> anyhow::Result<Shot> {
        let (params, size) = (vdi.header().params, self.views.size());
        let prepared = PreparedVdi::new(std::sync::Arc::new(vdi));
        let seen = self.views.gather(|camera, pixels| Ok(prepared.render_pixels(camera, size, size, pixels)))?;
        let draw = || timed(|| Ok(self.backends.1.render(&prepared, self.views.middle(), size, size)?));
        let (_, draw_ms) = median_ms(draw)?;
        Ok((Point { params: Some(params), draw_ms: Some(draw_ms), ..self.point(value, &seen) }, seen))
    }

    /// `params`, with colour and opacity rounded to `bits`.
    pub fn with_color_bits(&self, vdi: &Vdi, bits: u32) -> anyhow::Result<Shot> {
        let rounded = stored::with_color_bits(vdi, bits)?;
        // The codec stores eight bits: what has more cannot be encoded, and is drawn as it is.
        if bits > 8 { self.drawn(bits.into(), rounded) } else { self.encoded(bits.into(), &rounded) }
    }

    fn point(&self, value: f64, seen: &[[f32; 3]]) -> Point {
        Point::new(value, Error::between(seen, self.reference), f64::NAN)
    }

    /// Everything generated so far.
    pub fn trials(&self) -> Vec<Point> {
        self.known.values().map(|(point, _)| point.clone()).collect()
    }

    /// RMS error of whole pictures of side `size`, all views, as the product measures it; and the time that takes.
    pub fn whole_pictures(&self, vdi: &PreparedVdi<&Vdi>, size: u32) -> anyhow::Result<(Error, f64)> {
        let cameras: Vec<Camera> = self.views.cameras().to_vec();
        let measure = || {
            timed(|| {
                let mut drawn = Vec::new();
                let mut cast = Vec::new();
                for camera in &cameras {
                    drawn.extend_from_slice(self.backends.1.render(vdi, camera, size, size)?.pixels());
                    cast.extend_from_slice(self.backends.0.raycast(self.field, camera, size, size)?.pixels());
                }
                Ok(Error::between(&drawn, &cast))
            })
        };
        median_ms(measure)
    }
}
