//! I: pure functions from a VDI and a camera to colours.

mod frustum;
mod quality;
mod render;

pub use quality::quality;
pub use render::{render, render_pixels};
