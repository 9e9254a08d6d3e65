// The viewer's choice of nodes, against what Rust wrote down.
import fs from 'node:fs';
import { Node, Space, readPage } from './hierarchy.js';
import { select } from './selection.js';

const octrees = JSON.parse(fs.readFileSync(process.argv[2], 'utf8'));

function tree(pages) {
  const root = new Node('r', 0, [0, 0, 0]);
  const known = new Map([['r', root]]);
  // Coarse pages before those that they lead to.
  for (const { node, bytes } of [...pages].sort((a, b) => a.node.length - b.node.length)) {
    readPage(known.get(node), Uint8Array.from(bytes));
    const open = [known.get(node)];
    for (const one of open) {
      for (const child of Object.values(one.children ?? [])) {
        known.set(child.name, child);
        open.push(child);
      }
    }
  }
  return { root, known };
}

const wantedOf = ({ spacing, budget, size, top }) => ({ spacing, budget, size, top: top ?? Infinity });
let cameras = 0;
let same = 0;
const different = [];
for (const { description, pages, cases } of octrees) {
  const space = new Space(description);
  const { root } = tree(pages);
  for (const one of cases) {
    const { chosen, unknown } = select(space, root, one.camera, wantedOf(one));
    const ours = JSON.stringify(chosen.map(({ node, take }) => [node.name, take]));
    cameras += 1;
    if (ours === JSON.stringify(one.chosen) && unknown.length === 0) same += 1;
    else different.push(`${ours.slice(0, 300)}\n${JSON.stringify(one.chosen).slice(0, 300)}`);
  }
}
console.log(`${same} of ${cameras} cameras, ${octrees.length} octrees`);
if (same !== cameras) throw new Error(different.slice(0, 3).join('\n\n'));
