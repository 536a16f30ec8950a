//! The oracle: ray casting and generation one ray and one sample at a time, in double precision, with the transfer
//! function itself. Slow and plain; the fast levels are compared with it.

mod effects;
mod generate;
mod march;
mod raycast;

pub use generate::generate;
pub use raycast::{raycast, raycast_pixels};
