// Loads an octree with potree-core, as a viewer does: its loader reads the
// metadata and the hierarchy, its workers decode the points. Every node's points
// are then held against those that Lodestone's own reader gave (expected.json,
// expected.bin), attribute by attribute.
//
// usage: node read.mjs OCTREE EXPECTED

import fs from 'node:fs/promises';
import path from 'node:path';
import './browser.mjs';

const { Potree } = await import('potree-core');
const [, , octreeFolder, expectedFolder] = process.argv;

const READERS = {
  int8: 'getInt8',
  int16: 'getInt16',
  int32: 'getInt32',
  uint8: 'getUint8',
  uint16: 'getUint16',
  uint32: 'getUint32',
  float: 'getFloat32',
  double: 'getFloat64',
};

const files = new Map();

/** Serves the octree's files with ranges, as a web server does. */
const requests = {
  getUrl: async (url) => url,
  fetch: async (url, options) => {
    const name = path.basename(url);
    if (!files.has(name)) files.set(name, await fs.readFile(path.join(octreeFolder, name)));
    const whole = files.get(name);
    const range = /bytes=(\d+)-(\d+)/.exec(options?.headers?.Range ?? '');
    const [start, end] = range ? [Number(range[1]), Number(range[2]) + 1] : [0, whole.length];
    if (start > end || end > whole.length) throw fail(`bytes ${start} to ${end} are not in ${url}`);
    const bytes = Uint8Array.from(whole.subarray(start, end));
    const text = async () => new TextDecoder().decode(bytes);
    return { ok: true, arrayBuffer: async () => bytes.buffer, text, json: async () => JSON.parse(await text()) };
  },
};

/** The viewer keeps the reasons of its failures to itself: they go here too. */
let failure = null;
function fail(reason) {
  failure = new Error(reason);
  return failure;
}

/** Milliseconds, on a machine that is busy with other tests. */
const PATIENCE = 60_000;

/** Loads a node and waits for its worker. */
async function load(node) {
  await node.octreeGeometry.loader.load(node);
  for (const end = Date.now() + PATIENCE; !node.loaded; ) {
    if (failure || Date.now() > end) throw failure ?? new Error(`node ${node.name} does not load`);
    await new Promise((resolve) => setTimeout(resolve, 1));
  }
}

/** The points of a node as the viewer has them, a line of numbers each. */
function seen(node, attributes) {
  const lines = Array.from({ length: node.numPoints }, () => []);
  for (const { name } of attributes) {
    const shown = node.geometry.getAttribute(name === 'rgb' ? 'rgba' : name);
    if (!shown) throw new Error(`node ${node.name} has no attribute '${name}'`);
    const width = name === 'position' || name === 'rgb' ? 3 : 1;
    const values = width === 3 ? shown.array : shown.potree.preciseBuffer;
    const step = name === 'rgb' ? 4 : width;
    lines.forEach((line, i) => {
      for (let element = 0; element < width; element++) line.push(values[i * step + element]);
    });
  }
  return lines.map((line) => line.join(' ')).sort();
}

/**
 * The same from the records, by the viewer's own rules: positions as floats from
 * the node's corner, colours as bytes, of other attributes the first element.
 */
function wanted(node, records, expected) {
  const view = new DataView(records.buffer, records.byteOffset, records.byteLength);
  const { scale, offset, recordSize, attributes } = expected;
  const corner = node.octreeGeometry.offset.clone().add(node.boundingBox.min).toArray();
  const lines = [];
  for (let start = 0; start < records.length; start += recordSize) {
    const line = [];
    for (const attribute of attributes) {
      const read = (element) =>
        view[READERS[attribute.type]](start + attribute.offset + element * attribute.elementSize, true);
      if (attribute.name === 'position') {
        for (let a = 0; a < 3; a++) line.push(Math.fround(read(a) * scale[a] + offset[a] - corner[a]));
      } else if (attribute.name === 'rgb') {
        for (let c = 0; c < 3; c++) line.push(Math.floor(read(c) > 255 ? read(c) / 256 : read(c)));
      } else {
        line.push(read(0));
      }
    }
    lines.push(line.join(' '));
  }
  return lines.sort();
}

const expected = JSON.parse(await fs.readFile(path.join(expectedFolder, 'expected.json'), 'utf8'));
const records = await fs.readFile(path.join(expectedFolder, 'expected.bin'));
const cloud = await new Potree().loadPointCloud('./metadata.json', requests);

const waiting = [cloud.pcoGeometry.root];
let [nodes, points] = [0, 0];
while (waiting.length > 0) {
  const node = waiting.shift();
  await load(node);
  const truth = expected.nodes[node.name];
  if (!truth) throw new Error(`the viewer finds a node ${node.name} that there is not`);
  const ours = wanted(node, records.subarray(truth.start, truth.start + truth.size), expected);
  const theirs = seen(node, expected.attributes);
  const differing = ours.findIndex((line, i) => line !== theirs[i]);
  if (ours.length !== theirs.length || differing >= 0) {
    const [a, b] = [theirs[differing], ours[differing]];
    throw new Error(`${node.name}: ${theirs.length} of ${ours.length} points; the viewer has\n${a}\nnot\n${b}`);
  }
  nodes += 1;
  points += theirs.length;
  waiting.push(...node.children.filter((child) => child));
}
if (nodes !== Object.keys(expected.nodes).length) throw new Error(`the viewer finds ${nodes} nodes`);
console.log(JSON.stringify({ nodes, points }));
