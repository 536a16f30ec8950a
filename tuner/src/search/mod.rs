//! Which parameters are tried.

mod aimed;
mod gauss;
mod grid;
mod models;
mod promise;
mod racing;
mod range;
#[cfg(test)]
mod tests;
mod timed;
mod timings;

pub use aimed::search_with_margin;
pub use gauss::{Process, place};
pub use grid::{Axis, Grid};
pub use models::Price;
pub use racing::{Found, search};
pub use range::candidates;
