//! Processor time of a node: how much of it heavy work may use, in which order, and on which threads.

mod limit;
mod queue;
mod share;
mod threads;
mod token_bucket;
mod usage;

pub use limit::{CpuLimit, InvalidCpuLimit};
pub use queue::Priority;
pub use share::{CpuShare, Permit};
pub use threads::{Laps, thread_cpu_time};
pub use usage::{Activity, Usage};
