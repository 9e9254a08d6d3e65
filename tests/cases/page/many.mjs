// Among thousands of jobs: search, pages, filters, orders to many; with scripts and
// without. Arguments: program, address.
import { axe, check, open, until } from './browser.mjs';

const [program, address] = process.argv.slice(2);
const shots = process.env.LODESTONE_SHOTS;
const shot = async (page, name) => shots && page.screenshot({ path: `${shots}/${name}.png`, fullPage: true });
const { browser, context, complaints } = await open(program);

for (const javaScriptEnabled of [true, false]) {
  const page = await (await context({ javaScriptEnabled })).newPage();
  const total = () => page.locator('#pager').textContent();
  await page.goto(`${address}/`);
  // The first turn dismisses two.
  const all = javaScriptEnabled ? '5\u202f000' : '4\u202f998';
  check((await total()).includes(`50 of ${all} jobs`), await total());
  await page.getByRole('searchbox').fill('tile_4321');
  await page.getByRole('button', { name: 'Show' }).click();
  await page.waitForURL(/q=tile_4321/);
  check((await page.locator('#jobs tbody tr').count()) === 1, 'one job of this name');
  check((await page.locator('#jobs tbody').textContent()).includes('Tile_4321'), 'the one');
  await page.goto(`${address}/?state=done&sort=points`);
  const names = async () => page.locator('#jobs td.name a:not(.look)').allTextContents();
  const first = await names();
  await page.getByRole('link', { name: 'Next' }).click();
  await page.waitForURL(/at=after/);
  const second = await names();
  check(second.length === 50 && !second.some(name => first.includes(name)), 'the next page');
  await page.getByRole('link', { name: 'Before' }).click();
  await page.waitForURL(/at=before/);
  check((await names()).join() === first.join(), 'and back');
  await page.getByRole('link', { name: 'Points' }).click();
  await page.waitForURL(/sort=points-up/);
  check((await page.locator('th[aria-sort=ascending]').count()) === 1, 'the other way round');

  // Chosen ones.
  await page.goto(`${address}/?state=failed`);
  check((await page.locator('#why').textContent()).includes(' ×'), 'why they failed');
  if (javaScriptEnabled) {
    await shot(page, 'failed');
    const found = await axe(page);
    check(found.length === 0, found.join('\n'));
  }
  const boxes = page.locator('input[name=job]');
  await boxes.nth(0).check();
  await boxes.nth(1).check();
  await page.locator('#bulk').getByRole('button', { name: 'Dismiss' }).click();
  await page.waitForURL(/said=dismiss/);
  check(await page.getByText('2 jobs dismissed.').isVisible(), 'it says what was done');
  check(page.url().includes('state=failed'), 'and stays where it was');
  check(await page.getByRole('link', { name: /^dismissed/ }).count() === 1, 'they can be found again');
}

// All failed jobs in three clicks: the tab, the button, the word that it is meant.
const page = await (await context()).newPage();
await page.goto(`${address}/`);
await page.getByRole('link', { name: /^failed/ }).click();
await page.waitForURL(/state=failed/);
await page.locator('summary', { hasText: 'Retry all failed' }).click();
await page.getByRole('button', { name: 'Yes, try all of them again' }).click();
await page.waitForURL(/said=retry/);
check(await page.getByText(/jobs will be tried again/).isVisible(), 'all of them');

// Draining and pausing.
await page.getByRole('button', { name: 'Drain' }).click();
await until('the word on it', () => page.getByText('Draining:').isVisible());
await page.locator('#banners').getByRole('button', { name: 'Resume' }).click();
await page.waitForURL(/said=mode-run/);
check(await page.getByText('Draining:').count() === 0, 'it goes on');

// One that is not there is a page too.
const answer = await page.goto(`${address}/jobs/999999`);
check(answer.status() === 404 && await page.getByText('there is no job 999999').isVisible(), 'a clear word');
const noise = complaints.filter(text => !text.includes('404'));
check(noise.length === 0, noise.join('\n'));
await browser.close();
