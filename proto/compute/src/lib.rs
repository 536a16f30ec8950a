//! Hardware layer of the kernels: SIMD types, GPU access, and admission of heavy work to a share of the processor.
//!
//! - [`simd`]: vectors of eight lanes; the intrinsics, and most of the workspace's unsafe code, are here.
//! - [`gpu`]: the only place that opens a device; [`kernel`]: what a kernel reads, for devices opened elsewhere.
//! - `cpu`: all heavy work of a node (ray casting, coding, rendering, measuring) asks its [`CpuShare`] for a [`Permit`], which a
//!   token bucket and a priority queue grant, and runs on the node's own threads. The simulation owns the cores.
//!
//! This crate knows no voxels, no pictures and no messages.

#[cfg(not(target_arch = "wasm32"))]
mod cpu;
pub mod gpu;
pub mod kernel;
pub mod simd;

#[cfg(not(target_arch = "wasm32"))]
pub use cpu::{
    Activity, CpuLimit, CpuShare, InvalidCpuLimit, Laps, Permit, Priority, Usage, UsageCounter, thread_cpu_time,
};
