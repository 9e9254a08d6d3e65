// The viewer: joins what is seen, what is asked for, and what is drawn.
import { between, cameraOf, dot, plus, shotFromText, shotToText } from './camera.js';
import { Controls } from './controls.js';
import { fallBack } from './fallback.js';
import { SHADING } from './frame.js';
import { Gpu, NoWebGpu } from './gpu.js';
import { Marks } from './marks.js';
import { Panel } from './panel.js';

const $ = id => document.querySelector(`#${id}`);
const { data: root, name } = document.body.dataset;
const calm = matchMedia('(prefers-reduced-motion: reduce)');
// Pixels between neighboring points.
const SPACING = 1;
// A frame takes at most so long while one moves, in milliseconds, or it gets fewer pixels.
const SMOOTH = 45;
const COARSEST = 0.25;
// How long after a move the picture is drawn in full.
const SETTLES = 160;
// How often it is asked whether the octree is still the same, in milliseconds.
const ASKS = 30_000;
// How often a lost GPU is opened again.
const MOST_LOSSES = 3;
const FOUND_WITHIN = 8;

const canvas = $('picture');
let description = null;
let gpu = null;
let losses = 0;
let worker = null;
let scene = null;
let shot = null;
let walks = false;
let settled = false;
let flight = null;
let movedAt = -Infinity;
let coarseness = 1;
let frames = { drawing: false, wanted: false, took: 0 };
let status = {};
// What the last picture shows.
let painted = null;
const hits = new Map();

const panel = new Panel(changed);
let marks = null;

function options() {
  return Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
}

const size = () => [Math.max(1, canvas.clientWidth), Math.max(1, canvas.clientHeight)];

// Pixels of the picture: those of the screen, as many as the GPU has room for.
function pixels() {
  const [width, height] = size();
  const dense = Math.min(devicePixelRatio || 1, Math.sqrt(gpu.mostPixels / (width * height)));
  return [Math.max(1, Math.floor(width * dense)), Math.max(1, Math.floor(height * dense))];
}

async function describe() {
  const [width, height] = size();
  const answer = await fetch(`${root}/view?width=${Math.round(width)}&height=${Math.round(height)}`, { cache: 'no-cache' });
  const body = await answer.json().catch(() => ({}));
  if (!answer.ok) throw Object.assign(new Error(body.error ?? `the daemon answers ${answer.status}`), { status: answer.status });
  return body;
}

// Opens the octree that stands there now.
async function open(before = options()) {
  description = await describe();
  const number = text => (text === undefined || text === '' ? undefined : Number(text));
  panel.describe(description, { by: before.by, low: number(before.low), high: number(before.high) });
  shot = shotFromText(before.view) ?? description.start;
  setWalking(before.walk === '1' && Boolean(before.view));
  marks = new Marks(description, known);
  marks.clear();
  scene = null;
  worker?.terminate();
  worker = new Worker(new URL('./worker.js', import.meta.url), { type: 'module' });
  worker.addEventListener('message', heard);
  worker.addEventListener('error', event => panel.trouble(`The viewer cannot load points: ${event.message ?? 'its worker did not start'}`));
  worker.postMessage({ type: 'open', root: new URL(root, location.href).href, description, by: panel.by });
  panel.say('Loading…');
  look();
}

function heard({ data }) {
  if (data.revision && data.revision !== description.revision) return;
  if (data.type === 'scene') {
    scene = data.scene;
    draw();
  } else if (data.type === 'status') {
    status = data;
    tell();
  } else if (data.type === 'picked') {
    hits.get(data.id)?.(data.hit);
    hits.delete(data.id);
  } else if (data.type === 'replaced') {
    replaced();
  } else if (data.type === 'refused') {
    panel.trouble(`The daemon does not let you see this any more: ${data.why}`);
  }
}

let replacing = false;
async function replaced() {
  if (replacing) return;
  replacing = true;
  try {
    const stays = options();
    stays.view = shotToText(shot);
    await open(stays);
    panel.trouble('This cloud was replaced by a newer one. You see the new one.');
  } catch (error) {
    worker?.terminate();
    panel.trouble(error.status === 404
      ? 'This cloud is not there any more: it was removed, or the link was taken back.'
      : `The cloud changed, and the new one cannot be opened: ${error.message}`, () => replaced());
  } finally {
    replacing = false;
  }
}

async function stillThere() {
  if (document.hidden || replacing || !description) return;
  try {
    const now = await describe();
    if (now.revision !== description.revision) await replaced();
  } catch (error) {
    if (error.status === 404) await replaced();
  }
}

function tell() {
  const [done, mega] = [status.settled, bytes => (bytes / 1e6).toFixed(bytes < 1e7 ? 1 : 0)];
  settled = done;
  document.body.dataset.settled = String(Boolean(done && painted && painted.scene === scene && painted.shot === shot && painted.whole));
  document.body.dataset.requests = String(status.requests);
  document.body.dataset.bytes = String(status.bytes);
  if (scene && scene.count === 0 && done) panel.say('Nothing is to be seen from here.');
  else if (!done) panel.say(scene ? 'Loading finer points…' : 'Loading…');
  else panel.say('');
  if (status.failed > 0) {
    const parts = status.failed === 1 ? 'One part of the cloud' : `${status.failed} parts of the cloud`;
    panel.trouble(`${parts} could not be loaded: ${status.why}.`, () => worker.postMessage({ type: 'retry' }));
  } else if (status.why && status.pending > 0) {
    panel.say(`Trying again: ${status.why}`);
  }
  const count = scene ? scene.count.toLocaleString('en') : '0';
  panel.stats(`${count} of ${description.points.toLocaleString('en')} points in ${scene?.nodes ?? 0} nodes; `
    + `${mega(status.bytes)} MB loaded; a picture takes ${Math.round(frames.took)} ms${gpu?.isSoftware ? ' by software' : ''}`);
}

const moves = () => performance.now() - movedAt < SETTLES || flight !== null;

// Tells the worker where one looks; not more often than it can follow.
let looking = null;
function look() {
  looking ??= setTimeout(() => {
    looking = null;
    if (!gpu || !worker) return;
    const [top, bottom] = [panel.topHeight, panel.bottomHeight];
    const view = { camera: cameraOf(shot), size: pixels(), spacing: SPACING, budget: panel.budget, top, bottom, center: shot.target };
    worker.postMessage({ type: 'look', view });
  }, moves() ? 60 : 0);
}

function move(next) {
  const [low, high] = description.bounds;
  const extent = Math.max(...[0, 1, 2].map(i => high[i] - low[i]), 1e-6);
  // Neither into a point nor so far away that nothing is left.
  const distance = Math.min(Math.max(next.distance, extent * 1e-5), extent * 20);
  const target = next.target.map((c, i) => Math.min(Math.max(c, low[i] - 10 * extent), high[i] + 10 * extent));
  shot = { ...next, distance, target };
  movedAt = performance.now();
  document.body.dataset.settled = 'false';
  draw();
  look();
  clearTimeout(move.later);
  move.later = setTimeout(rest, SETTLES + 20);
}

// After a move: the picture in full, and the address of what is seen.
function rest() {
  draw();
  look();
  remember();
}

function remember() {
  const low = panel.bottomHeight;
  const high = panel.topHeight;
  const kept = { view: shotToText(shot) };
  if (panel.by !== description.colors[0]?.by) kept.by = panel.by;
  if (Number.isFinite(low)) kept.low = Number(low.toPrecision(9));
  if (Number.isFinite(high) && high !== description.ceiling) kept.high = Number(high.toPrecision(9));
  if (walks) kept.walk = 1;
  const hash = `#${new URLSearchParams(kept)}`.replaceAll('%2C', ',');
  if (location.hash !== hash) history.replaceState(null, '', hash);
}

function fly(to) {
  if (calm.matches || document.hidden) {
    flight = null;
    move(to);
    return;
  }
  const mine = { from: shot, to, start: performance.now() };
  flight = mine;
  const step = now => {
    if (flight !== mine) return;
    const share = Math.min(1, Math.max(0, now - mine.start) / 350);
    if (share >= 1) flight = null;
    move(share >= 1 ? to : between(mine.from, to, share * share * (3 - 2 * share)));
    if (share < 1) requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
}

function draw() {
  if (frames.drawing) {
    frames.wanted = true;
    return;
  }
  frames.drawing = true;
  requestAnimationFrame(async () => {
    frames.wanted = false;
    try {
      await paint();
    } catch (error) {
      // Of a device that is gone, which is told by itself.
      if (gpu) fallBack(`the graphics processor failed (${error.message})`);
    } finally {
      frames.drawing = false;
      if (frames.wanted) draw();
    }
  });
}

async function paint() {
  if (!gpu || !scene) return;
  const [width, height] = pixels();
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  const share = moves() ? coarseness : 1;
  const drawn = [width, height].map(side => Math.max(16, Math.round(side * share)));
  const shading = { ...SHADING, edl: panel.lighting ? SHADING.edl : 0 };
  const camera = cameraOf(shot);
  const start = performance.now();
  const shown = { scene, shot, whole: share === 1 };
  const done = gpu.draw(canvas, scene, camera, drawn, shading, panel.pointSize);
  marks.draw(camera, size());
  await done;
  painted = shown;
  frames.took = performance.now() - start;
  document.body.dataset.frames = String(Number(document.body.dataset.frames ?? 0) + 1);
  document.body.dataset.took = frames.took.toFixed(1);
  if (moves()) {
    if (frames.took > SMOOTH) coarseness = Math.max(COARSEST, coarseness * 0.8);
    else if (frames.took < SMOOTH / 2) coarseness = Math.min(1, coarseness * 1.15);
  } else if (description && status.settled !== undefined) {
    tell();
  }
}

// What is seen at a pixel of the page; nothing after a while without an answer.
let asked = 0;
function hit(pixel) {
  const id = asked += 1;
  const dense = pixels()[0] / size()[0];
  return new Promise(resolve => {
    hits.set(id, resolve);
    worker.postMessage({ type: 'pick', id, pixel: pixel.map(c => c * dense), radius: FOUND_WITHIN * dense });
  });
}

async function known({ node, place }) {
  const answer = await fetch(`${root}/nodes/${node}/points/${place}?revision=${description.revision}`);
  const body = await answer.json().catch(() => ({}));
  if (!answer.ok) throw new Error(body.error ?? `the daemon answers ${answer.status}`);
  return body;
}

function setWalking(on) {
  const was = walks;
  walks = on;
  $('walk').setAttribute('aria-pressed', String(on));
  if (!on || was || !shot) return;
  // Steps that suit a person in the cloud: the eye stays where it is.
  const [low, high] = description.bounds;
  const extent = Math.max(...[0, 1, 2].map(i => high[i] - low[i]));
  const distance = Math.min(shot.distance, Math.max(extent * 0.03, 1e-3));
  const { eye, forward } = cameraOf(shot);
  shot = { ...shot, target: plus(eye, forward, distance), distance };
}

async function walk(on) {
  setWalking(on);
  if (!on) {
    // What lies in the middle is what one turns around from now on.
    const found = await hit(size().map(side => side / 2));
    if (found && !walks) {
      const { eye, forward } = cameraOf(shot);
      const away = dot(forward, plus(found.position, eye, -1));
      if (away > 0) shot = { ...shot, target: plus(eye, forward, away), distance: away };
    }
  }
  remember();
}

const commands = {
  home: () => {
    setWalking(false);
    describe().then(({ start }) => fly(start), () => fly(description.start));
  },
  top: () => fly({ ...shot, ...middle(), azimuth: -Math.PI / 2, elevation: Math.PI / 2 }),
  walk: () => walk(!walks),
  measure: () => measure(!marks.measures),
  escape: () => {
    measure(false);
    marks.clear();
    draw();
  },
};

// The middle of what is turned around: of one's own choice, or the whole.
function middle() {
  if (!walks) return {};
  setWalking(false);
  const { target, distance } = description.start;
  return { target, distance };
}

function measure(on) {
  marks.measures = on;
  $('measure').setAttribute('aria-pressed', String(on));
  if (on) {
    marks.clear();
    panel.say('Pick two points.');
  }
  draw();
}

const controls = {
  get shot() { return shot; },
  get walks() { return walks; },
  size,
  move: next => {
    flight = null;
    move(next);
  },
  hit,
  pressed: async pixel => {
    const found = await hit(pixel);
    if (found) await marks.add(found);
    else if (!marks.measures) marks.clear();
    draw();
  },
  focused: async pixel => {
    const found = await hit(pixel);
    if (!found) return;
    const { eye } = cameraOf(shot);
    const away = Math.hypot(...plus(found.position, eye, -1));
    setWalking(false);
    fly({ ...shot, target: found.position, distance: away * 0.4 });
  },
  command: command => commands[command]?.(),
};

function changed(what) {
  if (!description) return;
  if (what === 'by') {
    panel.tellColors();
    worker.postMessage({ type: 'color', by: panel.by });
  }
  document.body.dataset.settled = 'false';
  draw();
  look();
  remember();
}

function lost(why) {
  gpu = null;
  losses += 1;
  if (losses > MOST_LOSSES) {
    fallBack(`the graphics processor was lost again and again (${why || 'the browser does not say why'})`);
    return;
  }
  panel.trouble('The graphics processor was lost; it is opened again.');
  setTimeout(async () => {
    try {
      // A canvas belongs to the device that drew on it last.
      gpu = await Gpu.open(lost);
      draw();
    } catch (error) {
      fallBack(error.message);
    }
  }, 500 * losses);
}

function wire() {
  new Controls(canvas, controls);
  for (const button of document.querySelectorAll('[data-view]')) button.addEventListener('click', () => commands[button.dataset.view]());
  $('side').addEventListener('change', ({ target }) => {
    if (target.value !== '') fly({ ...shot, ...middle(), azimuth: Number(target.value) * Math.PI / 180, elevation: 0.1 });
    target.value = '';
  });
  $('walk').addEventListener('click', () => {
    walk(!walks);
    canvas.focus();
  });
  $('measure').addEventListener('click', () => measure(!marks.measures));
  $('picked-close').addEventListener('click', () => {
    marks.clear();
    draw();
    canvas.focus();
  });
  $('copy-link').addEventListener('click', async () => {
    remember();
    try {
      await navigator.clipboard.writeText(location.href);
      panel.say('The link is copied.');
    } catch {
      panel.say('The link is in the address bar.');
    }
  });
  $('save').addEventListener('click', save);
  new ResizeObserver(() => {
    draw();
    look();
  }).observe(canvas);
  document.addEventListener('visibilitychange', () => {
    worker?.postMessage({ type: 'rest', resting: document.hidden });
    if (!document.hidden) {
      draw();
      stillThere();
    }
  });
  addEventListener('hashchange', () => {
    const to = shotFromText(options().view);
    if (to) fly(to);
  });
  setInterval(stillThere, ASKS);
}

async function save() {
  movedAt = -Infinity;
  const done = paint();
  // A GPU's canvas holds its picture until the browser shows it, the other from then on.
  if (gpu?.isSoftware) await done;
  const blob = await new Promise(resolve => canvas.toBlob(resolve, 'image/png'));
  await done;
  if (!blob) return;
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = `${name}.png`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

async function start() {
  document.body.dataset.mode = 'drawing';
  try {
    gpu = await Gpu.open(lost);
  } catch (error) {
    await fallBack(error instanceof NoWebGpu ? error.message : `the graphics processor cannot be used (${error.message})`);
    return;
  }
  const { budget } = options();
  panel.budget = budget ?? (gpu.isSoftware ? 200_000 : matchMedia('(pointer: coarse)').matches ? 500_000 : 1_000_000);
  if (!panel.budget) panel.budget = 1_000_000;
  try {
    await open();
  } catch (error) {
    panel.say('');
    panel.trouble(`The cloud cannot be opened: ${error.message}`, () => location.reload());
    return;
  }
  wire();
}

start();
