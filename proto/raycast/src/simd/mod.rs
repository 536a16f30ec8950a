//! Ray casting and VDI generation on the processor, eight rays at a time, in the vector types of [`lamina_compute::simd`].

mod effects;
mod generate;
mod generate_all;
mod march;
mod own_cells;
mod raycast;
mod rays;
mod shaded_sample;
mod tile;

pub use generate::generate;
pub use generate_all::{MOST_GAMMAS, generate_all};
pub use lamina_compute::simd::Level;
pub use march::fits;
pub use raycast::{Shot, raycast, raycast_layers, raycast_pixels};
