//! The thread that drives the connection while the simulation computes.

#[cfg(unix)]
use nix::sys::signal::{SigSet, SigmaskHow};
use std::future::Future;
use std::io;
use std::time::Duration;
use tokio::runtime::{Builder, Runtime};
use tokio::sync::oneshot;
use tokio::task::AbortHandle;
use tonic::Status;

/// A runtime that is a guest in the simulation's process: its threads take none of the process's signals (a write to a node
/// that has gone would end a program that leaves SIGPIPE alone, as those in C do), and nobody waits for them at the end.
#[derive(Debug)]
pub(crate) struct Driver(Option<Runtime>);

impl Driver {
    /// One thread: it answers the node's pings while the simulation computes, and sleeps otherwise.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub(crate) fn start() -> io::Result<Self> {
        let mut builder = Builder::new_multi_thread();
        builder.worker_threads(1).thread_name("lamina-client").enable_all();
        // A thread begins with its maker's mask, and the first one makes all others.
        #[cfg(unix)]
        let before = SigSet::all().thread_swap_mask(SigmaskHow::SIG_SETMASK)?;
        let built = builder.build();
        #[cfg(unix)]
        before.thread_set_mask()?;
        Ok(Self(Some(built?)))
    }

    /// The answer of `call`, which the calling thread works on and which sends nothing itself.
    pub(crate) fn within<T>(
        &self,
        deadline: Duration,
        call: impl Future<Output = Result<T, Status>>,
    ) -> Result<T, Status> {
        let Some(runtime) = &self.0 else { return Err(Status::unavailable("closed")) };
        let late = |_| Err(Status::deadline_exceeded("no answer in time"));
        runtime.block_on(async { tokio::time::timeout(deadline, call).await }).unwrap_or_else(late)
    }

    /// Lets the driver's own thread work on `task` meanwhile; `None` if it has ended.
    pub(crate) fn spawn(&self, task: impl Future<Output = ()> + Send + 'static) -> Option<AbortHandle> {
        self.0.as_ref().map(|runtime| runtime.spawn(task).abort_handle())
    }

    /// Begins `call` on the driver's own thread, to be given up after the deadline; its answer comes out.
    pub(crate) fn begin<T: Send + 'static>(
        &self,
        deadline: Duration,
        call: impl Future<Output = Result<T, Status>> + Send + 'static,
    ) -> oneshot::Receiver<Result<T, Status>> {
        let (sender, answer) = oneshot::channel();
        self.spawn(async move {
            let late = |_| Err(Status::deadline_exceeded("no answer in time"));
            let _ = sender.send(tokio::time::timeout(deadline, call).await.unwrap_or_else(late));
        });
        answer
    }

    /// The same of one that the driver's own thread works on: it may send.
    pub(crate) fn away<T: Send + 'static>(
        &self,
        deadline: Duration,
        call: impl Future<Output = Result<T, Status>> + Send + 'static,
    ) -> Result<T, Status> {
        let Some(runtime) = &self.0 else { return Err(Status::unavailable("closed")) };
        let call = runtime.spawn(call);
        self.within(deadline, async { call.await.unwrap_or_else(|e| Err(Status::internal(e.to_string()))) })
    }
}

impl Drop for Driver {
    fn drop(&mut self) {
        // A name that is being looked up is not waited for.
        if let Some(runtime) = self.0.take() {
            runtime.shutdown_background();
        }
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use nix::sys::signal::Signal;

    #[test]
    fn its_threads_take_no_signal_and_the_callers_mask_stays() {
        let before = SigSet::thread_get_mask().unwrap();
        let driver = Driver::start().unwrap();
        let masks = driver.away(Duration::from_secs(60), async {
            let worker = SigSet::thread_get_mask();
            // Names are looked up on threads of their own.
            Ok([worker, tokio::task::spawn_blocking(SigSet::thread_get_mask).await.unwrap()])
        });
        for mask in masks.unwrap() {
            let mask = mask.unwrap();
            assert!(mask.contains(Signal::SIGPIPE) && mask.contains(Signal::SIGUSR1) && mask.contains(Signal::SIGTERM));
        }
        assert_eq!(SigSet::thread_get_mask().unwrap(), before);
    }

    #[test]
    fn what_takes_too_long_is_neither_waited_for_nor_at_the_end() {
        let begun = std::time::Instant::now();
        let driver = Driver::start().unwrap();
        let stuck = driver.away(Duration::from_millis(50), async {
            let asleep = || std::thread::sleep(Duration::from_secs(30));
            tokio::task::spawn_blocking(asleep).await.map_err(|e| Status::internal(e.to_string()))
        });
        assert_eq!(stuck.unwrap_err().code(), tonic::Code::DeadlineExceeded);
        drop(driver);
        assert!(begun.elapsed() < Duration::from_secs(20));
    }
}
