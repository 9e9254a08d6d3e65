// Points that were picked, as marks over the picture, and what is known of them.
import { pixelOf } from './camera.js';

const SVG = 'http://www.w3.org/2000/svg';
const make = (name, parent, text) => {
  const element = document.createElement(name);
  if (text !== undefined) element.textContent = text;
  parent.append(element);
  return element;
};

export class Marks {
  #points = [];
  #svg = document.querySelector('#marks');
  #box = document.querySelector('#picked');
  #text = document.querySelector('#picked-text');

  // `ask` gives all that is known of a point, by its node and place.
  constructor(description, ask) {
    this.description = description;
    this.ask = ask;
    this.measures = false;
  }

  clear() {
    this.#points = [];
    this.#box.hidden = true;
    this.#svg.replaceChildren();
  }

  // A point was picked: by itself, or as an end of a distance.
  async add(hit) {
    const point = { ...hit, known: null };
    if (this.measures && this.#points.length === 1) this.#points.push(point);
    else this.#points = [point];
    this.#tell();
    try {
      point.known = await this.ask(hit);
    } catch (error) {
      point.error = error.message;
    }
    if (this.#points.includes(point)) this.#tell();
  }

  // World coordinates, exact once they are known.
  #coordinates(point) {
    return point.known?.position ?? point.position.map((c, i) => c / this.description.unit[i]);
  }

  #number(value, axis) {
    return value.toFixed(this.description.decimals[axis]);
  }

  #tell() {
    const [first, second] = this.#points;
    this.#text.replaceChildren();
    this.#box.hidden = !first;
    if (!first) return;
    if (second) this.#tellDistance(first, second);
    else this.#tellPoint(first);
  }

  #tellDistance(first, second) {
    const { unit } = this.description;
    const [a, b] = [first, second].map(point => this.#coordinates(point).map((c, i) => c * unit[i]));
    const d = b.map((c, i) => c - a[i]);
    const digits = Math.min(3, Math.max(...this.description.decimals));
    const list = make('dl', this.#text);
    const row = (name, value) => {
      make('dt', list, name);
      make('dd', list, value.toFixed(digits));
    };
    row('Distance', Math.hypot(...d));
    row('Across', Math.hypot(d[0], d[1]));
    row('Up', d[2]);
    if (unit[0] !== 1) make('p', this.#text, 'in meters; the cloud itself counts in degrees').className = 'dim';
  }

  #tellPoint(point) {
    const list = make('dl', this.#text);
    this.#coordinates(point).forEach((value, axis) => {
      make('dt', list, 'xyz'[axis]);
      make('dd', list, this.#number(value, axis));
    });
    // The picture is to be seen while its other end is looked for.
    for (const { name, value } of this.measures ? [] : point.known?.attributes ?? []) {
      make('dt', list, name);
      make('dd', list, [value].flat().map(one => (typeof one === 'number' && !Number.isInteger(one) ? Number(one.toPrecision(12)) : one)).join(', '));
    }
    if (point.error) make('p', this.#text, `Its attributes could not be loaded: ${point.error}`);
    if (this.measures) make('p', this.#text, 'Pick the other end.').className = 'dim';
  }

  // Over a picture of this camera, in pixels of the page.
  draw(camera, size) {
    const places = this.#points.map(({ position }) => pixelOf(camera, position, size));
    const shapes = places.filter(Boolean).map(([x, y]) => {
      const circle = document.createElementNS(SVG, 'circle');
      for (const [name, value] of Object.entries({ cx: x, cy: y, r: 6 })) circle.setAttribute(name, value);
      return circle;
    });
    if (places.length === 2 && places.every(Boolean)) {
      const line = document.createElementNS(SVG, 'line');
      const [[x1, y1], [x2, y2]] = places;
      for (const [name, value] of Object.entries({ x1, y1, x2, y2 })) line.setAttribute(name, value);
      shapes.unshift(line);
    }
    this.#svg.replaceChildren(...shapes);
  }
}
