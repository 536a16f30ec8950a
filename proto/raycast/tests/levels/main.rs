//! The fast levels of the kernels against the oracle in `reference`, on one field of every kind.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod agreement;
mod effects;
mod fields;
mod gpu;
mod lanes;
mod parts;
