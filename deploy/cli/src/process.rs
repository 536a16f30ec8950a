//! What this process has used so far, as the system counts it.

use anyhow::Context;
use std::time::Duration;

/// Processor time of all threads, those that have ended too; `None` where the system does not tell.
pub fn cpu_time() -> Option<Duration> {
    #[cfg(unix)]
    {
        let used = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
        Some(Duration::new(used.tv_sec.try_into().ok()?, used.tv_nsec.try_into().ok()?))
    }
    #[cfg(not(unix))]
    None
}

/// Processor time from here on.
#[derive(Debug)]
pub struct ProcessorTime(Option<Duration>);

impl ProcessorTime {
    /// Begins to count.
    pub fn now() -> Self {
        Self(cpu_time())
    }

    /// What was used since, seconds; `None` where the system does not tell.
    pub fn secs(&self) -> Option<f64> {
        cpu_time().zip(self.0).map(|(now, before)| now.saturating_sub(before).as_secs_f64())
    }
}

/// Memory in use now, and the most since the process began or [`forget_peak`] was called; bytes.
pub fn memory() -> anyhow::Result<(u64, u64)> {
    let status = std::fs::read_to_string("/proc/self/status").context("memory is measured under Linux only")?;
    let kib = |key: &str| {
        let line = status.lines().find_map(|l| l.strip_prefix(key));
        let number = line.and_then(|l| l.trim().trim_end_matches(" kB").parse::<u64>().ok());
        number.with_context(|| format!("/proc/self/status does not tell {key}"))
    };
    Ok((1024 * kib("VmRSS:")?, 1024 * kib("VmHWM:")?))
}

/// Makes what is in use now the peak.
pub fn forget_peak() -> anyhow::Result<()> {
    std::fs::write("/proc/self/clear_refs", "5").context("the peak of memory cannot be reset on this system")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(target_os = "linux")]
    fn time_and_memory_that_were_used_are_counted() {
        let before = (cpu_time().unwrap(), memory().unwrap().0);
        let block = vec![1_u8; 64 << 20];
        assert!(std::hint::black_box(block.iter().map(|&b| u64::from(b)).sum::<u64>()) > 0);
        drop(block);
        assert!(cpu_time().unwrap() > before.0);
        assert!(memory().unwrap().1 >= before.1 + (60 << 20));
    }
}
