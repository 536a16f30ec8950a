//! A volume made ready for sampling under a scene: voxels kept as narrow as they came, and where to skip.
//!
//! The field drawn is the position in the transfer function's range, interpolated trilinearly between sample points.
//! Under a linear range whole numbers and half floats are stored as they are, and the range is applied after
//! interpolation, unless the range is too narrow for that in single precision; single and double precision are mapped
//! first and stored as f32 (in place, if f32 came). Under a logarithmic range all are mapped first: what is interpolated
//! is the logarithm, so that a steep front keeps its decades. Voxels that are not finite are NaN, and any sample whose
//! cell touches one is empty.

use super::color_channel::Colors;
use super::effects::Effects;
use super::occupancy::{Scalar, SkipMap};
use glam::DVec3;
use half::f16;
use lamina_model::{
    Grid, Invalid, ReducedVolume, ScalarRange, Scale, Scene, TransferFunction, Volume, Voxels, for_voxels,
};
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Voxels under a scene.
#[derive(Debug)]
pub struct Field {
    id: u64,
    grid: Grid,
    scene: Scene,
    stored: Arc<Stored>,
    /// Position in the range = `scale` * stored + `offset`.
    scale: f64,
    offset: f64,
    empty_voxels: u64,
    skip: SkipMap,
    effects: Option<Effects>,
}

/// Scalars as they are kept for sampling, x fastest.
#[derive(Debug)]
pub enum Stored {
    /// Unsigned 8 bits.
    U8(Vec<u8>),
    /// Unsigned 16 bits; signed ones are moved up by 32768.
    U16(Vec<u16>),
    /// Half precision.
    F16(Vec<f16>),
    /// Single precision, mapped into the range.
    F32(Vec<f32>),
}

/// Runs `$body` with `$v` bound to the typed vector inside `$stored`.
macro_rules! for_stored {
    ($stored:expr, $v:ident => $body:expr) => {
        match $stored {
            Stored::U8($v) => $body,
            Stored::U16($v) => $body,
            Stored::F16($v) => $body,
            Stored::F32($v) => $body,
        }
    };
}

pub(crate) use for_stored;

impl Field {
    /// Maps `volume` into the range of the scene's transfer function, and finds what the function leaves empty. A second
    /// field is kept if the scene asks for one of that name ([`Scene::check_second_field`]).
    pub fn new(volume: Volume, scene: &Scene) -> Self {
        let (grid, voxels, second) = volume.into_parts();
        let range = scene.transfer.range();
        let asked = scene.effects.color_field.as_ref().zip(second).filter(|(asked, (name, _))| asked.name == *name);
        let colors = asked.map(|(map, (_, voxels))| Arc::new(Colors::new(&grid, voxels, map)));
        let ((stored, is_moved), empty_voxels) = stored(voxels, range);
        let moved = if is_moved { f64::from(i16::MIN) } else { 0.0 };
        let (scale, offset) = match stored {
            Stored::F32(_) => (1.0, 0.0),
            _ => (1.0 / (range.hi() - range.lo()), (moved - range.lo()) / (range.hi() - range.lo())),
        };
        Self { empty_voxels, ..Self::of(grid, scene.clone(), Arc::new(stored), [scale, offset], colors) }
    }

    /// A reduced volume, ready to be drawn.
    pub fn of_reduced(volume: ReducedVolume) -> Self {
        let (grid, scene, units) = volume.into_parts();
        Self::of(grid, scene, Arc::new(Stored::F32(units)), [1.0, 0.0], None)
    }

    /// The same voxels, of which main memory holds one copy, under another transfer function over the same range.
    ///
    /// # Errors
    /// If it is over another.
    pub fn with_transfer(&self, transfer: TransferFunction) -> Result<Self, Invalid> {
        if transfer.range() != self.scene.transfer.range() {
            return Err(Invalid::new("transfer.range", "not the one the voxels were brought to"));
        }
        let scene = Scene { transfer, ..self.scene.clone() };
        let colors = self.effects().and_then(|e| e.colors.clone());
        let field = Self::of(self.grid, scene, self.stored.clone(), [self.scale, self.offset], colors);
        Ok(Self { empty_voxels: self.empty_voxels, ..field })
    }

    fn of(
        grid: Grid,
        scene: Scene,
        stored: Arc<Stored>,
        [scale, offset]: [f64; 2],
        colors: Option<Arc<Colors>>,
    ) -> Self {
        static FIELDS: AtomicU64 = AtomicU64::new(0);
        let id = FIELDS.fetch_add(1, Ordering::Relaxed);
        let unit = |x: f32| (scale * f64::from(x) + offset) as f32;
        let surfaces: Vec<f32> =
            scene.effects.isosurfaces.iter().map(|s| scene.transfer.range().unit_from_value(s.value)).collect();
        let skip = for_stored!(&*stored, v => SkipMap::new(&grid, v, scene.effects.look_beside(), |lo, hi| {
            let (lo, hi) = (unit(lo), unit(hi));
            !scene.transfer.is_transparent(lo, hi) || surfaces.iter().any(|s| (lo..=hi).contains(s))
        }));
        let mut field = Self { id, grid, scene, stored, scale, offset, empty_voxels: 0, skip, effects: None };
        field.effects = Effects::new(&field.scene, &grid, colors, |p| field.extinction(p));
        field
    }

    /// Tells fields apart for as long as the process lives.
    pub fn id(&self) -> u64 {
        self.id
    }
    /// Where the voxels lie.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }
    /// What they are seen under.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }
    /// The scalars as kept.
    pub fn stored(&self) -> &Stored {
        &self.stored
    }
    /// `(scale, offset)`: the position in the range is `scale` times the stored scalar plus `offset`.
    pub fn unit_from_stored(&self) -> (f64, f64) {
        (self.scale, self.offset)
    }
    /// Where rays may skip.
    pub fn skip(&self) -> &SkipMap {
        &self.skip
    }
    /// What else the scene asks for.
    pub fn effects(&self) -> Option<&Effects> {
        self.effects.as_ref()
    }
    /// Voxels that are NaN or infinite in the data, drawn as empty.
    pub fn empty_voxels(&self) -> u64 {
        self.empty_voxels
    }
    /// World length that opacities refer to.
    pub fn unit_length(&self) -> f64 {
        self.scene.transfer.unit_length(&self.grid)
    }

    /// Extinction at `index`, per world length.
    fn extinction(&self, index: DVec3) -> f64 {
        if !self.skip.is_visible(index) {
            return 0.0;
        }
        self.scene.transfer.classify(self.sample(index), self.unit_length()).extinction
    }

    /// `point` of the world in units of sample points.
    pub fn index_from_world(&self, point: DVec3) -> DVec3 {
        (point - self.grid.origin()) / self.grid.spacing()
    }

    /// The trilinear value at `index` (units of sample points), which is clamped into the grid. Double precision: what the
    /// fast levels are compared with.
    #[inline]
    pub fn sample(&self, index: DVec3) -> f32 {
        let value = for_stored!(&*self.stored, v => trilinear(self.grid.dims(), v, index));
        (self.scale * value + self.offset) as f32
    }
}

/// The trilinear value of `values`, x fastest, at `index` (units of sample points), which is clamped into the grid.
#[inline]
pub fn trilinear<T: Scalar>(dims: [usize; 3], values: &[T], index: DVec3) -> f64 {
    let mut base = 0;
    let mut stride = 1;
    let mut next = [0; 3];
    let mut w = [0.0; 3];
    for axis in 0..3 {
        let last = dims[axis] - 1;
        let x = index[axis].clamp(0.0, last as f64);
        let cell = (x as usize).min(last.saturating_sub(1));
        w[axis] = x - cell as f64;
        base += cell * stride;
        next[axis] = if last > 0 { stride } else { 0 };
        stride *= dims[axis];
    }
    let lerp = |a: f64, b: f64, w: f64| a + w * (b - a);
    let along_x = |i: usize| lerp(values[i].wide(), values[i + next[0]].wide(), w[0]);
    let along_y = |i: usize| lerp(along_x(i), along_x(i + next[1]), w[1]);
    lerp(along_y(base), along_y(base + next[2]), w[2])
}

/// The scalars to keep and whether they were moved up, and how many are not finite.
fn stored(voxels: Voxels, range: &ScalarRange) -> ((Stored, bool), u64) {
    let width = range.hi() - range.lo();
    // 65536 voxel values and rows of a table: positions as rows stay far below the greatest single.
    if range.scale() == Scale::Linear && (65536.0 + range.lo().abs()) / width < f64::from(ScalarRange::FARTHEST) {
        match voxels {
            Voxels::U8(v) => return ((Stored::U8(v), false), 0),
            Voxels::U16(v) => return ((Stored::U16(v), false), 0),
            Voxels::I16(v) => {
                return ((Stored::U16(v.into_iter().map(|x| (x as u16) ^ 0x8000).collect()), true), 0);
            }
            Voxels::F16(mut v) => {
                v.par_iter_mut().filter(|x| !x.is_finite()).for_each(|x| *x = f16::NAN);
                let empty = v.par_iter().filter(|x| x.is_nan()).count() as u64;
                return ((Stored::F16(v), false), empty);
            }
            Voxels::F32(_) | Voxels::F64(_) => {}
        }
    }
    let mapped = units(voxels, range);
    let empty = mapped.par_iter().filter(|x| x.is_nan()).count() as u64;
    ((Stored::F32(mapped), false), empty)
}

/// Positions in `range`; NaN for what is not finite. Single precision is mapped in place.
#[expect(clippy::useless_conversion, reason = "one body for all voxel types, f64 among them")]
pub fn units(voxels: Voxels, range: &ScalarRange) -> Vec<f32> {
    let width = range.hi() - range.lo();
    match voxels {
        Voxels::F32(mut v) if range.scale() == Scale::Linear && (1.0 / width).is_finite() => {
            let (lo, per_range, most) = (range.lo(), 1.0 / width, f64::from(ScalarRange::FARTHEST));
            v.par_chunks_mut(1 << 14).for_each(|chunk| {
                for x in chunk {
                    let unit = ((f64::from(*x) - lo) * per_range).clamp(-most, most) as f32;
                    *x = if x.is_finite() { unit } else { f32::NAN };
                }
            });
            v
        }
        Voxels::F32(mut v) => {
            v.par_iter_mut().for_each(|x| *x = range.unit_from_value((*x).into()));
            v
        }
        other if range.scale() == Scale::Linear => {
            let lo = range.lo();
            for_voxels!(&other, v => v.par_iter().map(|&x| ScalarRange::linear(x.into(), lo, width)).collect())
        }
        other => for_voxels!(&other, v => v.par_iter().map(|&x| range.unit_from_value(x.into())).collect()),
    }
}
