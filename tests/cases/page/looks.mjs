// Every kind of page, light and dark, on a phone and on a desk: nothing serious for
// axe, nothing wider than its window, all reached by the keyboard, no complaint.
// Arguments: program, address, token, read token, then `name=path` of each page.
import { axe, check, open, unreached } from './browser.mjs';

const [program, address, token, reader, ...pages] = process.argv.slice(2);
const shots = process.env.LODESTONE_SHOTS;
const { browser, context, complaints } = await open(program);
const SIZES = { phone: { viewport: { width: 390, height: 844 }, isMobile: true }, desk: {} };

async function enter(page, secret) {
  await page.goto(`${address}/login`);
  await page.getByLabel('Token').fill(secret);
  await page.keyboard.press('Enter');
  await page.waitForSelector('#strip');
}

for (const [size, options] of Object.entries(SIZES)) {
  for (const colorScheme of ['light', 'dark']) {
    const page = await (await context({ ...options, colorScheme })).newPage();
    for (const one of pages) {
      const at = one.indexOf('=');
      const [name, path] = [one.slice(0, at), one.slice(at + 1)];
      await page.goto(address + path);
      if (name !== 'login' && await page.locator('#token').count()) {
        await enter(page, token);
        await page.goto(address + path);
      }
      for (const details of await page.locator('details:not(.confirm)').all()) {
        await details.evaluate(element => { element.open = true; });
      }
      const where = `${name}, ${size}, ${colorScheme}`;
      if (shots) await page.screenshot({ path: `${shots}/${name}-${size}-${colorScheme}.png`, fullPage: true });
      const found = await axe(page);
      check(found.length === 0, `${where}: ${found.join('\n')}`);
      const over = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
      check(over <= 0, `${where} is ${over} pixels too wide`);
      if (size === 'desk' && colorScheme === 'light') {
        const missed = await unreached(page);
        check(missed.length === 0, `${where}: not by keyboard: ${missed.join(', ')}`);
      }
    }
    await page.context().close();
  }
}

// What asks is opened by the keyboard, closed by Escape, and gives the focus back.
const page = await (await context()).newPage();
await enter(page, token);
await page.goto(`${address}/jobs/1`);
const asks = page.locator('#orders details.confirm');
await asks.locator('summary').focus();
await page.keyboard.press('Enter');
await page.keyboard.press('Tab');
check(await asks.getByRole('button').evaluate(button => button === document.activeElement), 'its button has the focus');
const ring = await asks.getByRole('button').evaluate(button => getComputedStyle(button).outlineStyle);
check(ring !== 'none', 'the focus is seen');
await page.keyboard.press('Escape');
check(await asks.evaluate(details => !details.open), 'Escape closes it');
check(await asks.locator('summary').evaluate(summary => summary === document.activeElement), 'and the focus is where it was');

// Whoever may only read sees no order.
const guest = await (await context()).newPage();
await enter(guest, reader);
for (const path of ['/', '/?state=failed', '/jobs/1', '/jobs/2']) {
  await guest.goto(address + path);
  check(await guest.getByText('read only').isVisible(), 'it is said');
  const shown = await guest.locator('form[method=post] button, form[method=post] input:not([type=hidden]), input[name=job], summary.button').evaluateAll(all =>
    all.filter(element => element.checkVisibility({ visibilityProperty: true }) && element.textContent !== 'Log out').map(element => element.outerHTML));
  check(shown.length === 0, `${path}: ${shown.join('\n')}`);
}
// A page that is not there is one that was asked for.
const noise = complaints.filter(text => !text.includes('404'));
check(noise.length === 0, noise.join('\n'));
await browser.close();
