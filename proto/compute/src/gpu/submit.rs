//! Submission of a compute pass, with copies of its results to the host.

use super::{DeviceError, Gpu};
use parking_lot::Mutex;
use std::ops::Range;
use std::sync::Arc;
use wgpu::{
    Buffer, BufferUsages, BufferView, CommandEncoderDescriptor, ComputePass, ComputePassDescriptor, MapMode, PollType,
};

impl Gpu {
    /// Runs the pass that `record` records, copies parts of buffers (offsets and lengths multiples of 4, none empty) to the
    /// host, waits for both and returns the copies in the order requested. To be called inside [`Gpu::run`].
    ///
    /// # Errors
    /// If a copy cannot be read.
    pub fn submit(
        &self,
        label: &str,
        record: impl FnOnce(&mut ComputePass<'_>),
        copies: &[(&Buffer, Range<u64>)],
    ) -> Result<Vec<BufferView>, DeviceError> {
        let mut encoder = self.device().create_command_encoder(&CommandEncoderDescriptor { label: Some(label) });
        record(&mut encoder.begin_compute_pass(&ComputePassDescriptor { label: Some(label), timestamp_writes: None }));
        let staged = copies.iter().map(|(source, range)| {
            let size = range.end - range.start;
            let staged = self.buffer("staged", size, BufferUsages::MAP_READ | BufferUsages::COPY_DST);
            encoder.copy_buffer_to_buffer(source, range.start, &staged, 0, size);
            staged
        });
        let staged: Vec<Buffer> = staged.collect();
        self.queue().submit([encoder.finish()]);
        self.read(label, &staged)
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
