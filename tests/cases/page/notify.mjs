// Notifications of the browser: none unasked, of each end once asked for, in a tab that
// nobody looks at too, none where they were turned off. Arguments: program, address, inbox,
// a good cloud.
import { copyFileSync, writeFileSync } from 'node:fs';
import { check, open, until } from './browser.mjs';

const [program, address, inbox, good] = process.argv.slice(2);
const { browser, context, complaints } = await open(program);
const own = await context();
await own.grantPermissions(['notifications'], { origin: address });
// What is shown is noted, and shown all the same.
await own.addInitScript(() => {
  const Real = window.Notification;
  window.told = [];
  window.Notification = class extends Real {
    constructor(title, options) {
      super(title, options);
      const one = { title, body: options.body, shown: false };
      window.told.push(one);
      this.addEventListener('show', () => { one.shown = true; });
    }
  };
});
const page = await own.newPage();
await page.goto(`${address}/`);
const told = () => page.evaluate(() => window.told);
const row = name => page.locator('#jobs tbody tr').filter({ has: page.getByRole('link', { name, exact: true }) });

// Each of its own content: a copy of a known one is no job.
const spoil = name => writeFileSync(`${inbox}/${name}.las`, `no points, ${name}`);

copyFileSync(good, `${inbox}/first.las`);
await until('the first in the list, done', () => row('first').locator('.badge.done').count());
check((await told()).length === 0, 'nobody asked for them');

await page.getByRole('button', { name: 'Notify me' }).click();
await until('the word that it will', () => page.locator('#notify[aria-pressed=true]').count());
// Another tab lies over it.
await page.evaluate(() => {
  Object.defineProperty(document, 'hidden', { get: () => true });
  document.dispatchEvent(new Event('visibilitychange'));
});
spoil('broken');
await until('word of the failure', async () => (await told()).some(one => one.title === 'broken' && one.body.includes('failed') && one.shown));
spoil('again');
await until('word of the next', async () => (await told()).some(one => one.title === 'again'));
check((await told()).length === 2, JSON.stringify(await told()));

// Kept for the next visit, until it is turned off.
await page.reload();
await page.getByRole('button', { name: 'Notifies you' }).click();
await until('the word that it will not', () => page.locator('#notify[aria-pressed=false]').count());
spoil('third');
await until('the third in the list', () => row('third').locator('.badge.failed').count());
check((await told()).length === 0, JSON.stringify(await told()));

// Where a browser has the permission and no way to show one, the page goes on.
await page.evaluate(() => {
  window.Notification = class { constructor() { throw new TypeError('Illegal constructor'); } };
  window.Notification.permission = 'granted';
  localStorage.setItem('lodestone-notify', 'yes');
});
spoil('fourth');
await until('the fourth in the list', () => row('fourth').locator('.badge.failed').count());
check(await page.locator('#notify').isHidden(), 'what cannot be done is not offered');
check(complaints.length === 0, complaints.join('\n'));
await browser.close();
