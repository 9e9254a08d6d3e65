// Drawing by WebGPU: the compute shaders of shaders/, the very files that the daemon draws
// its pictures by, in the order in which it runs them (src/render/gpu/).
import { FRAME_BYTES, frameOf, tablesOf } from './frame.js';

// Each kernel by the files that make its shader.
const KERNELS = {
  clear: ['frame', 'clear'],
  depth: ['frame', 'project', 'depth'],
  shade: ['frame', 'project', 'shade'],
  resolve: ['frame', 'resolve'],
  fill: ['frame', 'fill'],
  light: ['frame', 'light'],
};
const FILES = ['frame', 'clear', 'project', 'depth', 'shade', 'resolve', 'fill', 'light', 'present'];
const SPLATS = 256;
const SIDE = 8;
// Bytes a pixel of the largest buffer, the sums.
const SUMS = 40;
const SPLAT = 16;

// Why nothing can be drawn here, in words for people.
export class NoWebGpu extends Error {}

export class Gpu {
  // Opens the machine's GPU, or whatever does its work. `lost` is told when it is gone.
  static async open(lost) {
    if (!isSecureContext) {
      throw new NoWebGpu('browsers draw by WebGPU on secure pages only: open this page by https, or on the daemon’s own machine by http://localhost');
    }
    if (!navigator.gpu) throw new NoWebGpu('this browser has no WebGPU; current versions of Chrome, Edge, Firefox and Safari have it');
    const adapter = await navigator.gpu.requestAdapter({ powerPreference: 'high-performance' });
    if (!adapter) throw new NoWebGpu('WebGPU found no graphics processor that it can use on this machine');
    const { maxStorageBufferBindingSize, maxBufferSize } = adapter.limits;
    // As much as a picture of 4K needs, where there is that much.
    const storage = Math.min(maxStorageBufferBindingSize, 512 << 20);
    const device = await adapter.requestDevice({
      requiredLimits: { maxStorageBufferBindingSize: storage, maxBufferSize: Math.min(maxBufferSize, storage) },
    });
    const sources = Object.fromEntries(await Promise.all(FILES.map(async name => {
      const answer = await fetch(new URL(`./${name}.wgsl`, import.meta.url));
      if (!answer.ok) throw new Error(`the shader ${name} could not be loaded`);
      return [name, await answer.text()];
    })));
    const isSoftware = adapter.info?.isFallbackAdapter ?? adapter.isFallbackAdapter ?? false;
    device.pushErrorScope('validation');
    const gpu = new Gpu(device, sources, isSoftware || /swiftshader|llvmpipe|basic render/i.test(adapter.info?.description + adapter.info?.architecture), lost);
    const error = await device.popErrorScope();
    if (error) throw new Error(error.message);
    return gpu;
  }

  #splats = null;
  #scene = null;
  #pixels = null;
  #context = null;
  #copy = null;

  constructor(device, sources, isSoftware, lost) {
    this.device = device;
    this.isSoftware = isSoftware;
    this.mostPixels = Math.floor(device.limits.maxStorageBufferBindingSize / SUMS);
    this.mostSplats = Math.floor(device.limits.maxStorageBufferBindingSize / SPLAT);
    device.lost.then(({ reason, message }) => {
      if (reason !== 'destroyed') lost(message);
    });
    const visibility = GPUShaderStage.COMPUTE;
    const types = ['uniform', 'read-only-storage', 'read-only-storage', ...Array(5).fill('storage')];
    this.layout = device.createBindGroupLayout({
      entries: types.map((type, binding) => ({ binding, visibility, buffer: { type } })),
    });
    const layout = device.createPipelineLayout({ bindGroupLayouts: [this.layout] });
    this.kernels = Object.fromEntries(Object.entries(KERNELS).map(([name, files]) => {
      const module = device.createShaderModule({ label: name, code: files.map(file => sources[file]).join('\n') });
      return [name, device.createComputePipeline({ label: name, layout, compute: { module, entryPoint: 'main' } })];
    }));
    // A processor's pictures reach a page by its memory; a GPU's need not leave the GPU.
    this.format = isSoftware ? 'rgba8unorm' : navigator.gpu.getPreferredCanvasFormat();
    const module = device.createShaderModule({ label: 'present', code: sources.present });
    this.present = device.createRenderPipeline({
      label: 'present',
      layout: 'auto',
      vertex: { module, entryPoint: 'vertex' },
      fragment: { module, entryPoint: 'fragment', targets: [{ format: this.format }] },
    });
    const uniform = size => device.createBuffer({ size, usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST });
    this.frame = uniform(FRAME_BYTES);
    this.shown = uniform(16);
  }

  #storage(size) {
    return this.device.createBuffer({ size, usage: GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_DST });
  }

  // Takes over a scene; called with the same one again it does nothing.
  #load(scene) {
    if (this.#scene === scene) return;
    const count = Math.min(scene.count, this.mostSplats);
    const size = SPLAT * Math.max(1, count);
    if (!this.#splats || this.#splats.size < size || this.#splats.size > 4 * size + (4 << 20)) {
      this.#splats?.destroy();
      this.#splats = this.#storage(Math.min(Math.ceil(size * 1.25 / SPLAT) * SPLAT, SPLAT * Math.max(1, this.mostSplats)));
      if (this.#pixels) this.#pixels.groups = null;
    }
    if (count > 0) this.device.queue.writeBuffer(this.#splats, 0, scene.buffer, 0, SPLAT * count);
    // What is not shown: a splat that is nowhere.
    else this.device.queue.writeBuffer(this.#splats, 0, new Float32Array(4).fill(NaN));
    if (this.#pixels) this.#pixels.groups = null;
    this.#scene = scene;
  }

  // Buffers for pictures of a size.
  #sized(width, height) {
    if (this.#pixels?.width === width && this.#pixels.height === height) return;
    for (const buffer of this.#pixels?.all ?? []) buffer.destroy();
    const pixels = width * height;
    const [tables, depths, sums, first, second, out] =
      [4 * (256 + height), 4 * pixels, SUMS * pixels, 8 * pixels, 8 * pixels, 4 * pixels].map(size => this.#storage(size));
    this.#pixels = { width, height, tables, depths, sums, first, second, out, groups: null, all: [tables, depths, sums, first, second, out] };
  }

  #groups() {
    const { tables, depths, sums, first, second, out } = this.#pixels;
    const splats = { buffer: this.#splats, size: SPLAT * Math.max(1, Math.min(this.#scene.count, this.mostSplats)) };
    const bind = (before, after) => this.device.createBindGroup({
      layout: this.layout,
      entries: [{ buffer: this.frame }, { buffer: tables }, splats, ...[depths, sums, before, after, out].map(buffer => ({ buffer }))]
        .map((resource, binding) => ({ binding, resource })),
    });
    this.#pixels.groups ??= {
      straight: bind(first, second),
      flipped: bind(second, first),
      shown: this.device.createBindGroup({
        layout: this.present.getBindGroupLayout(0),
        entries: [{ buffer: this.shown }, { buffer: out }].map((resource, binding) => ({ binding, resource })),
      }),
    };
    return this.#pixels.groups;
  }

  // Draws a scene on a canvas; the picture has `size`, and is stretched where the canvas has
  // another. Resolves when it is done.
  async draw(canvas, scene, camera, [width, height], shading, scale) {
    const { device, kernels } = this;
    const target = this.#target(canvas);
    this.#sized(width, height);
    this.#load(scene);
    const groups = this.#groups();
    device.queue.writeBuffer(this.frame, 0, frameOf(camera, [width, height], scene, shading, scale));
    device.queue.writeBuffer(this.#pixels.tables, 0, tablesOf(height, scene.largest, scale));
    device.queue.writeBuffer(this.shown, 0, new Uint32Array([width, height, canvas.width, canvas.height]));
    const encoder = device.createCommandEncoder();
    const pass = encoder.beginComputePass();
    const run = (kernel, group, x, y = 1) => {
      pass.setPipeline(kernel);
      pass.setBindGroup(0, group);
      pass.dispatchWorkgroups(x, y);
    };
    const [across, down] = [Math.ceil(width / SIDE), Math.ceil(height / SIDE)];
    const splats = Math.ceil(Math.max(1, Math.min(scene.count, this.mostSplats)) / SPLATS);
    run(kernels.clear, groups.straight, across, down);
    run(kernels.depth, groups.straight, splats);
    run(kernels.shade, groups.straight, splats);
    // Surfaces go from one buffer to the other: `resolve` writes where filling reads first.
    run(kernels.resolve, groups.flipped, across, down);
    let group = groups.straight;
    for (let round = 0; round < shading.fill; round += 1) {
      run(kernels.fill, group, across, down);
      group = group === groups.straight ? groups.flipped : groups.straight;
    }
    run(kernels.light, group, across, down);
    pass.end();
    const shown = encoder.beginRenderPass({
      colorAttachments: [{ view: target.createView(), loadOp: 'clear', storeOp: 'store' }],
    });
    shown.setPipeline(this.present);
    shown.setBindGroup(0, groups.shown);
    shown.draw(3);
    shown.end();
    if (this.isSoftware) {
      const { buffer, row } = this.#copy;
      encoder.copyTextureToBuffer({ texture: target }, { buffer, bytesPerRow: row }, [canvas.width, canvas.height]);
    }
    device.queue.submit([encoder.finish()]);
    if (this.isSoftware) await this.#paste(canvas);
    else await device.queue.onSubmittedWorkDone();
  }

  // What is drawn on: the canvas itself, or a texture that is copied to it.
  #target(canvas) {
    const { device, format, isSoftware } = this;
    if (!isSoftware) {
      if (!this.#context) {
        this.#context = canvas.getContext('webgpu');
        this.#context.configure({ device, format, alphaMode: 'opaque' });
      }
      return this.#context.getCurrentTexture();
    }
    const { width, height } = canvas;
    if (this.#copy?.width !== width || this.#copy.height !== height) {
      this.#copy?.texture.destroy();
      this.#copy?.buffer.destroy();
      // Rows begin at multiples of 256 bytes.
      const row = Math.ceil(4 * width / 256) * 256;
      this.#copy = {
        width,
        height,
        row,
        texture: device.createTexture({ size: [width, height], format, usage: GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.COPY_SRC }),
        buffer: device.createBuffer({ size: row * height, usage: GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ }),
      };
    }
    return this.#copy.texture;
  }

  async #paste(canvas) {
    const { width, height, row, buffer } = this.#copy;
    await buffer.mapAsync(GPUMapMode.READ);
    const rows = new Uint8Array(buffer.getMappedRange());
    const picture = new ImageData(width, height);
    for (let y = 0; y < height; y += 1) picture.data.set(rows.subarray(y * row, y * row + 4 * width), 4 * width * y);
    buffer.unmap();
    canvas.getContext('2d').putImageData(picture, 0, 0);
  }

  close() {
    this.#context?.unconfigure();
    this.device.destroy();
  }
}
