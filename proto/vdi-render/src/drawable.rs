//! Whatever stands for a step, ready to be drawn.

use super::PreparedVdi;
use lamina_model::{Camera, ControlPoint, Intermediate, Invalid, TransferFunction, Vdi};
use lamina_raycast::Field;
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

    /// The same under other control points, which show nothing where the scene's show nothing: what was not recorded.
    ///
    /// # Errors
    /// If it is a VDI, whose colours are its data, or the points are none.
    pub fn with_points(&self, points: Vec<ControlPoint>) -> Result<Self, Invalid> {
        let Self::Volume(field) = self else {
            let reason = "a VDI holds colours, not values; they can be chosen anew where a step is a volume";
            return Err(Invalid::new("points", reason));
        };
        let recorded = &field.scene().transfer;
        let wished = TransferFunction::new(*recorded.range(), recorded.stated_unit_length(), points)?;
        Ok(Self::Volume(Box::new(field.with_transfer(wished.where_shown_by(recorded)?)?)))
    }

    /// What a volume is seen under.
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

    /// Bytes held, nearly.
    pub fn size_bytes(&self) -> usize {
        match self {
            Self::Vdi(vdi) => size_of_val(vdi.vdi().offsets()) + size_of_val(vdi.vdi().segments()) + vdi.size_bytes(),
            Self::Volume(field) => field.grid().voxels() * size_of::<f32>(),
        }
    }
}
