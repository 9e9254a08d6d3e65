// Below a path of another site, behind a proxy: whatever a page names lies below that
// path and is there. Arguments: program, site, path, token, a file to upload.
import { check, open, until } from './browser.mjs';

const [program, site, base, token, file] = process.argv.slice(2);
const { browser, context, complaints } = await open(program);
const page = await (await context()).newPage();
const strays = [];
const asked = new Set();
page.on('request', request => {
  const url = new URL(request.url());
  asked.add(url.pathname);
  if (url.origin !== site || !url.pathname.startsWith(`${base}/`)) strays.push(request.url());
});
const seen = new Map();

// Everything that a page names.
async function named() {
  return page.evaluate(() => {
    const all = [];
    for (const element of document.querySelectorAll('*')) {
      for (const name of ['href', 'src', 'srcset', 'action', 'poster', 'data-turning', 'data-still', 'data-copy-url']) {
        const value = element.getAttribute(name);
        if (value !== null && !value.startsWith('#')) all.push([name, value]);
      }
    }
    return all;
  });
}

async function look(what) {
  for (const [name, value] of await named()) {
    check(value.startsWith(`${base}/`), `${what}: ${name}="${value}" leads out of ${base}`);
    if (name === 'action' || seen.has(value)) continue;
    const answer = await page.request.get(site + value);
    seen.set(value, answer.status());
    check(answer.status() === 200, `${what}: ${name}="${value}" is answered by ${answer.status()}`);
  }
}

await page.goto(`${site}${base}/`);
await look('login');
await page.getByLabel('Token').fill(token);
await page.getByRole('button', { name: 'Log in' }).click();
await page.waitForSelector('#drop');
await look('empty');
await page.locator('#drop input[type=file]').first().setInputFiles(file);
const name = file.split('/').pop().replace(/\.la[sz]$/, '');
const link = page.getByRole('link', { name, exact: true });
// It comes by the stream of events, without a reload, and so does its picture.
await until('the upload in the list', () => link.count());
await until('its picture', () => page.locator('#jobs img[data-turning]').count(), 300);
check(asked.has(`${base}/live`) && asked.has(`${base}/upload`), [...asked].join(' '));
await look('list');
await link.click();
await page.waitForSelector('#turntable');
await page.locator('#turntable').evaluate(picture => picture.decode());
await page.getByRole('button', { name: 'Make a link' }).click();
await page.waitForURL(/said=share/);
// What happens after a page was made and before its stream opens is shown too.
const job = new URL(page.url()).pathname.split('/').pop();
const verified = async () => {
  const answer = await page.request.get(`${site}${base}/api/jobs/${job}/verify`);
  return (await answer.json()).state === 'done';
};
await page.route('**/live', async route => {
  await until('the end of the verification', verified);
  // Until nobody looks for the page before any more.
  await new Promise(resolve => setTimeout(resolve, 2000));
  await route.continue();
});
await page.getByRole('button', { name: 'Verify' }).click();
await until('the verification', () => page.getByText('It is right.').count(), 30);
await page.unroute('**/live');
await look('job');
const share = await page.locator('#share [data-copy-url]').first().getAttribute('data-copy-url');
await page.getByRole('button', { name: 'Drain' }).count();
await page.goto(`${site}${base}/`);
await page.getByRole('button', { name: 'Drain' }).click();
await page.waitForURL(/said=mode-drain/);
await look('drained');
await page.goto(`${site}${base}/?state=done&sort=points-up`);
await look('sorted');
const missing = await page.goto(`${site}${base}/jobs/777`);
check(missing.status() === 404, 'no such job');
await look('missing');
// The link opens its page to a stranger, with its picture and files.
await page.context().clearCookies();
await page.goto(site + share);
await page.locator('img').evaluate(picture => picture.decode());
await look('shared');
check(strays.length === 0, strays.join('\n'));
const noise = complaints.filter(text => !text.includes('404') && !text.includes('401'));
check(noise.length === 0, noise.join('\n'));
await browser.close();
