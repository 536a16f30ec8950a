//! Enumeration of GPUs through Vulkan, best first.

use super::AdapterFacts;
use std::sync::LazyLock;
use wgpu::{Adapter, Backends, DeviceType, Instance, InstanceDescriptor};

/// The only one of the process.
static INSTANCE: LazyLock<Instance> = LazyLock::new(|| {
    Instance::new(InstanceDescriptor { backends: Backends::VULKAN, ..InstanceDescriptor::new_without_display_handle() })
});

/// The best adapter; `None` if the machine has no Vulkan loader or no device.
pub fn adapter() -> Option<AdapterFacts> {
    adapters().first().map(facts)
}

/// False if the system has no device node that a GPU driver could open. A cheap check: loading drivers takes time, and
/// software ones print messages.
pub(crate) fn may_have_gpu() -> bool {
    const DEVICES: [&str; 4] = ["/dev/dri", "/dev/nvidiactl", "/dev/dxg", "/dev/mali0"];
    !cfg!(target_os = "linux") || DEVICES.iter().any(|device| std::path::Path::new(device).exists())
}

/// All adapters, best first: discrete, integrated, virtual, other, software.
pub(crate) fn adapters() -> Vec<Adapter> {
    let mut adapters = pollster::block_on(INSTANCE.enumerate_adapters(Backends::VULKAN));
    adapters.sort_by_key(|a| match a.get_info().device_type {
        DeviceType::DiscreteGpu => 0,
        DeviceType::IntegratedGpu => 1,
        DeviceType::VirtualGpu => 2,
        DeviceType::Other => 3,
        DeviceType::Cpu => 4,
    });
    adapters
}

pub(crate) fn facts(adapter: &Adapter) -> AdapterFacts {
    let info = adapter.get_info();
    AdapterFacts {
        name: info.name,
        kind: format!("{:?}", info.device_type),
        driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
        software: info.device_type == DeviceType::Cpu,
    }
}
