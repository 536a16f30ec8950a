//! The only crate that opens a GPU device. So far it tells which one there is.

/// A GPU as its driver describes it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AdapterFacts {
    /// The device's name.
    pub name: String,
    /// `IntegratedGpu`, `DiscreteGpu`, `Cpu` (a software device), ...
    pub kind: String,
    /// The driver and its version.
    pub driver: String,
}

/// The adapter that would be used; `None` if the machine has no Vulkan loader or no device.
pub fn adapter() -> Option<AdapterFacts> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let options =
        wgpu::RequestAdapterOptions { power_preference: wgpu::PowerPreference::HighPerformance, ..Default::default() };
    let info = pollster::block_on(instance.request_adapter(&options)).ok()?.get_info();
    let driver = format!("{} {}", info.driver, info.driver_info);
    Some(AdapterFacts { name: info.name, kind: format!("{:?}", info.device_type), driver: driver.trim().to_owned() })
}
