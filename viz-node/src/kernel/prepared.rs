//! Whatever stands for a step, ready to be drawn.

use super::PreparedVdi;
use lamina_cast::Field;
use lamina_model::{Camera, Intermediate, Vdi};
use std::sync::Arc;

/// A VDI or a reduced volume with what drawing it again and again needs.
pub enum Prepared {
    /// Drawn by the walk through its lists.
    Vdi(Box<PreparedVdi>),
    /// Ray-cast as the volume itself would be.
    Volume(Box<Field>),
}

impl Prepared {
    /// Prepares what was decoded.
    pub fn new(intermediate: Intermediate) -> Self {
        match intermediate {
            Intermediate::Vdi(vdi) => Self::Vdi(Box::new(PreparedVdi::new(Arc::from(vdi)))),
            Intermediate::Volume(volume) => Self::Volume(Box::new(Field::of_reduced(*volume))),
        }
    }

    /// The camera it was made for.
    pub fn camera(&self) -> &Camera {
        match self {
            Self::Vdi(vdi) => &vdi.vdi().header().camera,
            Self::Volume(field) => &field.scene().camera,
        }
    }

    /// The VDI, if it is one.
    pub fn vdi(&self) -> Option<&Arc<Vdi>> {
        match self {
            Self::Vdi(vdi) => Some(vdi.vdi()),
            Self::Volume(_) => None,
        }
    }

    /// Bytes held, nearly.
    pub fn size_bytes(&self) -> usize {
        match self {
            Self::Vdi(vdi) => size_of_val(vdi.vdi().offsets()) + size_of_val(vdi.vdi().segments()) + vdi.size_bytes(),
            Self::Volume(field) => field.grid().voxels() * size_of::<f32>(),
        }
    }
}
