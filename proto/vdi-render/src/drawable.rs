//! A time step in either representation, prepared for rendering.

use super::PreparedVdi;
use lamina_model::{Camera, ControlPoint, Intermediate, Invalid, TransferFunction, Vdi};
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

    /// The same volume under other control points, made transparent where the scene's are: there values were not recorded.
    ///
    /// # Errors
    /// If it is a VDI, which holds colors instead of values, or the points are invalid.
    pub fn with_points(&self, points: Vec<ControlPoint>) -> Result<Self, Invalid> {
        let Self::Volume(field) = self else {
            let reason = "a VDI holds colors, not values; they can be chosen anew where a step is a volume";
            return Err(Invalid::new("points", reason));
        };
        let recorded = &field.scene().transfer;
        let wished = TransferFunction::new(*recorded.range(), recorded.stated_unit_length(), points)?;
        Ok(Self::Volume(Box::new(field.with_transfer(wished.where_shown_by(recorded)?)?)))
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

    /// Approximate bytes in memory.
    pub fn size_bytes(&self) -> usize {
        match self {
            Self::Vdi(vdi) => size_of_val(vdi.vdi().offsets()) + size_of_val(vdi.vdi().segments()) + vdi.size_bytes(),
            Self::Volume(field) => field.grid().voxels() * size_of::<f32>(),
        }
    }
}
