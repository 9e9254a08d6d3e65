// An octree's nodes, as far as they are known, read from pages. src/render/viewer/pages.rs
// writes them, and says how.

const RECORD = 6;
const ELSEWHERE = 1;

export class Node {
  constructor(name, level, cell) {
    this.name = name;
    this.level = level;
    this.cell = cell;
    this.points = 0;
    // By their digits; null where their page was not read.
    this.children = [];
    // When it was last looked at, by the counter of selections.
    this.seen = 0;
    // The points that were loaded, see nodes.js.
    this.data = null;
  }

  child(digit) {
    const [x, y, z] = this.cell;
    const cell = [2 * x + (digit >> 2), 2 * y + (digit >> 1 & 1), 2 * z + (digit & 1)];
    return new Node(this.name + digit, this.level + 1, cell);
  }
}

// Reads the page of a node: it, and what lies below as far as the page goes. The nodes whose
// children are elsewhere have `children` null.
export function readPage(root, bytes) {
  if (bytes.length === 0 || bytes.length % RECORD !== 0) throw new Error('a page of the hierarchy is cut');
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const waiting = [root];
  let at = 0;
  for (const node of waiting) {
    if (at >= bytes.length) throw new Error('a page of the hierarchy is cut');
    const mask = bytes[at];
    node.points = view.getUint32(at + 2, true);
    if (bytes[at + 1] & ELSEWHERE) {
      node.children = null;
    } else {
      node.children = [];
      for (let digit = 0; digit < 8; digit += 1) {
        if ((mask >> digit & 1) === 0) continue;
        const child = node.child(digit);
        node.children[digit] = child;
        waiting.push(child);
      }
    }
    at += RECORD;
  }
  return waiting.length;
}

// What is measured in an octree; `description` is the daemon's.
export class Space {
  constructor({ low, side, unit, spacing, bounds, has_prefixes: prefixes, has_cubes: cubes }) {
    Object.assign(this, { low, side, unit, rootSpacing: spacing, bounds, prefixes, cubes });
  }

  // Lower corner and sides of a node's cube, as positions count.
  cube(node) {
    const side = this.side / 2 ** node.level;
    return {
      corner: [0, 1, 2].map(i => (this.low[i] + node.cell[i] * side) * this.unit[i]),
      sides: this.unit.map(unit => side * unit),
    };
  }

  spacing(level) {
    return this.rootSpacing / 2 ** level;
  }
}
