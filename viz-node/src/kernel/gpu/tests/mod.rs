//! The parts of the GPU level, each against Rust; whole pictures are compared in viz-node/tests/gpu.rs.

mod layout;
mod leaf;
