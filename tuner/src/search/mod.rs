//! Which parameters are tried.

mod grid;

pub use grid::{Axis, Grid};
