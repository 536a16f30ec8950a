//! R and the reference: pure functions from a scalar field and a scene to a VDI or to colours.

mod field;
mod generate;
mod march;
mod raycast;

pub use field::Field;
pub use generate::generate;
pub use raycast::{raycast, raycast_pixels, reference_samples};
