//! The oracle: ray casting and VDI generation ray by ray in double precision, with the transfer function itself. Simple and
//! slow; the fast levels are compared with it.

mod effects;
mod generate;
mod march;
mod raycast;

pub use generate::generate;
pub use raycast::{half_depths, raycast, raycast_layers, raycast_pixels};
