// From chosen nodes to splats: positions from a center, colors, and each splat's size from
// the density of the points around it, after src/render/scene.rs.
import { POISSON_DENSITY } from './selection.js';
import { STEPS } from './nodes.js';

const COVER = 0.75;
const CELLS = 8;
const SCATTERED = 1.5;
const SURFACE = 3 * CELLS * CELLS;
const STRAY = 2;
const WORDS = CELLS ** 3 / 32;
// Levels that the steps of a position tell apart.
const DEEPEST = 16;
const CODES_AN_OCTAVE = 16;

export function radiusCode(radius, largest) {
  return Math.max(0, Math.min(255, Math.round(Math.log2(largest / radius) * CODES_AN_OCTAVE)));
}

export function radiusOf(code, largest) {
  return largest * 2 ** (-code / CODES_AN_OCTAVE);
}

// Makes splats of what is loaded of the chosen nodes: sixteen bytes each, x, y, z as floats
// from `center`, then red, green, blue and the code of the radius. `owners` tells the node of
// each, by its place among the chosen; `places` which of the node's points it is.
export function compose(space, chosen, center, top = Infinity, bottom = -Infinity) {
  const drawn = drawable(chosen);
  let most = 0;
  for (const { take, node } of drawn) most += Math.min(take, node.data.count);
  const buffer = new ArrayBuffer(16 * most);
  const positions = new Float32Array(buffer);
  const paints = new Uint32Array(buffer);
  const regions = new Uint32Array(most);
  const owners = new Uint32Array(most);
  const places = new Uint32Array(most);
  const points = new Uint32Array(drawn.length);
  const occupied = new Uint32Array(drawn.length * WORDS);
  const children = new Int32Array(8 * drawn.length);
  drawn.forEach((one, at) => children.set(one.children, 8 * at));
  const counted = drawn.map(({ node }) => within(space, space.cube(node)));
  const shift = Math.log2(CELLS);
  let count = 0;
  let farthest = 0;
  drawn.forEach(({ node, take }, place) => {
    const { corner, sides } = space.cube(node);
    const { steps, colors, count: loaded } = node.data;
    const scale = sides.map(side => side / STEPS);
    const from = [0, 1, 2].map(i => corner[i] + 0.5 * scale[i] - center[i]);
    const [low, high] = [bottom - center[2], top - center[2]];
    const end = Math.min(take, loaded);
    for (let point = 0; point < end; point += 1) {
      const [sx, sy, sz] = [steps[3 * point], steps[3 * point + 1], steps[3 * point + 2]];
      const z = from[2] + sz * scale[2];
      if (z > high || z < low) continue;
      const x = from[0] + sx * scale[0];
      const y = from[1] + sy * scale[1];
      let region = place;
      let depth = 0;
      while (depth < DEEPEST) {
        const bit = 15 - depth;
        const child = children[8 * region + ((sx >> bit & 1) << 2 | (sy >> bit & 1) << 1 | (sz >> bit & 1))];
        if (child < 0) break;
        region = child;
        depth += 1;
      }
      let cell;
      if (space.cubes) {
        const down = 16 - depth - shift;
        const part = step => (down >= 0 ? step >> down : step << -down) & (CELLS - 1);
        cell = part(sx) << 6 | part(sy) << 3 | part(sz);
      } else {
        const { corner: origin, side } = counted[region];
        const part = (value, i) =>
          Math.max(0, Math.min(CELLS - 1, Math.floor((value + center[i] - origin[i]) * (CELLS / side))));
        cell = part(x, 0) << 6 | part(y, 1) << 3 | part(z, 2);
      }
      points[region] += 1;
      occupied[region * WORDS + (cell >> 5)] |= 1 << (cell & 31);
      positions[4 * count] = x;
      positions[4 * count + 1] = y;
      positions[4 * count + 2] = z;
      paints[4 * count + 3] = colors[3 * point] | colors[3 * point + 1] << 8 | colors[3 * point + 2] << 16;
      regions[count] = region;
      owners[count] = place;
      places[count] = point;
      farthest = Math.max(farthest, x * x + y * y + z * z);
      count += 1;
    }
  });
  // No splat is larger than a leaf of a cloud of a few points asks for.
  const root = chosen[0]?.node ?? null;
  const largest = (root ? spacingOf(space, root, within(space, space.cube(root))) : 1) * 32;
  const codes = spacings(space, drawn, counted, points, occupied, count)
    .map(spacing => radiusCode(COVER * spacing, largest));
  for (let splat = 0; splat < count; splat += 1) {
    paints[4 * splat + 3] = (paints[4 * splat + 3] | codes[regions[splat]] << 24) >>> 0;
  }
  return { buffer, count, center, reach: Math.sqrt(farthest), largest, drawn, owners, places };
}

// The chosen nodes of which points are loaded, renumbered. A node whose parent is still to
// come is drawn all the same, only nothing of the parent is counted to it.
function drawable(chosen) {
  const numbers = new Int32Array(chosen.length).fill(-1);
  const drawn = [];
  chosen.forEach(({ node, take }, at) => {
    if (!node.data || node.data.count === 0 || take === 0) return;
    numbers[at] = drawn.length;
    drawn.push({ node, take, from: at, children: null });
  });
  for (const one of drawn) one.children = Int32Array.from(chosen[one.from].children, at => (at < 0 ? -1 : numbers[at]));
  return drawn;
}

// The cube within a node's space in which its points are counted.
function within(space, { corner, sides }) {
  if (space.cubes) return { corner, side: sides[0] };
  const [low, high] = space.bounds;
  const from = [0, 1, 2].map(i => Math.max(corner[i], low[i]));
  const reach = Math.max(0, ...[0, 1, 2].map(i => Math.min(corner[i] + sides[i], high[i]) - from[i]));
  return { corner: from, side: reach > 0 ? reach : sides[2] };
}

function spacingOf(space, node, counted) {
  return space.cubes ? space.spacing(node.level) : counted.side / 128;
}

// How far apart the points of each region are.
function spacings(space, drawn, counted, points, occupied, all) {
  const apart = [];
  const usual = [];
  const strays = [];
  drawn.forEach(({ node }, place) => {
    const level = spacingOf(space, node, counted[place]);
    if (points[place] === 0) {
      apart.push(level);
      usual.push([level, 0]);
      return;
    }
    let cells = 0;
    for (let word = 0; word < WORDS; word += 1) cells += bits(occupied[place * WORDS + word]);
    const density = points[place] / cells;
    const scattered = density < SCATTERED || (cells > SURFACE && density < 2 * SCATTERED);
    const stray = scattered && points[place] * 20 < all;
    const trusted = stray ? 1 : 2 + Math.min(points[place], 480) / 16;
    const most = level * Math.min(trusted, CELLS * 2);
    const found = counted[place].side / CELLS * Math.sqrt(POISSON_DENSITY / density);
    const spacing = Math.min(Math.max(found, level / 16), most);
    if (stray) strays.push(place);
    else usual.push([spacing, points[place]]);
    apart.push(spacing);
  });
  // Noise is drawn about as large as most points.
  usual.sort((a, b) => a[0] - b[0]);
  const half = Math.floor(usual.reduce((sum, [, count]) => sum + count, 0) / 2);
  let sum = 0;
  const middle = usual.find(([, count]) => (sum += count) > half);
  if (middle) for (const place of strays) apart[place] = Math.min(apart[place], STRAY * middle[0]);
  return apart;
}

function bits(word) {
  let n = word - (word >>> 1 & 0x55555555);
  n = (n & 0x33333333) + (n >>> 2 & 0x33333333);
  return Math.imul(n + (n >>> 4) & 0x0f0f0f0f, 0x01010101) >>> 24;
}

// The splat that is seen at a pixel, or near it: of those within `radius` pixels the nearest to
// the eye, and of about as near ones the one nearest to the pixel.
export function pick(scene, camera, pixel, size, focal, radius, slack = 0.01) {
  const positions = new Float32Array(scene.buffer);
  const eye = camera.eye.map((c, i) => c - scene.center[i]);
  const { right, up, forward } = camera;
  let best = -1;
  let bestAway = Infinity;
  let bestSquare = Infinity;
  for (let splat = 0; splat < scene.count; splat += 1) {
    const x = positions[4 * splat] - eye[0];
    const y = positions[4 * splat + 1] - eye[1];
    const z = positions[4 * splat + 2] - eye[2];
    const away = forward[0] * x + forward[1] * y + forward[2] * z;
    if (!(away > 0) || away > bestAway * (1 + slack)) continue;
    const dx = size[0] / 2 + (right[0] * x + right[1] * y + right[2] * z) / away * focal - pixel[0];
    const dy = size[1] / 2 - (up[0] * x + up[1] * y + up[2] * z) / away * focal - pixel[1];
    const square = dx * dx + dy * dy;
    if (square > radius * radius) continue;
    if (away < bestAway * (1 - slack) || square < bestSquare) [best, bestAway, bestSquare] = [splat, away, square];
  }
  if (best < 0) return null;
  const { node } = scene.drawn[scene.owners[best]];
  const position = [0, 1, 2].map(i => positions[4 * best + i] + scene.center[i]);
  return { position, node: node.name, place: scene.places[best] };
}
