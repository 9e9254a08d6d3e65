//! The renderer for real GPUs: the compute shaders of `shaders/`, each the twin
//! of a kernel. Only this folder knows wgpu.
//!
//! A driver that is missing, a device that is lost and a shader that does not
//! fit are errors that come back as such; nothing here panics. Where the only
//! adapter is a software one, the CPU twin is the faster: it is taken on request
//! and by the tests only.

mod adapter;
mod buffers;
mod pipelines;

use std::sync::{Arc, Mutex};

use self::buffers::Buffers;
use self::pipelines::Pipelines;
use super::error::{RenderError, Result};
use super::frame::{Drawing, Picture};
use super::scene::Scene;

pub use adapter::AdapterPreference;
pub use pipelines::SHADERS;

/// A device with its shaders, and the buffers of the last scene and size.
pub struct Gpu {
    device: wgpu::Device,
    queue: wgpu::Queue,
    pipelines: Pipelines,
    buffers: Option<Buffers>,
    /// What went wrong since it was last asked.
    trouble: Arc<Mutex<Option<String>>>,
    name: String,
}

impl Gpu {
    /// Opens an adapter; `Ok(None)` where there is none of the kind wished for.
    pub fn open(wish: AdapterPreference) -> Result<Option<Gpu>> {
        adapter::find(wish)?.map(|adapter| Gpu::on(&adapter)).transpose()
    }

    fn on(adapter: &wgpu::Adapter) -> Result<Gpu> {
        let (device, queue) = adapter::device(adapter)?;
        let trouble: Arc<Mutex<Option<String>>> = Arc::default();
        let (on_error, on_loss) = (trouble.clone(), trouble.clone());
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| note(&on_error, error.to_string())));
        device.set_device_lost_callback(move |reason, message| {
            if reason != wgpu::DeviceLostReason::Destroyed {
                note(&on_loss, format!("the device was lost: {message}"));
            }
        });
        let pipelines = Pipelines::new(&device);
        let gpu = Gpu { device, queue, pipelines, buffers: None, trouble, name: adapter.get_info().name };
        gpu.check()?;
        Ok(gpu)
    }

    /// What the driver calls the adapter.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Draws a scene.
    pub fn draw(&mut self, drawing: &Drawing, scene: &Scene) -> Result<Picture> {
        let (width, height) = (drawing.frame.width, drawing.frame.height);
        let kept = self.buffers.take().filter(|buffers| buffers.fit(scene, [width, height]));
        let buffers = match kept {
            Some(buffers) => buffers,
            None => Buffers::new(&self.device, &self.queue, scene, [width, height])?,
        };
        buffers.set_drawing(&self.queue, drawing);
        let mut encoder = self.device.create_command_encoder(&Default::default());
        self.pipelines.encode(&self.device, &mut encoder, &buffers, drawing.fill);
        buffers.copy_out(&mut encoder);
        self.queue.submit([encoder.finish()]);
        let pixels = buffers.read(&self.device)?;
        self.check()?;
        self.buffers = Some(buffers);
        Ok(Picture { width, height, pixels })
    }

    /// The trouble since the last time, as an error.
    fn check(&self) -> Result<()> {
        let trouble = self.trouble.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).take();
        trouble.map_or(Ok(()), |what| Err(RenderError::Gpu(what)))
    }
}

/// Keeps the first thing that went wrong; the others mostly follow from it.
fn note(trouble: &Mutex<Option<String>>, what: String) {
    trouble.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).get_or_insert(what);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shader_is_valid() {
        for (name, source) in SHADERS {
            let module = naga::front::wgsl::parse_str(source)
                .unwrap_or_else(|error| panic!("{name}: {}", error.emit_to_string(source)));
            let flags = naga::valid::ValidationFlags::all();
            let mut validator = naga::valid::Validator::new(flags, naga::valid::Capabilities::empty());
            if let Err(error) = validator.validate(&module) {
                panic!("{name}: {}", error.emit_to_string(source));
            }
        }
    }

    /// Every shader against its pipeline and its bindings, on a device that does
    /// nothing but look.
    #[test]
    fn every_shader_fits_its_bindings() {
        let mut backend_options = wgpu::BackendOptions::default();
        backend_options.noop.enable = true;
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
            backends: wgpu::Backends::NOOP,
            backend_options,
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        });
        let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::NOOP));
        let gpu = Gpu::on(&adapters[0]).unwrap();
        let splats = vec![crate::render::frame::Splat::default(); 1000];
        let scene = Scene { splats, centre: [0.0; 3], reach: 1.0, largest: 1.0, id: 7 };
        let buffers = Buffers::new(&gpu.device, &gpu.queue, &scene, [100, 50]).unwrap();
        for fill in 0..3 {
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            gpu.pipelines.encode(&gpu.device, &mut encoder, &buffers, fill);
            buffers.copy_out(&mut encoder);
            gpu.queue.submit([encoder.finish()]);
        }
        gpu.check().unwrap();
    }
}
