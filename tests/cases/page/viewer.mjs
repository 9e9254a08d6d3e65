// The viewer in Chromium, by WebGPU in software: pictures of several octrees, then one is worked.
// node viewer.mjs CHROMIUM ADDRESS FOLDER NAME HASH [NAME HASH]… ; writes FOLDER/NAME.rgba, .json
import fs from 'node:fs';
import { WEBGPU, axe, check, open, until } from './browser.mjs';

const [program, address, folder, ...clouds] = process.argv.slice(2);
const { browser, context, complaints } = await open(program, {}, WEBGPU);
// Small enough for a processor, and so that the settings lie over the picture and not beside it.
const one = await context({ viewport: { width: 320, height: 300 } });
const page = await one.newPage();
const data = key => page.evaluate(name => document.body.dataset[name], key);
const settled = () => until('a picture that is done', async () => await data('settled') === 'true');
const text = id => page.locator(id).textContent();

let first = null;
for (let at = 0; at < clouds.length; at += 2) {
  const [name, hash] = clouds.slice(at, at + 2);
  await page.goto('about:blank');
  await page.goto(`${address}/view/${name}#view=${hash}`);
  await until('a first picture', async () => Number(await data('frames')) > 0);
  first ??= Number(await data('bytes'));
  await settled();
  const shown = await page.evaluate(() => {
    const canvas = document.querySelector('#picture');
    const { width, height } = canvas;
    const pixels = canvas.getContext('2d').getImageData(0, 0, width, height).data;
    let text = '';
    for (let from = 0; from < pixels.length; from += 8192) text += String.fromCharCode(...pixels.subarray(from, from + 8192));
    return { size: [width, height], pixels: btoa(text), budget: Number(document.querySelector('#budget').value), stats: document.querySelector('#stats').textContent };
  });
  fs.writeFileSync(`${folder}/${name}.rgba`, Buffer.from(shown.pixels, 'base64'));
  fs.writeFileSync(`${folder}/${name}.json`, JSON.stringify({ ...shown, pixels: undefined, took: Number(await data('took')) }));
}

// A camera at rest asks for nothing.
const asked = [];
page.on('request', request => {
  // Whether the octree is still there is asked for now and then; of it, nothing.
  if (/\/(nodes|pages)\//.test(request.url())) asked.push(request.url());
});
const requests = await data('requests');
await page.evaluate(() => new Promise(resolve => setTimeout(resolve, 1200)));
check(await data('requests') === requests && asked.length === 0, `asked at rest: ${asked}`);

// By the keyboard: another view, and its address.
const before = page.url();
await page.locator('#picture').focus();
await page.keyboard.press('ArrowLeft');
await until('another address', () => page.url() !== before);
await settled();
// A point, its coordinates and attributes.
await page.keyboard.press('Enter');
await until('a point', async () => (await text('#picked-text')).includes('intensity'));
check(/x\s*-?\d+\.\d+/.test(await text('#picked-text')), await text('#picked-text'));
// A distance between two.
await page.keyboard.press('m');
const { width, height } = await page.locator('#picture').boundingBox();
for (const [x, y] of [[0.45, 0.5], [0.6, 0.55]]) {
  await page.locator('#picture').click({ position: { x: width * x, y: height * y } });
  await until('a mark', async () => await page.locator('#marks circle').count() > 0);
}
await until('a distance', async () => (await text('#picked-text')).includes('Distance'));
await page.locator('#picture').focus();
await page.keyboard.press('Escape');
check(await page.locator('#picked').isHidden(), 'Escape ends it');
// Another color has a legend; positions are not loaded again.
await page.locator('#panel-toggle').click();
asked.length = 0;
await page.locator('#by').selectOption('height');
await until('other colors', () => asked.length > 0);
await settled();
check(asked.every(url => url.includes('colors=true')), asked.join('\n'));
check(page.url().includes('by=height'), page.url());
check(await page.locator('#legend').textContent() !== '', 'there is a legend');
const found = await axe(page);
check(found.length === 0, found.join('\n'));
// A slice through the middle has fewer points.
const count = async () => Number((await text('#stats')).split(' ')[0].replaceAll(',', ''));
const all = await count();
await page.locator('#high').fill('300');
await until('a slice', async () => await data('settled') === 'true' && await count() < all);
await page.locator('#panel-toggle').click();
// The picture is kept.
const saved = page.waitForEvent('download');
await page.locator('#save').click();
check((await saved).suggestedFilename().endsWith('.png'), 'a PNG');

// Without WebGPU: a sentence, and the turntable where there is one.
await page.addInitScript(() => Object.defineProperty(Navigator.prototype, 'gpu', { get: () => undefined }));
await page.reload();
await until('the turntable', async () => await data('mode') === 'turntable');
check((await text('#fallback-why')).includes('WebGPU'), await text('#fallback-why'));
check(await page.locator('#fallback').isVisible() && await page.locator('#picture').isHidden(), 'no empty picture');

check(complaints.length === 0, complaints.join('\n'));
console.log(`${first} bytes before the first picture`);
await browser.close();
