// The viewer's loader before a daemon that is slow, fails, and replaces the octree.
import assert from 'node:assert/strict';
import fs from 'node:fs';
import { cameraOf } from './camera.js';
import { Loader } from './loader.js';

const { description, pages, nodes } = JSON.parse(fs.readFileSync(process.argv[2], 'utf8'));
const points = new Map(nodes);
const pageOf = new Map(pages.map(({ node, bytes }) => [node, Uint8Array.from(bytes)]));

// A daemon that notes what it is asked for; `answer` may refuse.
function daemon(answer = () => 200) {
  const asked = [];
  const state = { asked, waiting: 0, most: 0 };
  state.fetch = async (address, { signal } = {}) => {
    const url = new URL(address, 'http://x');
    const [kind, node] = url.pathname.split('/').slice(-2);
    asked.push(`${kind} ${node} ${url.searchParams}`);
    state.waiting += 1;
    state.most = Math.max(state.most, state.waiting);
    await new Promise(resolve => setTimeout(resolve, 2));
    state.waiting -= 1;
    if (signal?.aborted) throw new DOMException('aborted', 'AbortError');
    const status = answer(kind, node, asked.length);
    if (status === 0) throw new TypeError('no connection');
    if (status !== 200) return new Response(JSON.stringify({ error: 'no' }), { status });
    if (kind === 'pages') return new Response(pageOf.get(node));
    const [from, to] = ['from', 'to'].map(key => Number(url.searchParams.get(key)));
    const count = Math.min(to, points.get(node)) - from;
    return new Response(new Uint8Array((url.searchParams.has('colors') ? 3 : 9) * count).fill(from % 251));
  };
  return state;
}

function watch(server) {
  const told = [];
  const loader = new Loader({ root: 'http://x/data', description: { ...description, revision: 'one' }, by: 'auto', fetch: server.fetch, post: message => told.push(message), pauses: [10, 20, 40] });
  const last = type => told.findLast(message => message.type === type);
  const until = async (what, is) => {
    for (const end = Date.now() + 30_000; Date.now() < end;) {
      if (is()) return;
      await new Promise(resolve => setTimeout(resolve, 5));
    }
    assert.fail(`waited in vain for ${what}`);
  };
  return { loader, told, last, settled: () => until('rest', () => last('status')?.settled && last('scene')), until };
}

const { start } = description;
const view = (shot = start, more = {}) =>
  ({ camera: cameraOf(shot), size: [400, 300], spacing: 1, budget: 300_000, top: Infinity, bottom: -Infinity, center: start.target, ...more });
const once = asked => assert.equal(new Set(asked).size, asked.length, `asked twice: ${asked.filter((one, at) => asked.indexOf(one) !== at)}`);

{
  const server = daemon();
  const { loader, told, last, settled } = watch(server);
  loader.look(view());
  await settled();
  const { count, nodes: drawn } = last('scene').scene;
  assert.ok(count > 300 && drawn > 3, `${count} points of ${drawn} nodes`);
  assert.ok(server.most <= 7, `${server.most} requests at a time`);
  once(server.asked);
  // A first picture long before all is there.
  assert.ok(told.findIndex(message => message.type === 'scene') < told.length - 3);
  // Nothing more for the same camera.
  const before = server.asked.length;
  for (let again = 0; again < 3; again += 1) loader.look(view());
  await settled();
  assert.equal(server.asked.length, before);
  // Nearer: only what is new.
  loader.look(view({ ...start, distance: start.distance / 3 }));
  await settled();
  assert.ok(server.asked.length > before);
  once(server.asked);
  const ranges = new Map();
  for (const request of server.asked.filter(one => one.startsWith('nodes'))) {
    const [, node, query] = request.split(' ');
    const [from, to] = ['from', 'to'].map(key => Number(new URLSearchParams(query).get(key)));
    assert.equal(from, ranges.get(node) ?? 0, `${node} goes on where it ended`);
    ranges.set(node, to);
  }
  // Other colors: no position again.
  const positions = server.asked.length;
  loader.color('height');
  await settled();
  const later = server.asked.slice(positions);
  assert.ok(later.length > 0 && later.every(request => request.includes('colors=true')), later.join('\n'));
  // Nobody looks: nothing is asked for.
  loader.rest(true);
  const resting = server.asked.length;
  loader.look(view({ ...start, distance: start.distance / 9 }));
  await new Promise(resolve => setTimeout(resolve, 60));
  assert.equal(server.asked.length, resting);
  loader.end();
}

{
  // Each node fails once; one fails for ever.
  const failed = new Set();
  const server = daemon((kind, node) => {
    if (kind !== 'nodes') return 200;
    if (node === 'r0' || node === 'r') return node === 'r' ? 200 : 500;
    if (failed.has(node)) return 200;
    failed.add(node);
    return 0;
  });
  const { loader, last, settled, until } = watch(server);
  loader.look(view());
  await until('what was given up', () => last('status')?.failed > 0 && last('status').pending === 0);
  await settled();
  assert.equal(last('status').failed, 1);
  assert.match(last('status').why, /no/);
  assert.equal(server.asked.filter(request => request.startsWith('nodes r0 ')).length, 4);
  loader.end();
}

{
  const server = daemon(kind => (kind === 'nodes' ? 410 : 200));
  const { loader, last, until } = watch(server);
  loader.look(view());
  await until('word of the new octree', () => last('replaced'));
  loader.end();
}

{
  // Called off: what is not in sight any more.
  const server = daemon();
  const { loader, last, settled } = watch(server);
  loader.look(view());
  await new Promise(resolve => setTimeout(resolve, 8));
  loader.look(view({ ...start, target: start.target.map(c => c + 1e6) }));
  await settled();
  assert.equal(last('scene').scene.count, 0);
  loader.look(view());
  await settled();
  assert.ok(last('scene').scene.count > 300);
  loader.end();
}

{
  // Memory: what was looked at long ago goes.
  const server = daemon();
  const { loader, last, settled } = watch(server);
  loader.look(view(start, { budget: 1e6 }));
  await settled();
  assert.ok(last('status').kept <= description.points);
  loader.end();
}
