//! The parts of the GPU level, each against Rust; whole pictures are compared in tests/gpu.rs.

mod layout;
mod leaf;
