//! The shaders, and the order in which they run.

use super::buffers::Buffers;

/// Each shader by its kernel's name, with what stands before it.
pub const SHADERS: [(&str, &str); 6] = [
    (
        "clear",
        concat!(include_str!("../../../shaders/frame.wgsl"), include_str!("../../../shaders/clear.wgsl")),
    ),
    (
        "depth",
        concat!(
            include_str!("../../../shaders/frame.wgsl"),
            include_str!("../../../shaders/project.wgsl"),
            include_str!("../../../shaders/depth.wgsl")
        ),
    ),
    (
        "shade",
        concat!(
            include_str!("../../../shaders/frame.wgsl"),
            include_str!("../../../shaders/project.wgsl"),
            include_str!("../../../shaders/shade.wgsl")
        ),
    ),
    (
        "resolve",
        concat!(include_str!("../../../shaders/frame.wgsl"), include_str!("../../../shaders/resolve.wgsl")),
    ),
    (
        "fill",
        concat!(include_str!("../../../shaders/frame.wgsl"), include_str!("../../../shaders/fill.wgsl")),
    ),
    (
        "light",
        concat!(include_str!("../../../shaders/frame.wgsl"), include_str!("../../../shaders/light.wgsl")),
    ),
];

/// Splats a workgroup, and pixels of a workgroup's side.
const SPLATS: u32 = 256;
const SIDE: u32 = 8;

/// The kernels, ready to run.
pub struct Pipelines {
    layout: wgpu::BindGroupLayout,
    kernels: [wgpu::ComputePipeline; 6],
}

impl Pipelines {
    pub fn new(device: &wgpu::Device) -> Pipelines {
        let entry = |binding: u32, ty: wgpu::BufferBindingType| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
            count: None,
        };
        let storage = |read_only| wgpu::BufferBindingType::Storage { read_only };
        let entries: Vec<_> = (0..8)
            .map(|binding| match binding {
                0 => entry(0, wgpu::BufferBindingType::Uniform),
                1 | 2 => entry(binding, storage(true)),
                _ => entry(binding, storage(false)),
            })
            .collect();
        let layout = device
            .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries });
        let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let kernels = SHADERS.map(|(name, source)| {
            let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(name),
                source: wgpu::ShaderSource::Wgsl(source.into()),
            });
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(name),
                layout: Some(&pipeline_layout),
                module: &module,
                entry_point: Some("main"),
                compilation_options: Default::default(),
                cache: None,
            })
        });
        Pipelines { layout, kernels }
    }

    /// Records a frame.
    pub fn encode(
        &self,
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        buffers: &Buffers,
        fill: u32,
    ) {
        let [clear, depth, shade, resolve, fill_holes, light] = &self.kernels;
        let [width, height] = buffers.size;
        let pixels = [width.div_ceil(SIDE), height.div_ceil(SIDE)];
        // Surfaces go from one buffer to the other with each step that makes new
        // ones; `resolve` writes where the first round of filling reads.
        let flipped = [false, true].map(|flip| buffers.bind(device, &self.layout, 0, flip));
        let mut pass = encoder.begin_compute_pass(&Default::default());
        let mut run = |kernel: &wgpu::ComputePipeline, group: &wgpu::BindGroup, [x, y]: [u32; 2]| {
            pass.set_pipeline(kernel);
            pass.set_bind_group(0, group, &[]);
            pass.dispatch_workgroups(x, y, 1);
        };
        run(clear, &flipped[0], pixels);
        let pieces: Vec<(wgpu::BindGroup, u32)> = (0..buffers.pieces())
            .map(|piece| {
                let splats = buffers.splats_of(piece);
                (buffers.bind(device, &self.layout, piece, false), splats.div_ceil(SPLATS))
            })
            .collect();
        for kernel in [depth, shade] {
            pieces.iter().for_each(|(group, workgroups)| run(kernel, group, [*workgroups, 1]));
        }
        run(resolve, &flipped[0], pixels);
        for round in 0..fill {
            run(fill_holes, &flipped[(round as usize + 1) % 2], pixels);
        }
        run(light, &flipped[(fill as usize + 1) % 2], pixels);
    }
}
