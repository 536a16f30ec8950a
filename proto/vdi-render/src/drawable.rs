//! A time step in either representation, prepared for rendering.

use super::{PreparedVdi, reference};
use lamina_model::{Appearance, Camera, Intermediate, Invalid, TransferFunction, Vdi};
use lamina_raycast::Field;
use std::sync::Arc;

/// A VDI or a reduced volume with the data structures that rendering needs, built once.
#[derive(Debug)]
pub enum Drawable {
    /// Rendered by traversal of its lists.
    Vdi(Box<PreparedVdi>),
    /// Ray-cast like the original volume.
    Volume(Box<Field>),
}

impl Drawable {
    /// Prepares a decoded time step.
    pub fn new(intermediate: Intermediate) -> Self {
        match intermediate {
            Intermediate::Vdi(vdi) => Self::Vdi(Box::new(PreparedVdi::new(Arc::from(vdi)))),
            Intermediate::Volume(volume) => Self::Volume(Box::new(Field::of_reduced(*volume))),
        }
    }

    /// The camera of the scene it was made for.
    pub fn camera(&self) -> &Camera {
        match self {
            Self::Vdi(vdi) => &vdi.vdi().header().camera,
            Self::Volume(field) => &field.scene().camera,
        }
    }

    /// The same volume, looking as asked for.
    ///
    /// # Errors
    /// If it is a VDI, which holds colors instead of values, or as [`Appearance::applied_to`].
    pub fn with_appearance(&self, appearance: &Appearance) -> Result<Self, Invalid> {
        let Self::Volume(field) = self else {
            let reason = "a VDI holds colors, not values; they can be chosen anew where a step is a volume";
            return Err(Invalid::new("appearance", reason));
        };
        Ok(Self::Volume(Box::new(field.with_scene(appearance.applied_to(field.scene())?)?)))
    }

    /// Points a side and values of a reduced volume, positions in the range; `None` for a VDI.
    pub fn units(&self) -> Option<([usize; 3], &[f32])> {
        match self {
            Self::Volume(field) => field.units().map(|units| (field.grid().dims(), units)),
            Self::Vdi(_) => None,
        }
    }

    /// The transfer function of a volume; `None` for a VDI.
    pub fn transfer(&self) -> Option<&TransferFunction> {
        match self {
            Self::Vdi(_) => None,
            Self::Volume(field) => Some(&field.scene().transfer),
        }
    }

    /// The VDI, if it is one.
    pub fn vdi(&self) -> Option<&Arc<Vdi>> {
        match self {
            Self::Vdi(vdi) => Some(vdi.vdi()),
            Self::Volume(_) => None,
        }
    }

    /// Depth along the view of `camera` (world units) at which half of the light from behind is gone, of each pixel of a picture, row by row;
    /// infinite where more comes through. By the oracle: slower than a picture.
    ///
    /// # Errors
    /// If the picture's size is out of bounds.
    pub fn half_depths(&self, camera: &Camera, width: u32, height: u32) -> Result<Vec<f32>, Invalid> {
        match self {
            Self::Vdi(vdi) => reference::half_depths(vdi.vdi(), camera, width, height),
            Self::Volume(field) => lamina_raycast::reference::half_depths(field, camera, width, height),
        }
    }

    /// Approximate bytes in memory.
    pub fn size_bytes(&self) -> usize {
        match self {
            Self::Vdi(vdi) => size_of_val(vdi.vdi().offsets()) + size_of_val(vdi.vdi().segments()) + vdi.size_bytes(),
            Self::Volume(field) => field.grid().voxels() * size_of::<f32>(),
        }
    }
}
