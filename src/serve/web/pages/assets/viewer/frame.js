// The figures of a frame in the layout that the shaders read: src/render/frame.rs has them
// in Rust.
import { dot, focal, plus } from './camera.js';
import { radiusOf } from './scene.js';

const DEPTHS = 1 << 24;
const SUBPIXELS = 16;
const SLOPE = 8;
const f32 = Math.fround;

export const FRAME_BYTES = 112;
export const SHADING = { core: [0.75, 8], fringe: 0.5, blend: 0.004, edl: 0.35, fill: 2, blended: true };
// From the top to the bottom.
export const BACKGROUND = [[38, 44, 54], [74, 82, 94]];

// The uniform of a frame. `scale` is how many times as large as usual splats are.
export function frameOf(camera, [width, height], { center, reach }, shading, scale = 1) {
  const bytes = new ArrayBuffer(FRAME_BYTES);
  const floats = new Float32Array(bytes);
  const numbers = new Uint32Array(bytes);
  const eye = plus(camera.eye, center, -1);
  const far = Math.sqrt(dot(eye, eye)) + reach;
  const f = focal(width, height);
  const zoom = Math.max(1, f32(Math.min(width, height) / 512));
  const smallest = f32(shading.core[0] * Math.max(1, scale));
  floats.set(camera.right, 0);
  floats[3] = f;
  floats.set(camera.up, 4);
  floats[7] = far * 1e-4;
  floats.set(camera.forward, 8);
  floats[11] = DEPTHS / f32(far);
  floats.set(eye, 12);
  floats[15] = smallest;
  floats[16] = Math.max(f32(f32(shading.core[1] * scale) * zoom), smallest);
  numbers[17] = Math.floor(shading.fringe * SUBPIXELS);
  floats[18] = shading.blend;
  floats[19] = shading.edl;
  numbers[20] = width;
  numbers[21] = height;
  numbers[22] = Math.round(zoom);
  numbers[23] = shading.blended ? 1 : 0;
  floats[24] = f32(SUBPIXELS * f32(far)) / DEPTHS;
  floats[25] = f32(shading.blend) + f32(SLOPE / f32(f));
  return new Uint8Array(bytes);
}

// The radii of all codes, then the background of each row.
export function tablesOf(height, largest, scale = 1) {
  const bytes = new ArrayBuffer(4 * (256 + height));
  const radii = new Float32Array(bytes, 0, 256);
  const rows = new Uint32Array(bytes, 4 * 256, height);
  for (let code = 0; code < 256; code += 1) radii[code] = radiusOf(code, largest) * scale;
  const [top, bottom] = BACKGROUND;
  const last = Math.max(1, height - 1);
  for (let y = 0; y < height; y += 1) {
    const [r, g, b] = top.map((a, i) => Math.floor((a * (last - y) + bottom[i] * y + Math.floor(last / 2)) / last));
    rows[y] = (r | g << 8 | b << 16 | 255 << 24) >>> 0;
  }
  return new Uint8Array(bytes);
}
