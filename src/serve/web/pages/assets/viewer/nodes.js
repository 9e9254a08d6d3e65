// The points of nodes, as they come from the daemon: positions as parts of the node's cube,
// and colors. src/render/viewer/points.rs writes them.

export const STEPS = 65536;
// Bytes of a point: of its position, and of its color.
export const POSITION = 6;
export const COLOR = 3;

// The points of one node that were loaded: always the first ones.
export class Points {
  constructor(most) {
    this.count = 0;
    this.steps = new Uint16Array(0);
    this.colors = new Uint8Array(0);
    this.most = most;
    // What the colors show.
    this.by = null;
  }

  // Points in answer to a request for those from `count` on.
  append(bytes, by) {
    const added = bytes.length / (POSITION + COLOR);
    if (!Number.isInteger(added)) throw new Error('the points of a node are cut');
    const steps = new Uint16Array(3 * (this.count + added));
    const colors = new Uint8Array(3 * (this.count + added));
    steps.set(this.steps);
    colors.set(this.colors);
    // Little-endian, as every machine with a browser is.
    steps.set(new Uint16Array(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + POSITION * added)), 3 * this.count);
    colors.set(bytes.subarray(POSITION * added), 3 * this.count);
    Object.assign(this, { steps, colors, by, count: this.count + added });
  }

  // Other colors for all points that there are.
  recolor(bytes, by) {
    if (bytes.length !== this.colors.length) throw new Error('the colors of a node are cut');
    Object.assign(this, { colors: bytes, by });
  }

  get bytes() {
    return this.steps.byteLength + this.colors.byteLength;
  }
}

// How many points to ask for where so many are needed: more than that, so that coming a
// little nearer is no request, and never more than there are.
export function enoughFor(needed, points) {
  if (needed * 1.5 >= points) return points;
  return Math.min(points, Math.ceil(needed * 1.25 / 256) * 256);
}
