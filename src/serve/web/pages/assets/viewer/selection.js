// Which nodes a picture needs, and how many points of each. The same rule as
// src/render/node_selection.rs, operation by operation: tests ask both for the same nodes.
import { focal, viewOf } from './camera.js';

export const POISSON_DENSITY = 0.75;

// Chooses nodes by their benefit, the parent's spacing in the picture, until the points are
// `spacing` pixels apart or `budget` is spent. Gives the nodes, parents first, each with the
// places of its chosen children; and the nodes whose children are not known yet.
export function select(space, root, camera, { spacing: wanted, budget, size, top = Infinity, bottom = -Infinity }, tick = 0) {
  const tight = [space.bounds[0].slice(), space.bounds[1].slice()];
  tight[1][2] = Math.min(tight[1][2], top);
  tight[0][2] = Math.max(tight[0][2], bottom);
  const waiting = new Heap();
  waiting.push({ benefit: Infinity, node: root, parent: -1, digit: 0 });
  const chosen = [];
  const unknown = [];
  let left = budget;
  for (let candidate = waiting.pop(); candidate; candidate = waiting.pop()) {
    const { node } = candidate;
    const pixels = pixelsAUnit(space, tight, camera, size, node);
    if (pixels <= 0) continue;
    node.seen = tick;
    const spacing = space.spacing(node.level) * pixels;
    const take = space.prefixes ? enough(node, spacing, wanted) : node.points;
    if (take > left && chosen.length > 0) break;
    left = Math.max(0, left - take);
    const place = chosen.length;
    if (candidate.parent >= 0) chosen[candidate.parent].children[candidate.digit] = place;
    chosen.push({ node, take, children: new Int32Array(8).fill(-1) });
    if (!(spacing > wanted)) continue;
    if (node.children === null) {
      unknown.push(node);
      continue;
    }
    node.children.forEach((child, digit) => {
      waiting.push({ benefit: spacing, node: child, parent: place, digit });
    });
  }
  return { chosen, unknown };
}

// How many of a node's points the picture can show.
function enough(node, spacing, wanted) {
  const ratio = node.children !== null && node.children.length === 0
    ? 2 * POISSON_DENSITY * (128 * spacing / wanted) ** 2
    : node.points * Math.min((spacing / wanted) ** 2, 1);
  return Math.min(Math.max(Math.ceil(ratio), 64), node.points);
}

// Pixels that a unit covers where a node is nearest to the camera; zero where it is not seen.
function pixelsAUnit(space, tight, camera, [width, height], node) {
  const { corner, sides } = space.cube(node);
  const low = [0, 1, 2].map(i => Math.max(corner[i], tight[0][i]));
  if (low[2] > tight[1][2]) return 0;
  const high = [0, 1, 2].map(i => Math.max(Math.min(corner[i] + sides[i], tight[1][i]), low[i]));
  const middle = [0, 1, 2].map(i => (low[i] + high[i]) / 2);
  const half = [0, 1, 2].map(i => (high[i] - low[i]) / 2);
  const f = focal(width, height);
  const slopes = [width / 2 / f, height / 2 / f];
  const at = viewOf(camera, middle);
  const along = axis => Math.abs(axis[0]) * half[0] + Math.abs(axis[1]) * half[1] + Math.abs(axis[2]) * half[2];
  const axes = [along(camera.right), along(camera.up), along(camera.forward)];
  const farthest = at[2] + axes[2];
  if (farthest <= 0) return 0;
  for (let i = 0; i < 2; i += 1) {
    const reach = axes[i] + slopes[i] * axes[2];
    if (Math.abs(at[i]) - slopes[i] * at[2] > reach) return 0;
  }
  let nearest = 0;
  for (let i = 0; i < 3; i += 1) {
    const d = camera.eye[i] - Math.min(Math.max(camera.eye[i], low[i]), high[i]);
    nearest += d * d;
  }
  return f / Math.max(Math.sqrt(nearest), farthest * 1e-4, Number.MIN_VALUE);
}

// Greatest benefit first, then by the name: coarse nodes before fine ones.
function isBefore(a, b) {
  if (a.benefit !== b.benefit) return a.benefit > b.benefit;
  if (a.node.level !== b.node.level) return a.node.level < b.node.level;
  return a.node.name < b.node.name;
}

class Heap {
  #items = [];

  push(item) {
    const items = this.#items;
    let at = items.length;
    items.push(item);
    while (at > 0) {
      const parent = (at - 1) >> 1;
      if (!isBefore(item, items[parent])) break;
      items[at] = items[parent];
      at = parent;
    }
    items[at] = item;
  }

  pop() {
    const items = this.#items;
    const first = items[0];
    const last = items.pop();
    if (items.length === 0) return first;
    let at = 0;
    for (;;) {
      let child = 2 * at + 1;
      if (child >= items.length) break;
      if (child + 1 < items.length && isBefore(items[child + 1], items[child])) child += 1;
      if (!isBefore(items[child], last)) break;
      items[at] = items[child];
      at = child;
    }
    items[at] = last;
    return first;
  }
}
