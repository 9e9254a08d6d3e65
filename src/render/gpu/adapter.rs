//! Which adapter, and a device of it.

use std::path::Path;

use crate::render::error::{RenderError, Result};

/// What kind of adapter will do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AdapterPreference {
    /// A real GPU only.
    Hardware,
    /// Anything that runs compute shaders, software too.
    Any,
}

/// Device files that a GPU's driver makes on Linux. Where none is there, no
/// driver is loaded just to hear so.
const SIGNS: [&str; 4] = ["/dev/dri", "/dev/nvidia0", "/dev/dxg", "/dev/kfd"];

/// The best adapter of the kind wished for; `None` where there is none.
pub fn find(wish: AdapterPreference) -> Result<Option<wgpu::Adapter>> {
    if wish == AdapterPreference::Hardware && !SIGNS.iter().any(|sign| Path::new(sign).exists()) {
        return Ok(None);
    }
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::VULKAN));
    let rank = |adapter: &wgpu::Adapter| match adapter.get_info().device_type {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Cpu | wgpu::DeviceType::Other => 3,
    };
    let will_do = |adapter: &wgpu::Adapter| wish == AdapterPreference::Any || rank(adapter) < 3;
    Ok(adapters.into_iter().filter(will_do).min_by_key(rank))
}

/// A device with room for as much as the adapter has.
pub fn device(adapter: &wgpu::Adapter) -> Result<(wgpu::Device, wgpu::Queue)> {
    let offered = adapter.limits();
    let wanted = wgpu::Limits {
        max_storage_buffer_binding_size: offered.max_storage_buffer_binding_size,
        max_buffer_size: offered.max_buffer_size,
        ..wgpu::Limits::default()
    };
    let descriptor = wgpu::DeviceDescriptor {
        label: Some("lodestone"),
        required_limits: wanted,
        ..wgpu::DeviceDescriptor::default()
    };
    pollster::block_on(adapter.request_device(&descriptor))
        .map_err(|error| RenderError::Gpu(format!("{} refused: {error}", adapter.get_info().name)))
}
