//! The oracle: VDI rendering ray by ray in double precision, without any acceleration structure.

mod frustum;
mod render;

pub use render::{cubic_pixels, displaced_pixels, half_depths, render, render_pixels};
