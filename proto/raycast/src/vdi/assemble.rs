//! Assembly of a VDI, shared by all levels of `generate`: its header, and its bands of rows joined in order as workers finish.

use lamina_model::{Grid, Invalid, Scene, Supersegment, Vdi, VdiHeader, VdiParams};
use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The header of the VDI with `params` of a field on `grid` under `scene`.
///
/// # Errors
/// If the step is so short that rays would have too many of them.
pub(crate) fn header(grid: &Grid, scene: &Scene, params: &VdiParams) -> Result<VdiHeader, Invalid> {
    scene.effects.check_step(params.step_voxels())?;
    VdiHeader {
        camera: scene.camera,
        bounds: grid.bounds(),
        step_length: params.step_voxels() * grid.voxel_length(),
        params: *params,
        transfer_id: scene.transfer.id(),
        background: scene.background,
    }
    .check()
}

/// Consecutive rows of rays: the number of supersegments of each ray, and the supersegments of all rays in order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RowBand {
    /// Supersegments per ray.
    pub counts: Vec<u32>,
    /// All lists, one after the other.
    pub segments: Vec<Supersegment>,
}

impl RowBand {
    /// All rays of `bands`, in order.
    pub(crate) fn concat(bands: Vec<Self>) -> Self {
        let mut all = Self::default();
        all.segments.reserve_exact(bands.iter().map(|band| band.segments.len()).sum());
        for band in bands {
            all.counts.extend(band.counts);
            all.segments.extend(band.segments);
        }
        all
    }
}

/// Runs `work` for bands 0..`count` on all cores and passes the results to `take` in order.
///
/// Workers start bands in order too, so few finished ones ever wait for an earlier one: besides what `take` keeps, memory is
/// that of a few bands.
pub(crate) fn in_order<T: Send>(count: usize, work: impl Fn(usize) -> T + Sync, take: impl FnMut(T) + Send) {
    struct Reordering<T, F> {
        waiting: BTreeMap<usize, T>,
        next: usize,
        take: F,
    }
    let reordering = Mutex::new(Reordering { waiting: BTreeMap::new(), next: 0, take });
    let fetched = AtomicUsize::new(0);
    rayon::broadcast(|_| {
        loop {
            let n = fetched.fetch_add(1, Ordering::Relaxed);
            if n >= count {
                return;
            }
            let band = work(n);
            let mut reordering = reordering.lock();
            reordering.waiting.insert(n, band);
            let Reordering { waiting, next, take } = &mut *reordering;
            while let Some(band) = waiting.remove(next) {
                take(band);
                *next += 1;
            }
        }
    });
}

/// Supersegments per ray for which capacity is reserved.
const USUAL_LIST: usize = 16;

/// Builds a VDI from bands of rows that are added in order.
#[derive(Debug)]
pub(crate) struct VdiBuilder {
    offsets: Vec<u32>,
    segments: Vec<Supersegment>,
    total: usize,
}

impl VdiBuilder {
    /// An empty builder for a VDI of `rays` rays.
    pub(crate) fn new(rays: usize) -> Self {
        let mut offsets = Vec::with_capacity(rays + 1);
        offsets.push(0);
        // Untouched capacity costs no memory, whereas a vector that outgrows its own is held twice while it moves.
        let mut segments = Vec::new();
        let _ = segments.try_reserve_exact(rays.saturating_mul(USUAL_LIST));
        Self { offsets, segments, total: 0 }
    }

    /// Appends a band's lists.
    pub(crate) fn add(&mut self, band: RowBand) {
        self.total += band.segments.len();
        if u32::try_from(self.total).is_err() {
            return;
        }
        let mut end = self.segments.len() as u32;
        self.offsets.extend(band.counts.iter().map(|n| {
            end += n;
            end
        }));
        self.segments.extend_from_slice(&band.segments);
    }

    /// The finished VDI.
    ///
    /// # Errors
    /// If it has 2^32 supersegments or more.
    pub(crate) fn finish(mut self, header: VdiHeader) -> Result<Vdi, Invalid> {
        if u32::try_from(self.total).is_err() {
            let total = self.total;
            return Err(Invalid::new("vdi", format!("{total} supersegments; raise gamma or lower the resolution")));
        }
        self.segments.shrink_to_fit();
        Vdi::new(header, self.offsets, self.segments)
    }
}
