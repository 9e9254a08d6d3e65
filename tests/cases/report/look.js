// Looks at every drawing of the page as it is laid out, and writes down what is
// wrong: texts on texts, anything outside of its drawing, drawings without marks.
const faults = [];
const say = (what, where) => faults.push(`${what} (${where})`);
const words = (text) => JSON.stringify(text.textContent.slice(0, 40));
let texts = 0;
for (const svg of document.querySelectorAll('svg.chart')) {
  const name = svg.getAttribute('aria-label');
  const box = svg.getBoundingClientRect();
  if (box.width < 100 || box.height < 50) say(`drawn ${box.width} by ${box.height}`, name);
  // A pixel of the drawing, as large as it is shown.
  const unit = box.width / svg.viewBox.baseVal.width;
  const boxes = [...svg.querySelectorAll('text')].map((text) => [text, text.getBoundingClientRect()]);
  texts += boxes.length;
  for (const [text, at] of boxes) {
    if (!(at.width > 0)) say(`an empty text`, name);
    for (const [other, by] of boxes) {
      if (other === text) break;
      const wide = Math.min(at.right, by.right) - Math.max(at.left, by.left);
      const high = Math.min(at.bottom, by.bottom) - Math.max(at.top, by.top);
      if (wide > unit && high > unit) say(`${words(text)} lies on ${words(other)}`, name);
    }
  }
  for (const part of svg.querySelectorAll('text,path,rect,circle')) {
    const at = part.getBoundingClientRect();
    const out = Math.max(box.left - at.left, at.right - box.right, box.top - at.top, at.bottom - box.bottom);
    if (!(out <= unit / 2)) say(`${part.outerHTML.slice(0, 80)} is ${out} outside`, name);
  }
  if (!svg.querySelector('.mark,.line,.bar,.dots') && !svg.textContent.includes('Nothing was measured')) {
    say('no marks', name);
  }
}
for (const figure of document.querySelectorAll('figure')) {
  if (!figure.querySelector('svg.chart')) say('a figure without a drawing', figure.textContent.slice(0, 40));
}
if (document.documentElement.scrollWidth > innerWidth) {
  say(`the page is ${document.documentElement.scrollWidth} wide in a window of ${innerWidth}`, 'page');
}
const colour = (selector, what) => {
  const found = document.querySelector(selector);
  return found ? getComputedStyle(found)[what] : '';
};
const seen = document.createElement('script');
seen.type = 'application/json';
seen.id = 'seen';
seen.textContent = JSON.stringify({
  faults,
  drawings: document.querySelectorAll('svg.chart').length,
  texts,
  paper: colour('body', 'backgroundColor'),
  mark: colour('.chart .mark', 'fill'),
}).replaceAll('<', '\\u003c');
document.body.append(seen);
