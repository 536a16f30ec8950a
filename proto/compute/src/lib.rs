//! Processor time of a node: how much of it heavy work may use, in which order, and on which threads.
//!
//! The simulation owns the cores. All heavy work of a node (ray casting, coding, drawing, measuring) asks its [`CpuShare`] for a
//! [`Permit`], which a token bucket and a priority queue grant, and runs on threads of the node's own. This crate knows no
//! voxels, no pictures and no messages.

mod cpu_limit;
mod cpu_share;
mod queue;
mod threads;
mod token_bucket;
mod usage;

pub use cpu_limit::{CpuLimit, InvalidCpuLimit};
pub use cpu_share::{CpuShare, Permit};
pub use queue::Priority;
pub use threads::{Laps, thread_cpu_time};
pub use usage::{Activity, Usage};
