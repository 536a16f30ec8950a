//! What the kernels run on: SIMD lanes, a GPU, and the share of the processor that a node's heavy work may use.
//!
//! - [`simd`]: eight single-precision numbers at a time; the only crate-level home of unsafe code.
//! - [`gpu`]: the only place that opens a device.
//! - `cpu`: all heavy work of a node (ray casting, coding, drawing, measuring) asks its [`CpuShare`] for a [`Permit`], which a token
//!   bucket and a priority queue grant, and runs on threads of the node's own. The simulation owns the cores.
//!
//! This crate knows no voxels, no pictures and no messages.

mod cpu;
pub mod gpu;
pub mod simd;

pub use cpu::{Activity, CpuLimit, CpuShare, InvalidCpuLimit, Laps, Permit, Priority, Usage, thread_cpu_time};
