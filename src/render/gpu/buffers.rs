//! What lies in the GPU's memory: the splats of a scene, kept from frame to
//! frame, and the pixels of a picture.

use crate::render::error::{RenderError, Result};
use crate::render::frame::{Drawing, Frame, Splat};
use crate::render::kernel::resolve::Surface;
use crate::render::scene::Scene;

/// Splats in one buffer: 64 MiB, half of what every adapter can bind.
const PIECE: usize = 1 << 22;
/// Words of a pixel's sums.
const WORDS: u64 = 10;

pub struct Buffers {
    /// Of the picture, in pixels.
    pub size: [u32; 2],
    scene: u64,
    pieces: Vec<(wgpu::Buffer, u32)>,
    frame: wgpu::Buffer,
    tables: wgpu::Buffer,
    depths: wgpu::Buffer,
    sums: wgpu::Buffer,
    surfaces: [wgpu::Buffer; 2],
    pixels: wgpu::Buffer,
    out: wgpu::Buffer,
}

impl Buffers {
    pub fn new(device: &wgpu::Device, queue: &wgpu::Queue, scene: &Scene, size: [u32; 2]) -> Result<Buffers> {
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let largest = pixels * WORDS * 4;
        if largest > device.limits().max_storage_buffer_binding_size {
            return Err(RenderError::Gpu(format!(
                "a picture of {} by {} pixels needs buffers of {} MiB, more than the adapter binds",
                size[0],
                size[1],
                largest >> 20
            )));
        }
        let buffer = |bytes: u64, usage: wgpu::BufferUsages| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size: bytes,
                usage,
                mapped_at_creation: false,
            })
        };
        let storage = |bytes: u64| buffer(bytes, wgpu::BufferUsages::STORAGE);
        let piece = |splats: &[Splat]| {
            let contents = bytemuck::cast_slice(splats);
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
            let piece = buffer(contents.len() as u64, usage);
            queue.write_buffer(&piece, 0, contents);
            // So that not all of a large scene waits in staging memory at once.
            queue.submit([]);
            (piece, splats.len() as u32)
        };
        let rows = u64::from(size[1]);
        let surface = size_of::<Surface>() as u64 * pixels;
        Ok(Buffers {
            size,
            scene: scene.id,
            pieces: scene.splats.chunks(PIECE).map(piece).collect(),
            frame: buffer(
                size_of::<Frame>() as u64,
                wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            ),
            tables: buffer((256 + rows) * 4, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST),
            depths: storage(pixels * 4),
            sums: storage(largest),
            surfaces: [storage(surface), storage(surface)],
            pixels: buffer(pixels * 4, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC),
            out: buffer(pixels * 4, wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST),
        })
    }

    /// Whether they are those of this scene and size.
    pub fn fit(&self, scene: &Scene, size: [u32; 2]) -> bool {
        self.scene == scene.id && self.size == size
    }

    pub fn pieces(&self) -> usize {
        self.pieces.len()
    }

    pub fn splats_of(&self, piece: usize) -> u32 {
        self.pieces[piece].1
    }

    pub fn set_drawing(&self, queue: &wgpu::Queue, drawing: &Drawing) {
        queue.write_buffer(&self.frame, 0, bytemuck::bytes_of(&drawing.frame));
        let rows = (0..self.size[1]).map(|y| u32::from_le_bytes(drawing.background.row(y, self.size[1])));
        let tables: Vec<u32> = drawing.radii.iter().map(|radius| radius.to_bits()).chain(rows).collect();
        queue.write_buffer(&self.tables, 0, bytemuck::cast_slice(&tables));
    }

    /// A piece of the splats with everything else; `flip` says in which order
    /// the surfaces are read and written.
    pub fn bind(
        &self,
        device: &wgpu::Device,
        layout: &wgpu::BindGroupLayout,
        piece: usize,
        flip: bool,
    ) -> wgpu::BindGroup {
        let [first, second] = &self.surfaces;
        let (before, after) = if flip { (second, first) } else { (first, second) };
        // A scene without splats binds anything: nothing reads it.
        let splats = self.pieces.get(piece).map_or(&self.tables, |(buffer, _)| buffer);
        let all = [&self.frame, &self.tables, splats, &self.depths, &self.sums, before, after, &self.pixels];
        let entries: Vec<_> = all
            .iter()
            .enumerate()
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding: binding as u32,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
    }

    /// Records the way of the pixels to where they can be read.
    pub fn copy_out(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.copy_buffer_to_buffer(&self.pixels, 0, &self.out, 0, self.out.size());
    }

    /// Waits for the frame and takes its pixels.
    pub fn read(&self, device: &wgpu::Device) -> Result<Vec<[u8; 4]>> {
        let failed = |what: String| RenderError::Gpu(what);
        let (tell, told) = std::sync::mpsc::channel();
        self.out.map_async(wgpu::MapMode::Read, .., move |mapped| {
            // Nobody listens where waiting failed already.
            let _ = tell.send(mapped);
        });
        device.poll(wgpu::PollType::wait_indefinitely()).map_err(|error| failed(error.to_string()))?;
        let mapped = told.recv().map_err(|_| failed("the device did not answer".into()))?;
        mapped.map_err(|error| failed(format!("its memory could not be read: {error}")))?;
        let view = self.out.get_mapped_range(..).map_err(|error| failed(error.to_string()))?;
        let pixels = view.chunks_exact(4).map(|p| [p[0], p[1], p[2], p[3]]).collect();
        drop(view);
        self.out.unmap();
        Ok(pixels)
    }
}
