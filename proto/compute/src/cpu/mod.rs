//! Scheduling of a node's heavy work: its share of processor time, its order, and its threads.

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
pub use usage::{Activity, Usage, UsageCounter};
