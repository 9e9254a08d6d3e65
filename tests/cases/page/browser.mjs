// A Chromium that notes all that a page complains about.
import { createRequire } from 'node:module';
import { chromium } from 'playwright-core';

const AXE = createRequire(import.meta.url).resolve('axe-core/axe.min.js');
const FLAGS = ['--no-sandbox', '--disable-quic', '--no-first-run', '--disable-background-networking',
  '--disable-component-update', '--disable-sync', '--disable-dev-shm-usage'];
// WebGPU in software, which Chromium has itself.
export const WEBGPU = ['--enable-unsafe-webgpu', '--use-webgpu-adapter=swiftshader'];

export async function open(program, options = {}, flags = ['--disable-gpu']) {
  const browser = await chromium.launch({ executablePath: program, args: [...FLAGS, ...flags] });
  const complaints = [];
  async function context(more = {}) {
    const one = await browser.newContext({ viewport: { width: 1280, height: 900 }, ...options, ...more });
    // However busy the machine is, what has not come by then does not come.
    one.setDefaultTimeout(180_000);
    one.on('console', message => complaints.push(`console: ${message.text()}`));
    one.on('weberror', error => complaints.push(`error: ${error.error()}`));
    one.on('requestfailed', request => {
      const why = request.failure()?.errorText;
      // A page that is left ends its stream, and pictures that are not wanted any more.
      if (why !== 'net::ERR_ABORTED') complaints.push(`${request.url()}: ${why}`);
    });
    return one;
  }
  return { browser, context, complaints };
}

// What axe finds that is serious. It is put in past the page's policy, which would not let it.
export async function axe(page) {
  const source = (await import('node:fs')).readFileSync(AXE, 'utf8');
  await page.evaluate(source);
  const found = await page.evaluate(() => globalThis.axe.run(document, { resultTypes: ['violations'] }));
  return found.violations
    .filter(one => ['serious', 'critical'].includes(one.impact))
    .map(one => `${one.id}: ${one.nodes.slice(0, 3).map(node => node.html.slice(0, 160)).join(' | ')}`);
}

// What can be worked on a page and is not reached by the Tab key.
export async function unreached(page) {
  const all = await page.evaluate(() => {
    const shown = element => element.checkVisibility({ visibilityProperty: true }) && !element.closest('[hidden]')
      && !(element.closest('details:not([open])') && !element.matches('summary'));
    const found = [...document.querySelectorAll('a[href], button, input:not([type=hidden]), select, summary, [tabindex="0"]')]
      .filter(element => shown(element) && !element.disabled);
    found.forEach((element, at) => { element.dataset.tabTest = String(at); });
    document.activeElement?.blur();
    return found.map(element => `${element.tagName} ${element.id || element.textContent.trim().slice(0, 40)}`);
  });
  const seen = new Set();
  for (let at = 0; at < all.length + 30; at += 1) {
    await page.keyboard.press('Tab');
    const here = await page.evaluate(() => document.activeElement?.dataset.tabTest ?? null);
    if (here !== null) seen.add(Number(here));
  }
  return all.filter((_, at) => !seen.has(at));
}

export function check(what, message) {
  if (!what) throw new Error(message);
}

export async function until(what, ask, seconds = 120) {
  const end = Date.now() + 1000 * seconds;
  for (;;) {
    const answer = await ask();
    if (answer) return answer;
    if (Date.now() > end) throw new Error(`waited in vain for ${what}`);
    await new Promise(resolve => setTimeout(resolve, 100));
  }
}
