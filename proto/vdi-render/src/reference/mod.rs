//! I in plain f64, one ray at a time and nothing prepared: the oracle that [`super::simd`] is tested against.

mod frustum;
mod render;

pub use render::{displaced_pixels, render, render_pixels};
