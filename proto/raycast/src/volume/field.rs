//! A volume prepared for sampling under a scene: stored voxels, a map of empty space, and effects.
//!
//! The field that is drawn is the position in the transfer function's range, interpolated trilinearly between sample points.
//! A sample is empty if its cell has a point that is not finite.

use super::color_channel::ColorChannel;
use super::effects::FieldEffects;
use super::interpolate::trilinear;
use super::light_volume;
use super::occupancy::EmptySpaceMap;
use super::part::GridPart;
use super::part_sums::PartSums;
use super::stored::{StoredVoxels, for_stored, stored};
use glam::DVec3;
use lamina_model::{Grid, Invalid, ReducedVolume, Scene, Volume};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// A volume under a scene.
#[derive(Debug)]
pub struct Field {
    id: u64,
    /// The whole grid.
    grid: Grid,
    part: GridPart,
    scene: Scene,
    stored: Arc<StoredVoxels>,
    /// Position in the range = `scale` * stored scalar + `offset`.
    scale: f64,
    offset: f64,
    empty_voxels: u64,
    empty_space: EmptySpaceMap,
    effects: Option<FieldEffects>,
}

impl Field {
    /// Maps `volume` into the range of the scene's transfer function, and finds its empty space. A second field is kept if the
    /// scene takes its colors from a field of that name.
    pub fn new(volume: Volume, scene: &Scene) -> Self {
        let whole = GridPart::whole(volume.grid());
        let grid = *volume.grid();
        Self::of_part(volume, (grid, whole), scene)
    }

    /// The same of a part of a grid: `stored` holds its sample points, `grid` is the whole one. Shadows and ambient occlusion come with
    /// [`Field::lit`].
    ///
    /// # Errors
    /// If `stored` has other points than the part.
    pub fn part(stored: Volume, (grid, part): (Grid, GridPart), scene: &Scene) -> Result<Self, Invalid> {
        if stored.grid().dims() != part.dims() {
            let (have, need) = (stored.grid().dims(), part.dims());
            return Err(Invalid::new("part", format!("{have:?} sample points are stored where it has {need:?}")));
        }
        Ok(Self::of_part(stored, (grid, part), scene))
    }

    fn of_part(volume: Volume, (grid, part): (Grid, GridPart), scene: &Scene) -> Self {
        let (_, voxels, second) = volume.into_parts();
        let range = scene.transfer.range();
        let asked = scene.effects.color_field.as_ref().zip(second).filter(|(asked, (name, _))| asked.name == *name);
        let colors = asked.map(|(map, (_, voxels))| Arc::new(ColorChannel::new(part.dims(), voxels, map)));
        let ((stored, is_moved), empty_voxels) = stored(voxels, range);
        let moved = if is_moved { f64::from(i16::MIN) } else { 0.0 };
        let (scale, offset) = match stored {
            StoredVoxels::F32(_) => (1.0, 0.0),
            _ => (1.0 / (range.hi() - range.lo()), (moved - range.lo()) / (range.hi() - range.lo())),
        };
        Self { empty_voxels, ..Self::of((grid, part), scene.clone(), Arc::new(stored), [scale, offset], colors) }
    }

    /// Prepares a reduced volume.
    pub fn of_reduced(volume: ReducedVolume) -> Self {
        let (grid, scene, units) = volume.into_parts();
        let whole = GridPart::whole(&grid);
        Self::of((grid, whole), scene, Arc::new(StoredVoxels::F32(units)), [1.0, 0.0], None)
    }

    /// The same field under another scene over the same range. Both share the voxels in memory.
    ///
    /// # Errors
    /// If the ranges differ.
    pub fn with_scene(&self, scene: Scene) -> Result<Self, Invalid> {
        if scene.transfer.range() != self.scene.transfer.range() {
            return Err(Invalid::new("transfer.range", "not the one the voxels were brought to"));
        }
        let colors = self.effects().and_then(|e| e.colors.clone());
        let field =
            Self::of((self.grid, self.part.clone()), scene, self.stored.clone(), [self.scale, self.offset], colors);
        Ok(Self { empty_voxels: self.empty_voxels, ..field })
    }

    fn of(
        (grid, part): (Grid, GridPart),
        scene: Scene,
        stored: Arc<StoredVoxels>,
        [scale, offset]: [f64; 2],
        colors: Option<Arc<ColorChannel>>,
    ) -> Self {
        static FIELDS: AtomicU64 = AtomicU64::new(0);
        let id = FIELDS.fetch_add(1, Ordering::Relaxed);
        let unit = |x: f32| (scale * f64::from(x) + offset) as f32;
        let surfaces: Vec<f32> =
            scene.effects.isosurfaces.iter().map(|s| scene.transfer.range().unit_from_value(s.value)).collect();
        let (points, beside) = ((part.start(), part.dims()), scene.effects.look_beside());
        let empty_space = for_stored!(&*stored, v => EmptySpaceMap::new(points, v, beside, |lo, hi| {
            let (lo, hi) = (unit(lo), unit(hi));
            !scene.transfer.is_transparent(lo, hi) || surfaces.iter().any(|s| (lo..=hi).contains(s))
        }));
        let mut field =
            Self { id, grid, part, scene, stored, scale, offset, empty_voxels: 0, empty_space, effects: None };
        field.effects = FieldEffects::new(&field.scene, &grid, colors);
        let of_all = field.part.is_whole().then(|| field.extinction_sums()).flatten();
        if let Some((effects, PartSums { sums, .. })) = field.effects.as_mut().zip(of_all) {
            effects.volume = Some(effects.light_volume(&grid, sums));
        }
        field
    }

    /// What this part's own cells give to the extinction that light passes; `None` if the scene has neither shadows nor ambient
    /// occlusion.
    pub fn extinction_sums(&self) -> Option<PartSums> {
        let effects = self.effects.as_ref().filter(|_| self.scene.effects.needs_light_volume())?;
        // Clipped parts cast no shadow.
        let extinction = |p: DVec3| if effects.keeps(p) { self.extinction(p) } else { 0.0 };
        Some(light_volume::extinction_sums(&self.grid, &self.part, extinction))
    }

    /// Parts of one field in the light that it lets through: `sums` are those of all its parts, also of those that are not among these.
    ///
    /// # Errors
    /// If the sums are of other points.
    pub fn lit(mut parts: Vec<Self>, sums: &[PartSums]) -> Result<Vec<Self>, Invalid> {
        let mut shared = None;
        for Self { grid, scene, effects, .. } in &mut parts {
            let Some(effects) = effects.as_mut().filter(|_| scene.effects.needs_light_volume()) else { continue };
            if shared.is_none() {
                shared = Some(effects.light_volume(grid, light_volume::added_up(grid, sums)?));
            }
            effects.volume.clone_from(&shared);
        }
        Ok(parts)
    }

    /// Identity of the field, unique within the process.
    pub fn id(&self) -> u64 {
        self.id
    }
    /// Position and spacing of the sample points.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }
    /// Which part of the grid is stored, and which cells rays are cast through.
    pub fn grid_part(&self) -> &GridPart {
        &self.part
    }
    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }
    /// The stored voxels.
    pub fn stored(&self) -> &StoredVoxels {
        &self.stored
    }
    /// The positions in the range of all sample points, x fastest, where they are stored as such: in a reduced volume, or of `f32` data.
    pub fn units(&self) -> Option<&[f32]> {
        match &*self.stored {
            StoredVoxels::F32(units) => Some(units),
            _ => None,
        }
    }
    /// `(scale, offset)`: the position in the range is `scale` times the stored scalar plus `offset`.
    pub fn unit_from_stored(&self) -> (f64, f64) {
        (self.scale, self.offset)
    }
    /// Map of empty space, which rays skip.
    pub fn empty_space(&self) -> &EmptySpaceMap {
        &self.empty_space
    }
    /// Effects of the scene, if it has any.
    pub fn effects(&self) -> Option<&FieldEffects> {
        self.effects.as_ref()
    }
    /// Number of voxels that are NaN or infinite in the data; they are drawn as empty.
    pub fn empty_voxels(&self) -> u64 {
        self.empty_voxels
    }
    /// World length that opacities refer to.
    pub fn unit_length(&self) -> f64 {
        self.scene.transfer.unit_length(&self.grid)
    }

    /// Extinction at `index`, per world length; 0 outside of its own cells.
    fn extinction(&self, index: DVec3) -> f64 {
        if !self.is_visible(index) {
            return 0.0;
        }
        self.scene.transfer.classify(self.sample(index), self.unit_length()).extinction
    }

    /// True if the surroundings of `index` (units of sample points, inside the grid) may show something of this field's own.
    #[inline]
    pub(crate) fn is_visible(&self, index: DVec3) -> bool {
        self.empty_space.is_visible(index) && (self.part.is_whole() || self.part.owns(index))
    }

    /// A world point in units of sample points.
    pub fn index_from_world(&self, point: DVec3) -> DVec3 {
        (point - self.grid.origin()) / self.grid.spacing()
    }

    /// The trilinear value at `index` (units of sample points), which is clamped into the grid, as a position in the range.
    /// Double precision: the value that the fast levels are compared with.
    #[inline]
    pub fn sample(&self, index: DVec3) -> f32 {
        let value = for_stored!(&*self.stored, v => trilinear(self.part.dims(), v, self.part.local(index)));
        (self.scale * value + self.offset) as f32
    }
}
