//! R and the reference: pure functions from a scalar field under a scene to a VDI or to colours.
//!
//! One algorithm at three levels: [`scalar`] is the oracle, `lanes` runs eight rays at a time on the CPU, `gpu` is its
//! twin in WGSL. [`Backend`] is what the rest of the node calls.

mod backend;
mod field;
pub mod gpu;
pub mod lanes;
mod rows;
pub mod scalar;
mod skip;
mod table;

pub use backend::Backend;
pub use field::Field;
