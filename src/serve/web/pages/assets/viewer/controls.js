// Mouse, touch and keys: what they do to the shot. Lengths are in pixels of the page.
import { cameraOf, focal, looked, plus, rayOf, turned, zoomed } from './camera.js';

// Further than this a press is a drag.
const SLIP = 5;
// How long what was found under the pointer counts for the wheel, in milliseconds.
const ANCHORED = 400;
const WALKING = { KeyW: [0, 0, 1], KeyS: [0, 0, -1], KeyA: [-1, 0, 0], KeyD: [1, 0, 0], KeyE: [0, 1, 0], KeyQ: [0, -1, 0] };
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

export class Controls {
  #pointers = new Map();
  #slipped = false;
  #pinch = null;
  #anchor = null;
  #keys = new Set();
  #stepping = null;

  // `view` has `shot`, `walks`, `size()`, `move(shot)`, `hit(pixel)`, and what presses mean:
  // `pressed(pixel)`, `focused(pixel)`, `command(name)`.
  constructor(canvas, view) {
    this.canvas = canvas;
    this.view = view;
    canvas.addEventListener('pointerdown', event => this.#down(event));
    canvas.addEventListener('pointermove', event => this.#drag(event));
    for (const kind of ['pointerup', 'pointercancel']) canvas.addEventListener(kind, event => this.#up(event));
    canvas.addEventListener('contextmenu', event => event.preventDefault());
    canvas.addEventListener('wheel', event => this.#wheel(event), { passive: false });
    canvas.addEventListener('dblclick', event => view.focused(this.#at(event)));
    canvas.addEventListener('keydown', event => this.#key(event));
    canvas.addEventListener('keyup', event => this.#keys.delete(event.code));
    canvas.addEventListener('blur', () => this.#keys.clear());
  }

  #at({ clientX, clientY }) {
    const { left, top } = this.canvas.getBoundingClientRect();
    return [clientX - left, clientY - top];
  }

  #down(event) {
    this.canvas.focus({ preventScroll: true });
    this.canvas.setPointerCapture(event.pointerId);
    if (this.#pointers.size === 0) this.#slipped = false;
    const at = this.#at(event);
    this.#pointers.set(event.pointerId, { at, start: at });
    this.#pinch = this.#pinched();
    if (this.#pointers.size === 2) this.#slipped = true;
    this.#find(at);
  }

  // Between two fingers: their middle, and how far apart they are.
  #pinched() {
    const [a, b] = [...this.#pointers.values()].map(({ at }) => at);
    if (!b) return null;
    return { middle: [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2], apart: Math.hypot(a[0] - b[0], a[1] - b[1]) };
  }

  #drag(event) {
    const pointer = this.#pointers.get(event.pointerId);
    if (!pointer) return;
    const at = this.#at(event);
    const [dx, dy] = [at[0] - pointer.at[0], at[1] - pointer.at[1]];
    if (!this.#slipped && Math.hypot(at[0] - pointer.start[0], at[1] - pointer.start[1]) < SLIP) return;
    this.#slipped = true;
    pointer.at = at;
    const { view } = this;
    if (this.#pointers.size >= 2) {
      const [before, now] = [this.#pinch, this.#pinched()];
      this.#pinch = now;
      if (!before || !now) return;
      this.#pan(now.middle[0] - before.middle[0], now.middle[1] - before.middle[1]);
      if (now.apart > 0 && before.apart > 0) this.#zoom(before.apart / now.apart, now.middle);
    } else if (event.buttons & 6 || event.shiftKey || event.ctrlKey) {
      this.#pan(dx, dy);
    } else {
      const [width, height] = view.size();
      const turn = Math.PI / Math.min(width, height);
      view.move(view.walks ? looked(view.shot, dx * turn / 2, -dy * turn / 2) : turned(view.shot, -dx * turn, dy * turn));
    }
  }

  #up(event) {
    const pointer = this.#pointers.get(event.pointerId);
    this.#pointers.delete(event.pointerId);
    this.#pinch = this.#pinched();
    if (pointer && !this.#slipped && event.type === 'pointerup' && event.button === 0) this.view.pressed(pointer.start);
  }

  // What lies under a pixel, for zooming to it and dragging by it; known a little later.
  async #find(pixel) {
    const anchor = { pixel, until: Infinity, away: null };
    this.#anchor = anchor;
    const hit = await this.view.hit(pixel);
    const { shot } = this.view;
    const camera = cameraOf(shot);
    if (hit) anchor.away = camera.forward.reduce((sum, c, i) => sum + c * (hit.position[i] - camera.eye[i]), 0);
    anchor.until = performance.now() + ANCHORED;
  }

  // How far away, along the view, what is moved lies.
  #away() {
    return this.#anchor?.away > 0 ? this.#anchor.away : this.view.shot.distance;
  }

  #pan(dx, dy) {
    const { shot } = this.view;
    const camera = cameraOf(shot);
    const step = this.#away() / focal(...this.view.size());
    const target = plus(plus(shot.target, camera.right, -dx * step), camera.up, dy * step);
    this.view.move({ ...shot, target });
  }

  #zoom(factor, pixel) {
    const { shot } = this.view;
    const camera = cameraOf(shot);
    const anchor = plus(camera.eye, rayOf(camera, pixel, this.view.size()), this.#away());
    if (this.#anchor?.away > 0) this.#anchor.away *= factor;
    this.view.move(zoomed(shot, anchor, factor));
  }

  #wheel(event) {
    event.preventDefault();
    const pixel = this.#at(event);
    const lines = event.deltaMode === 1 ? 20 : event.deltaMode === 2 ? 400 : 1;
    const turns = Math.max(-240, Math.min(240, event.deltaY * lines)) * (event.ctrlKey ? 4 : 1);
    const anchor = this.#anchor;
    const moved = !anchor || Math.hypot(pixel[0] - anchor.pixel[0], pixel[1] - anchor.pixel[1]) > SLIP;
    if (moved || performance.now() > anchor.until) this.#find(pixel);
    if (this.view.walks) this.#walk([0, 0, -turns / 800]);
    else this.#zoom(Math.exp(turns * 0.0015), pixel);
  }

  // Steps to the right, up and forward, in distances.
  #walk([right, up, forward]) {
    const { shot } = this.view;
    const camera = cameraOf(shot);
    const target = plus(plus(shot.target, camera.right, right * shot.distance), camera.forward, forward * shot.distance);
    this.view.move({ ...shot, target: plus(target, [0, 0, 1], up * shot.distance) });
  }

  #key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const { view } = this;
    const arrow = ARROWS[event.key];
    const [width, height] = view.size();
    const commands = { Home: 'home', t: 'top', T: 'top', g: 'walk', G: 'walk', m: 'measure', M: 'measure', Escape: 'escape' };
    if (arrow || (view.walks && WALKING[event.code])) {
      this.#shift = event.shiftKey;
      // At once, so that a short press is a small step.
      if (!this.#keys.has(event.code)) this.#held(event.code, 0.05);
      this.#keys.add(event.code);
      this.#step();
    } else if (event.key === '+' || event.key === '=' || event.key === '-') {
      this.#anchor = null;
      if (view.walks) this.#walk([0, 0, event.key === '-' ? -0.3 : 0.3]);
      else this.#zoom(event.key === '-' ? 1.2 : 1 / 1.2, [width / 2, height / 2]);
    } else if (event.key === 'Enter') {
      view.pressed([width / 2, height / 2]);
    } else if (commands[event.key]) {
      view.command(commands[event.key]);
    } else {
      return;
    }
    event.preventDefault();
  }

  #shift = false;

  // Goes on while keys are held.
  #step(before = performance.now()) {
    if (this.#stepping !== null) return;
    this.#stepping = requestAnimationFrame(now => {
      this.#stepping = null;
      if (this.#keys.size === 0) return;
      const seconds = Math.min(0.1, Math.max(0.016, (now - before) / 1000));
      for (const code of this.#keys) this.#held(code, seconds);
      this.#step(now);
    });
  }

  #held(code, seconds) {
    const { view } = this;
    const arrow = ARROWS[code];
    if (view.walks && WALKING[code]) {
      this.#walk(WALKING[code].map(c => c * seconds));
    } else if (arrow && this.#shift) {
      this.#anchor = null;
      this.#pan(-arrow[0] * 400 * seconds, arrow[1] * 400 * seconds);
    } else if (arrow) {
      const [turn, rise] = arrow.map(c => c * seconds);
      view.move(view.walks ? looked(view.shot, -turn, -rise) : turned(view.shot, turn, rise));
    }
  }
}
