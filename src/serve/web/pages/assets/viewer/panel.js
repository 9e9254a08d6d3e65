// The settings, the legend, and what is said beside the picture.

const $ = id => document.querySelector(`#${id}`);
const STEPS = 1000;

export class Panel {
  // `changed` is told after any setting is another.
  constructor(changed) {
    this.changed = changed;
    const toggle = $('panel-toggle');
    toggle.addEventListener('click', () => this.#open($('panel').hidden));
    $('panel').addEventListener('keydown', event => {
      if (event.key !== 'Escape') return;
      this.#open(false);
      toggle.focus();
    });
    for (const id of ['by', 'budget', 'lighting']) $(id).addEventListener('change', () => changed(id));
    for (const id of ['point-size', 'low', 'high']) $(id).addEventListener('input', () => {
      if (id !== 'point-size') this.#slice(id);
      changed(id);
    });
    $('slice-off').addEventListener('click', () => {
      [$('low').value, $('high').value] = [0, STEPS];
      this.#tellSlice();
      changed('high');
    });
    $('trouble-close').addEventListener('click', () => { $('trouble').hidden = true; });
    // Wide screens have room for it.
    if (matchMedia('(min-width: 60rem)').matches) this.#open(true);
  }

  #open(open) {
    $('panel').hidden = !open;
    $('panel-toggle').setAttribute('aria-expanded', String(open));
  }

  // For an octree; settings that it has too stay as they are.
  describe(description, { by, low, high } = {}) {
    this.description = description;
    const [bottom, top] = [description.bounds[0][2], description.bounds[1][2]];
    this.bottom = bottom;
    this.range = Math.max(top - bottom, Number.MIN_VALUE);
    $('by').replaceChildren(...description.colors.map(({ by: value, label }) => new Option(label, value)));
    if (description.colors.some(one => one.by === by)) $('by').value = by;
    const ceiling = description.ceiling === null ? null : (description.ceiling - bottom) / this.range * STEPS;
    $('low').value = low === undefined ? 0 : (low - bottom) / this.range * STEPS;
    $('high').value = high !== undefined ? (high - bottom) / this.range * STEPS : ceiling ?? STEPS;
    // The very height, until the slider is moved.
    this.exact = { low, high: high ?? description.ceiling ?? undefined };
    this.#tellSlice();
    this.tellColors();
  }

  #slice(moved) {
    const [low, high] = [Number($('low').value), Number($('high').value)];
    if (low > high) $(moved === 'low' ? 'high' : 'low').value = moved === 'low' ? low : high;
    this.exact = {};
    this.#tellSlice();
  }

  #tellSlice() {
    if (Number($('high').value) === STEPS && Number($('low').value) === 0) this.exact = {};
    const text = value => (value / this.description.unit[2]).toFixed(Math.min(2, this.description.decimals[2]));
    for (const id of ['low', 'high']) {
      const value = this.bottom + Number($(id).value) / STEPS * this.range;
      $(`${id}-text`).textContent = text(this.exact?.[id] ?? value);
      $(id).setAttribute('aria-valuetext', text(this.exact?.[id] ?? value));
    }
  }

  get by() { return $('by').value || 'auto'; }
  get budget() { return Number($('budget').value); }
  set budget(value) { $('budget').value = String(value); }
  get pointSize() { return Number($('point-size').value); }
  get lighting() { return $('lighting').checked; }

  // World heights; infinite where the slice is open.
  get bottomHeight() {
    const value = Number($('low').value);
    return this.exact?.low ?? (value <= 0 ? -Infinity : this.bottom + value / STEPS * this.range);
  }

  get topHeight() {
    const value = Number($('high').value);
    return this.exact?.high ?? (value >= STEPS ? Infinity : this.bottom + value / STEPS * this.range);
  }

  // What the colors mean.
  tellColors() {
    const { legend, label } = this.description.colors.find(({ by }) => by === this.by) ?? {};
    const box = $('legend');
    box.replaceChildren();
    box.hidden = !legend || legend.kind === 'own';
    if (box.hidden) return;
    const title = document.createElement('strong');
    title.textContent = label;
    box.append(title);
    if (legend.kind === 'gradient') {
      const bar = document.createElement('div');
      bar.className = 'bar';
      bar.style.background = `linear-gradient(to right, ${legend.stops.map(c => `rgb(${c.join(' ')})`).join(', ')})`;
      const ends = document.createElement('div');
      ends.className = 'ends';
      for (const value of [legend.low, legend.high]) {
        const end = document.createElement('span');
        end.textContent = Number(value.toPrecision(6)).toLocaleString('en', { maximumFractionDigits: 3, useGrouping: false });
        ends.append(end);
      }
      box.append(bar, ends);
    } else {
      const list = document.createElement('ul');
      for (const { value, name, color } of legend.classes) {
        const item = document.createElement('li');
        const swatch = document.createElement('i');
        swatch.style.background = `rgb(${color.join(' ')})`;
        item.append(swatch, `${value} ${name}`);
        list.append(item);
      }
      box.append(list);
    }
  }

  say(text) {
    if ($('says').textContent !== text) $('says').textContent = text;
  }

  // Something went wrong; `retry` is offered where it helps.
  trouble(text, retry) {
    $('trouble-text').textContent = text;
    $('trouble').hidden = false;
    $('trouble-retry').hidden = !retry;
    $('trouble-retry').onclick = () => {
      $('trouble').hidden = true;
      retry();
    };
  }

  stats(text) {
    $('stats').textContent = text;
  }
}
