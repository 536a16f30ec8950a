//! A picture of a recorded step from an orbiting camera, as PNG.

use crate::store::{Store, StoreError};
use lamina_model::{Appearance, Invalid};
use lamina_rpc::credentials::Role;
use lamina_rpc::daemon::{Timeline, Trace};
use lamina_vdi_render::{Backend, Detail, Drawable};
use parking_lot::{Mutex, MutexGuard};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What the page asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orbit {
    /// Turn about the camera's up vector, degrees.
    pub azimuth_deg: f64,
    /// Lift, degrees.
    pub elevation_deg: f64,
    /// Distance divided by this.
    pub zoom: f64,
    /// Side of the picture, pixels.
    pub size: u32,
    /// How carefully it is drawn.
    pub detail: Detail,
}

/// A rendered picture.
#[derive(Debug)]
pub struct PaintedPicture {
    /// The step it shows.
    pub step: u64,
    /// PNG.
    pub png: Vec<u8>,
    /// Wall time of rendering, without PNG.
    pub render_time: Duration,
}

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
pub enum PaintError {
    /// The step cannot be had.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The camera or size cannot be.
    #[error(transparent)]
    Invalid(#[from] Invalid),
}

/// Largest side of a picture for the page.
const MAX_SIZE: u32 = 2048;

/// Draws steps, from anywhere and, where they are volumes, looking otherwise.
#[derive(Debug)]
pub struct Painter {
    store: Arc<Store>,
    backend: Backend,
    changed: Mutex<Option<Changed>>,
}

/// The volume last drawn otherwise than recorded: the next picture is likely to be of it, looking the same; if one looks as
/// recorded, this is dropped.
#[derive(Debug)]
struct Changed {
    from: Arc<Drawable>,
    appearance: Appearance,
    shown: Arc<Drawable>,
}

impl Painter {
    /// Draws what `store` holds with `backend`.
    pub fn new(store: Arc<Store>, backend: Backend) -> Self {
        Self { store, backend, changed: Mutex::new(None) }
    }

    /// Draws `step`, with `appearance` if there is one. Nothing, if it is no longer `wanted`.
    ///
    /// # Errors
    /// If the step is not held, the orbit is out of bounds, or the step cannot look so.
    pub fn picture(
        &self,
        step: u64,
        orbit: Orbit,
        appearance: Option<Appearance>,
        wanted: impl Fn() -> bool,
    ) -> Result<Option<PaintedPicture>, PaintError> {
        if orbit.size > MAX_SIZE {
            return Err(Invalid::new("size", format!("{} exceeds {MAX_SIZE} pixels", orbit.size)).into());
        }
        let mut shown = self.store.prepared(step)?;
        let camera = shown.camera().orbit(orbit.azimuth_deg, orbit.elevation_deg, orbit.zoom)?;
        let (start, mut timeline) = (Instant::now(), Timeline::begin());
        match appearance {
            Some(appearance) => shown = self.changed(shown, appearance)?,
            None => *self.last() = None,
        }
        let image = self.backend.render_while(&shown, &camera, [orbit.size; 2], orbit.detail, wanted)?;
        let render_time = start.elapsed();
        timeline.lap("draw", [("lamina.side_px", i64::from(orbit.size).into())]);
        timeline.send(self.store.run().and_then(|run| Trace::of_step(Role::Viewer, &run.id, step)));
        image.map(|image| Ok(PaintedPicture { step, png: lamina_rpc::daemon::png(&image)?, render_time })).transpose()
    }

    fn last(&self) -> MutexGuard<'_, Option<Changed>> {
        self.changed.lock()
    }

    fn changed(&self, from: Arc<Drawable>, appearance: Appearance) -> Result<Arc<Drawable>, Invalid> {
        let mut last = self.last();
        if let Some(last) = last.as_ref().filter(|l| Arc::ptr_eq(&l.from, &from) && l.appearance == appearance) {
            return Ok(last.shown.clone());
        }
        let shown = Arc::new(from.with_appearance(&appearance)?);
        *last = Some(Changed { from, appearance, shown: shown.clone() });
        Ok(shown)
    }
}
