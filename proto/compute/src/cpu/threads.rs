//! Thread pools for a node's kernels, at a lower scheduling priority than the simulation's, and measurement of their time.

use super::usage::Activity;
use rayon::{ThreadPool, ThreadPoolBuildError, ThreadPoolBuilder};
use rustix::time::{ClockId, clock_gettime};
use std::time::Duration;
use thread_priority::{
    NormalThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

/// Scheduling of kernel threads relative to other processes' threads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scheduling {
    /// The system's default.
    Normal,
    /// SCHED_BATCH at nice 5: a thread of nice 0 gets three times the time of one of these on the same core.
    Background,
}

/// The [`ThreadPriorityValue`] of nice 5; its values 0 to 99 stand for nice 19 to -20.
const NICE_5: u8 = 35;

/// A pool of `threads` threads.
///
/// # Errors
/// If the system refuses threads.
pub(super) fn pool(
    threads: usize,
    scheduling: Scheduling,
    name: &'static str,
) -> Result<ThreadPool, ThreadPoolBuildError> {
    let lower = move |_| {
        if scheduling == Scheduling::Background
            && let Ok(nice_5) = ThreadPriorityValue::try_from(NICE_5)
        {
            let batch = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Batch);
            // Where the system refuses, the token bucket alone keeps the share.
            let _ = set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(nice_5), batch);
        }
    };
    let builder = ThreadPoolBuilder::new().num_threads(threads).thread_name(move |n| format!("{name}-{n}"));
    builder.start_handler(lower).build()
}

/// Processor time of the calling thread since it began.
pub fn thread_cpu_time() -> Duration {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    Duration::new(time.tv_sec.max(0) as u64, time.tv_nsec.max(0) as u32)
}

/// Divides the processor time of a piece of work among activities. Used on a thread of the pool that does the work.
#[derive(Debug)]
pub struct Laps {
    last: Duration,
    spent: Vec<(Activity, Duration)>,
}

impl Laps {
    /// Starts measuring; to be called on a thread of the pool.
    pub(crate) fn start() -> Self {
        Self { last: pool_cpu_time(), spent: Vec::new() }
    }

    /// Attributes the processor time of the pool's threads since the last lap to `activity`.
    pub fn lap(&mut self, activity: Activity) {
        let now = pool_cpu_time();
        self.spent.push((activity, now.saturating_sub(self.last)));
        self.last = now;
    }

    pub(crate) fn spent(self) -> Vec<(Activity, Duration)> {
        self.spent
    }
}

/// Processor time of all threads of the current pool.
fn pool_cpu_time() -> Duration {
    if rayon::current_num_threads() == 1 {
        return thread_cpu_time();
    }
    rayon::broadcast(|_| thread_cpu_time()).into_iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayon::prelude::*;

    #[test]
    fn background_threads_are_nicer_than_normal_ones() {
        let nice = |scheduling| {
            let pool = pool(2, scheduling, "test").unwrap();
            // Priorities are a thread's own on Linux.
            pool.broadcast(|_| rustix::process::getpriority_process(None).unwrap())
        };
        let normal = nice(Scheduling::Normal)[0];
        assert_eq!(nice(Scheduling::Background), [normal + 5; 2]);
    }

    #[test]
    fn laps_add_up_to_the_time_of_all_threads() {
        let pool = pool(2, Scheduling::Normal, "test").unwrap();
        let spin = || {
            (0..2).into_par_iter().for_each(|_| {
                let begun = thread_cpu_time();
                while thread_cpu_time() - begun < Duration::from_millis(20) {}
            });
        };
        let spent = pool.install(|| {
            let mut laps = Laps::start();
            spin();
            laps.lap(Activity::Generate);
            spin();
            laps.lap(Activity::Encode);
            laps.spent()
        });
        assert_eq!(spent.iter().map(|(a, _)| *a).collect::<Vec<_>>(), [Activity::Generate, Activity::Encode]);
        assert!(spent.iter().all(|(_, time)| *time >= Duration::from_millis(40)), "{spent:?}");
    }
}
