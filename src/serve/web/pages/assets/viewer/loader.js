// What a view needs of an octree: chosen, asked for by its benefit, kept while there is
// room, and composed to a scene. Runs in a worker, and knows neither page nor GPU; tests run
// it under Node, with a `fetch` of their own.
import { focal } from './camera.js';
import { Node, Space, readPage } from './hierarchy.js';
import { Points, enoughFor } from './nodes.js';
import { compose, pick } from './scene.js';
import { select } from './selection.js';

// Requests at a time.
const MOST_REQUESTS = 6;
// How long until a request that failed is sent again, in milliseconds; then it is given up.
const PAUSES = [500, 2000, 8000];
// Points that are kept at least, and as a multiple of what is drawn at most.
const LEAST_KEPT = 2_000_000;
const KEPT = 2;
// Nodes of the hierarchy that are kept.
const MOST_NODES = 200_000;
// Between two scenes while points arrive, in milliseconds; longer where composing takes long.
const PACE = 120;

export class Loader {
  #inFlight = new Map();
  #failures = new Map();
  #tick = 0;
  #view = null;
  #chosen = [];
  #composed = '';
  #scene = null;
  #timer = null;
  #wakeUp = null;
  #last = 0;
  #took = 0;
  #kept = 0;
  #withPoints = new Set();
  #pages = [];
  #nodes = 1;
  #resting = false;
  #ended = false;
  bytes = 0;
  requests = 0;

  // `root` is where the octree's data is served, `post` takes what there is to say.
  constructor({ root, description, by, fetch, post, pauses = PAUSES }) {
    Object.assign(this, { root, description, by, fetch, post, pauses });
    this.space = new Space(description);
    this.tree = new Node('r', 0, [0, 0, 0]);
    this.tree.children = null;
    // Nothing is known of its points before its page was read.
    this.opened = false;
  }

  // Looks from somewhere: camera, size, spacing, budget, top, bottom, center.
  look(view) {
    this.#view = view;
    this.#update();
  }

  color(by) {
    this.by = by;
    this.#update();
  }

  // Tries again what was given up.
  retry() {
    this.#failures.clear();
    this.#update();
  }

  // Nothing is asked for while nobody looks.
  rest(resting) {
    this.#resting = resting;
    this.#update();
  }

  end() {
    this.#ended = true;
    for (const { controller } of this.#inFlight.values()) controller.abort();
    clearTimeout(this.#timer);
    clearTimeout(this.#wakeUp);
  }

  pick(pixel, radius) {
    if (!this.#scene || !this.#view) return null;
    const { camera, size } = this.#view;
    return pick(this.#scene, camera, pixel, size, focal(...size), radius);
  }

  #update() {
    if (!this.#view || this.#ended) return;
    const { camera } = this.#view;
    this.#tick += 1;
    const wanted = [];
    if (this.opened) {
      const { chosen, unknown } = select(this.space, this.tree, camera, this.#view, this.#tick);
      this.#chosen = chosen;
      for (const node of unknown) wanted.push({ key: `page ${node.name}`, node, read: () => this.#page(node) });
      for (const { node, take } of chosen) {
        const have = node.data?.count ?? 0;
        const to = this.space.prefixes ? enoughFor(take, node.points) : node.points;
        if (have < Math.min(take, node.points)) {
          wanted.push({ key: `points ${node.name}`, node, read: signal => this.#points(node, have, to, signal) });
        } else if (have > 0 && node.data.by !== this.by) {
          wanted.push({ key: `colors ${node.name} ${this.by}`, node, read: signal => this.#colors(node, signal) });
        }
      }
    } else {
      wanted.push({ key: 'page r', node: this.tree, read: () => this.#page(this.tree) });
    }
    this.#evict();
    this.#ask(wanted);
    this.#compose(wanted.length === 0);
    this.#tell(wanted);
  }

  #ask(wanted) {
    const keys = new Set(wanted.map(({ key }) => key));
    for (const [key, { controller }] of this.#inFlight) {
      if (keys.has(key) && !this.#resting) continue;
      controller.abort();
      this.#inFlight.delete(key);
    }
    if (this.#resting) return;
    let next = Infinity;
    for (const task of wanted) {
      if (this.#inFlight.size >= MOST_REQUESTS) break;
      if (this.#inFlight.has(task.key)) continue;
      const failed = this.#failures.get(task.key);
      if (failed && failed.times > this.pauses.length) continue;
      if (failed && failed.until > Date.now()) {
        next = Math.min(next, failed.until);
        continue;
      }
      this.#start(task);
    }
    clearTimeout(this.#wakeUp);
    if (next < Infinity) this.#wakeUp = setTimeout(() => this.#update(), next - Date.now() + 10);
  }

  async #start(task) {
    const controller = new AbortController();
    const mine = { controller };
    this.#inFlight.set(task.key, mine);
    try {
      await task.read(controller.signal);
      this.#failures.delete(task.key);
    } catch (error) {
      if (controller.signal.aborted || this.#ended) return;
      if (error.status === 410 || error.status === 404) this.post({ type: 'replaced' });
      else if (error.status === 401 || error.status === 403) this.post({ type: 'refused', why: error.message });
      const times = (this.#failures.get(task.key)?.times ?? 0) + 1;
      const pause = this.pauses[times - 1] ?? Infinity;
      this.#failures.set(task.key, { times, until: Date.now() + pause, why: error.message });
    } finally {
      if (this.#inFlight.get(task.key) === mine) this.#inFlight.delete(task.key);
      if (!this.#ended && !controller.signal.aborted) this.#update();
    }
  }

  async #get(path, query, signal) {
    this.requests += 1;
    const parameters = new URLSearchParams({ ...query, revision: this.description.revision });
    const answer = await this.fetch(`${this.root}/${path}?${parameters}`, { signal });
    if (!answer.ok) {
      const text = await answer.text().catch(() => '');
      let why = text;
      try { why = JSON.parse(text).error ?? text; } catch { /* no JSON: a proxy's words */ }
      throw Object.assign(new Error(why.slice(0, 300) || `HTTP ${answer.status}`), { status: answer.status });
    }
    const bytes = new Uint8Array(await answer.arrayBuffer());
    this.bytes += bytes.length;
    return bytes;
  }

  // Pages are small, and needed wherever one looks next: they are not called off.
  async #page(node) {
    const bytes = await this.#get(`pages/${node.name}`, {}, undefined);
    this.#nodes += readPage(node, bytes) - 1;
    this.#pages.push(node);
    this.opened = true;
  }

  async #points(node, from, to, signal) {
    const { by } = this;
    const bytes = await this.#get(`nodes/${node.name}`, { from, to, by }, signal);
    node.data ??= new Points(node.points);
    if (node.data.count !== from || bytes.length === 0) throw new Error('the points of a node do not fit');
    this.#kept -= node.data.count;
    node.data.append(bytes, from === 0 || node.data.by === by ? by : null);
    this.#kept += node.data.count;
    this.#withPoints.add(node);
  }

  async #colors(node, signal) {
    const { by } = this;
    const bytes = await this.#get(`nodes/${node.name}`, { from: 0, to: node.data.count, by, colors: true }, signal);
    node.data.recolor(bytes, by);
  }

  // What was not looked at for longest goes, where there is too much.
  #evict() {
    const most = Math.max(LEAST_KEPT, KEPT * this.#view.budget);
    if (this.#kept > most) {
      const idle = [...this.#withPoints].filter(node => node.seen < this.#tick).sort((a, b) => a.seen - b.seen);
      for (const node of idle) {
        if (this.#kept <= most) break;
        this.#kept -= node.data.count;
        node.data = null;
        this.#withPoints.delete(node);
      }
    }
    if (this.#nodes > MOST_NODES) this.#forgetPages();
  }

  // Pages below nodes that are out of sight are read again when somebody looks there.
  #forgetPages() {
    const gone = node => {
      for (const child of Object.values(node.children ?? [])) {
        this.#nodes -= 1;
        if (child.data) this.#kept -= child.data.count;
        this.#withPoints.delete(child);
        gone(child);
      }
      node.children = null;
    };
    this.#pages = this.#pages.filter(node => {
      if (node === this.tree || node.seen === this.#tick) return true;
      if (node.children) gone(node);
      return false;
    });
  }

  #compose(isComplete) {
    const signature = this.#chosen.map(({ node, take }) => `${node.name}:${Math.min(take, node.data?.count ?? 0)}:${node.data?.by}`).join()
      + [this.#view.top, this.#view.bottom];
    if (signature === this.#composed) return;
    const wait = Math.max(PACE, 3 * this.#took) - (Date.now() - this.#last);
    if (wait > 0 && !isComplete) {
      this.#timer ??= setTimeout(() => {
        this.#timer = null;
        this.#update();
      }, wait);
      return;
    }
    clearTimeout(this.#timer);
    this.#timer = null;
    const start = Date.now();
    const { center, top, bottom } = this.#view;
    const scene = compose(this.space, this.#chosen, center, top, bottom);
    // Before there is anything, nothing is shown rather than an empty picture.
    if (scene.count === 0 && !isComplete) return;
    this.#composed = signature;
    this.#scene = scene;
    this.#last = Date.now();
    this.#took = this.#last - start;
    const { count, reach, largest } = scene;
    this.post({ type: 'scene', scene: { buffer: scene.buffer.slice(0, 16 * count), count, center, reach, largest, nodes: scene.drawn.length } });
  }

  #tell(wanted) {
    const given = wanted.filter(({ key }) => (this.#failures.get(key)?.times ?? 0) > this.pauses.length);
    const failing = wanted.find(({ key }) => this.#failures.has(key));
    this.post({
      type: 'status',
      pending: wanted.length - given.length,
      failed: given.length,
      why: failing ? this.#failures.get(failing.key).why : null,
      kept: this.#kept,
      bytes: this.bytes,
      requests: this.requests,
      settled: this.opened && wanted.length === given.length && this.#timer === null,
    });
  }
}
