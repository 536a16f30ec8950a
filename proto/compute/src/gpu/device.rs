//! An open GPU. Every failure inside [`Gpu::run`] is returned as an error; a lost device stays lost.

use super::adapter::{adapters, facts, may_have_gpu};
use super::{AdapterFacts, Choice, DeviceError};
use parking_lot::Mutex;
use std::mem::ManuallyDrop;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use wgpu::{Buffer, BufferDescriptor, BufferUsages, Device, Error, ErrorFilter, Limits, Queue};

/// An open GPU.
#[derive(Debug)]
pub struct Gpu {
    facts: AdapterFacts,
    // Dropped by `drop` alone.
    device: ManuallyDrop<Device>,
    queue: ManuallyDrop<Queue>,
    limits: Limits,
    /// Why the device was lost; `None` while it works.
    lost: Arc<Mutex<Option<String>>>,
}

/// Held while a device is opened or closed. Where four threads do so at once, NVIDIA's driver 580.159 hangs in a quarter of all tries.
static OPENING: Mutex<()> = Mutex::new(());

impl Drop for Gpu {
    #[expect(unsafe_code, reason = "both are dropped here, once, and never used again")]
    fn drop(&mut self) {
        let _opening = OPENING.lock();
        // SAFETY: nothing reads the fields after this.
        unsafe {
            ManuallyDrop::drop(&mut self.queue);
            ManuallyDrop::drop(&mut self.device);
        }
    }
}

/// The outcome of [`Gpu::open`].
#[derive(Debug)]
pub enum Opened {
    /// A GPU.
    Gpu(Box<Gpu>),
    /// The processor, with the reason for the log.
    Cpu(String),
}

impl Gpu {
    /// Opens the best GPU that `choice` allows.
    ///
    /// # Errors
    /// If [`Choice::Gpu`] asks for one and none opens.
    pub fn open(choice: Choice) -> Result<Opened, DeviceError> {
        if choice == Choice::Cpu {
            return Ok(Opened::Cpu("asked for".to_owned()));
        }
        if choice == Choice::Auto && !may_have_gpu() {
            return Ok(Opened::Cpu("this machine has no GPU".to_owned()));
        }
        let _opening = OPENING.lock();
        let mut failure = None;
        for adapter in adapters() {
            let facts = facts(&adapter);
            if choice == Choice::Auto && facts.software {
                let slow = || format!("{} is a GPU in software, which gains nothing", facts.name);
                return Ok(Opened::Cpu(failure.map_or_else(slow, |e: DeviceError| e.to_string())));
            }
            match Self::of(&adapter, facts) {
                Ok(gpu) => return Ok(Opened::Gpu(Box::new(gpu))),
                // Report the failure of the best adapter.
                Err(e) => failure = failure.or(Some(e)),
            }
        }
        let none = || DeviceError::NoAdapter("this machine has no Vulkan loader or no device".to_owned());
        let failure = failure.unwrap_or_else(none);
        if choice == Choice::Auto { Ok(Opened::Cpu(failure.to_string())) } else { Err(failure) }
    }

    fn of(adapter: &wgpu::Adapter, facts: AdapterFacts) -> Result<Self, DeviceError> {
        // The default limits are those of browsers; volumes need the adapter's full limits.
        let limits = adapter.limits();
        let descriptor =
            wgpu::DeviceDescriptor { label: Some("lamina"), required_limits: limits.clone(), ..Default::default() };
        let opened = pollster::block_on(adapter.request_device(&descriptor));
        let refused =
            |e: wgpu::RequestDeviceError| DeviceError::Refused { adapter: facts.name.clone(), reason: e.to_string() };
        let (device, queue) = opened.map_err(refused)?;
        let lost = Arc::new(Mutex::new(None));
        let (on_loss, on_fault) = (lost.clone(), lost.clone());
        device.set_device_lost_callback(move |_, reason| set(&on_loss, reason));
        // No caller sees errors outside of any scope, so results of this device cannot be trusted afterwards.
        device.on_uncaptured_error(Arc::new(move |e: Error| set(&on_fault, e.to_string())));
        Ok(Self { facts, device: ManuallyDrop::new(device), queue: ManuallyDrop::new(queue), limits, lost })
    }

    /// The driver's description of the device.
    pub fn facts(&self) -> &AdapterFacts {
        &self.facts
    }
    /// The device, for making resources inside [`Self::run`].
    pub fn device(&self) -> &Device {
        &self.device
    }
    /// Its queue, for use inside [`Self::run`].
    pub fn queue(&self) -> &Queue {
        &self.queue
    }
    /// Its limits, which are the adapter's.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// The most bytes of one storage binding.
    pub fn max_binding_bytes(&self) -> u64 {
        self.limits.max_storage_buffer_binding_size.min(self.limits.max_buffer_size)
    }

    /// Runs `work` and returns its result, or the device's error if one occurred meanwhile. `doing` names the work in errors.
    ///
    /// # Errors
    /// If the device is lost, out of memory or refuses a command, or `work` fails.
    pub fn run<T, E: From<DeviceError>>(&self, doing: &str, work: impl FnOnce() -> Result<T, E>) -> Result<T, E> {
        self.check()?;
        let filters = [ErrorFilter::OutOfMemory, ErrorFilter::Validation, ErrorFilter::Internal];
        let scopes = filters.map(|f| self.device.push_error_scope(f));
        // wgpu panics if a device is lost during a call that cannot return an error, such as a wait.
        let outcome = catch_unwind(AssertUnwindSafe(work));
        // Scopes close in the reverse order of opening.
        let caught = scopes.into_iter().rev().filter_map(|s| pollster::block_on(s.pop())).last();
        let outcome = outcome.map_err(|panic| {
            let text = panic.downcast_ref::<String>().cloned();
            let text = text.or_else(|| panic.downcast_ref::<&str>().map(|&s| s.to_owned()));
            set(&self.lost, text.unwrap_or_else(|| "its driver failed".to_owned()));
        });
        // Report a loss rather than the failures that follow from it.
        self.check()?;
        match (caught, outcome) {
            (Some(Error::OutOfMemory { .. }), _) => Err(DeviceError::OutOfMemory(doing.to_owned()).into()),
            (Some(e), _) => Err(DeviceError::Fault { doing: doing.to_owned(), reason: e.to_string() }.into()),
            (None, Ok(result)) => result,
            (None, Err(())) => Err(DeviceError::Lost("its driver failed".to_owned()).into()),
        }
    }

    /// Succeeds until the device is lost.
    ///
    /// # Errors
    /// If it was lost.
    pub fn check(&self) -> Result<(), DeviceError> {
        match &*self.lost.lock() {
            Some(reason) => Err(DeviceError::Lost(reason.clone())),
            None => Ok(()),
        }
    }

    /// A buffer of `size` bytes, all zero.
    pub fn buffer(&self, label: &str, size: u64, usage: BufferUsages) -> Buffer {
        self.device.create_buffer(&BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
    }

    /// A buffer that holds `bytes`, whose number is a multiple of 4.
    pub fn upload(&self, label: &str, bytes: &[u8], usage: BufferUsages) -> Buffer {
        let buffer = self.buffer(label, bytes.len() as u64, usage | BufferUsages::COPY_DST);
        self.queue.write_buffer(&buffer, 0, bytes);
        buffer
    }

    /// Workgroup counts along x and y that cover `items`, `per_group` in each, within the limit of one dimension. The index
    /// of group (x, y) is y * (groups along x) + x.
    pub fn groups(&self, items: u64, per_group: u32) -> [u32; 2] {
        let groups = items.div_ceil(per_group.into()).max(1);
        let x = groups.min(self.limits.max_compute_workgroups_per_dimension.into());
        [x as u32, groups.div_ceil(x) as u32]
    }
}

/// Records `reason` unless an earlier one is recorded, from which it follows.
fn set(lost: &Mutex<Option<String>>, reason: String) {
    lost.lock().get_or_insert(reason);
}

#[cfg(test)]
mod tests {
    use super::*;

    use crate::gpu::testing::gpu as open;

    #[test]
    fn software_is_no_gpu_unless_asked_for() {
        assert!(matches!(Gpu::open(Choice::Cpu), Ok(Opened::Cpu(_))));
        match Gpu::open(Choice::Auto) {
            Ok(Opened::Gpu(gpu)) => assert!(!gpu.facts().software),
            Ok(Opened::Cpu(reason)) => assert!(!reason.is_empty()),
            Err(e) => panic!("auto never fails: {e}"),
        }
    }

    #[test]
    fn an_impossible_buffer_is_an_error_and_the_device_lives_on() {
        let Some(gpu) = open() else { return };
        let size = gpu.limits().max_buffer_size + 4;
        let make = || Ok::<_, DeviceError>(gpu.buffer("too large", size, BufferUsages::STORAGE));
        let e = gpu.run("a buffer", make).unwrap_err();
        assert!(matches!(e, DeviceError::Fault { .. } | DeviceError::OutOfMemory(_)), "{e}");
        gpu.run("a smaller one", || Ok::<_, DeviceError>(gpu.buffer("small", 16, BufferUsages::STORAGE))).unwrap();
    }

    #[test]
    fn a_driver_that_panics_is_lost() {
        let Some(gpu) = open() else { return };
        let panics = || -> Result<(), DeviceError> { panic!("{} is gone", "the device") };
        let lost = DeviceError::Lost("the device is gone".to_owned());
        assert_eq!(gpu.run("anything", panics), Err(lost.clone()));
        assert_eq!(gpu.run("anything", || Ok(())), Err(lost));
    }

    #[test]
    fn groups_cover_all_items_within_the_limit() {
        let Some(gpu) = open() else { return };
        let most = gpu.limits().max_compute_workgroups_per_dimension;
        assert_eq!(gpu.groups(0, 64), [1, 1]);
        assert_eq!(gpu.groups(65, 64), [2, 1]);
        let [x, y] = gpu.groups(u64::from(most) * 64 + 1, 64);
        assert!(x == most && y == 2);
    }
}
