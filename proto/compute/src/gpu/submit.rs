//! Submission of a compute pass, with its duration and copies of its results to the host.

use super::{DeviceError, Gpu};
use parking_lot::Mutex;
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};
use wgpu::{
    Buffer, BufferUsages, BufferView, CommandEncoderDescriptor, ComputePass, ComputePassDescriptor,
    ComputePassTimestampWrites, MapMode, PollType, QuerySet, QuerySetDescriptor, QueryType,
};

/// The result of a compute pass.
#[derive(Debug)]
pub struct PassResult {
    /// Duration of the pass by the device's timestamps, or from submission to completion if it has none.
    pub time: Duration,
    /// The copied ranges, in the order requested.
    pub copies: Vec<BufferView>,
}

/// Two timestamp queries, and the buffer they are resolved into.
struct PassTimer {
    queries: QuerySet,
    resolved: Buffer,
}

impl Gpu {
    /// Runs the pass that `record` records, copies parts of buffers (offsets and lengths multiples of 4, none empty) to the
    /// host, and waits for both. To be called inside [`Gpu::run`].
    ///
    /// # Errors
    /// If a copy cannot be read.
    pub fn submit(
        &self,
        label: &str,
        record: impl FnOnce(&mut ComputePass<'_>),
        copies: &[(&Buffer, Range<u64>)],
    ) -> Result<PassResult, DeviceError> {
        let timer = self.has_timestamps().then(|| self.timer());
        let mut encoder = self.device().create_command_encoder(&CommandEncoderDescriptor { label: Some(label) });
        let timestamp_writes = timer.as_ref().map(|t| ComputePassTimestampWrites {
            query_set: &t.queries,
            beginning_of_pass_write_index: Some(0),
            end_of_pass_write_index: Some(1),
        });
        record(&mut encoder.begin_compute_pass(&ComputePassDescriptor { label: Some(label), timestamp_writes }));
        let mut wanted: Vec<(&Buffer, Range<u64>)> = copies.to_vec();
        if let Some(t) = &timer {
            encoder.resolve_query_set(&t.queries, 0..2, &t.resolved, 0);
            wanted.push((&t.resolved, 0..16));
        }
        let staged = wanted.iter().map(|(source, range)| {
            let size = range.end - range.start;
            let staged = self.buffer("staged", size, BufferUsages::MAP_READ | BufferUsages::COPY_DST);
            encoder.copy_buffer_to_buffer(source, range.start, &staged, 0, size);
            staged
        });
        let staged: Vec<Buffer> = staged.collect();
        let start = Instant::now();
        self.queue().submit([encoder.finish()]);
        let mut copies = self.read(label, &staged)?;
        let wall = start.elapsed();
        let time = timer.and_then(|_| copies.pop()).and_then(|stamps| self.duration(&stamps)).unwrap_or(wall);
        Ok(PassResult { time, copies })
    }

    fn timer(&self) -> PassTimer {
        let descriptor = QuerySetDescriptor { label: Some("timer"), ty: QueryType::Timestamp, count: 2 };
        let usage = BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC;
        PassTimer { queries: self.device().create_query_set(&descriptor), resolved: self.buffer("timer", 16, usage) }
    }

    /// The time between two timestamps; `None` if they run backwards, as some drivers' do.
    fn duration(&self, stamps: &[u8]) -> Option<Duration> {
        let stamp = |n: usize| Some(u64::from_le_bytes(stamps.get(8 * n..8 * n + 8)?.try_into().ok()?));
        let ticks = stamp(1)?.checked_sub(stamp(0)?).filter(|&t| t > 0)?;
        Some(Duration::from_nanos((ticks as f64 * f64::from(self.queue().get_timestamp_period())) as u64))
    }

    /// Waits for all submitted work, then maps the staging buffers.
    fn read(&self, label: &str, staged: &[Buffer]) -> Result<Vec<BufferView>, DeviceError> {
        let failure = Arc::new(Mutex::new(None));
        for buffer in staged {
            let failure = failure.clone();
            buffer.map_async(MapMode::Read, .., move |outcome| {
                if let Err(e) = outcome {
                    *failure.lock() = Some(e.to_string());
                }
            });
        }
        let fault = |reason: String| DeviceError::Fault { doing: label.to_owned(), reason };
        self.device().poll(PollType::wait_indefinitely()).map_err(|e| fault(e.to_string()))?;
        if let Some(reason) = failure.lock().take() {
            return Err(fault(reason));
        }
        staged.iter().map(|b| b.slice(..).get_mapped_range().map_err(|e| fault(e.to_string()))).collect()
    }
}
