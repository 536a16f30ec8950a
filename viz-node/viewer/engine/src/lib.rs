//! The part of the viewer that is Rust, compiled to WebAssembly: decodes a recorded step, prepares what the WGSL kernels read, and
//! draws on the processor where a browser has no WebGPU.
//!
//! `session` does the work; `exports` is its interface of plain numbers, which `src/engine.ts` calls.

mod camera;
pub mod exports;
mod message;
mod session;

pub use camera::Pose;
pub use message::{Entry, Kind, Message};
pub use session::{BINS, Description, Session};
