// Drops clouds onto the page, watches them, cancels one, tries it again, looks at
// one from all sides. Arguments: program, address, the file that holds the conversion of
// the large cloud and says at how many percent, large cloud, other clouds.
import { rmSync, writeFileSync } from 'node:fs';
import { axe, check, open, unreached, until } from './browser.mjs';

const [program, address, hold, large, ...clouds] = process.argv.slice(2);
const shots = process.env.LODESTONE_SHOTS;
const shot = async (page, name) => shots && page.screenshot({ path: `${shots}/${name}.png`, fullPage: true });
const { browser, context, complaints } = await open(program);
const page = await (await context()).newPage();
const stem = path => path.split('/').pop().replace(/\.la[sz]$/, '');
const row = name => page.locator('#jobs tbody tr').filter({ has: page.getByRole('link', { name, exact: true }) });

await page.goto(`${address}/`);
check(await page.getByText('Nothing here yet').isVisible(), 'a newcomer is told what to do');
await shot(page, 'empty');
check((await axe(page)).length === 0, `empty: ${await axe(page)}`);

await page.locator('#drop input[type=file]').first().setInputFiles([large, ...clouds]);
await until('the upload', () => row(stem(large)).count());

// Its bars move as it does.
let before = -1;
for (const percent of [20, 50, 80]) {
  writeFileSync(hold, String(percent));
  const bar = kind => row(stem(large)).locator(`progress.${kind}`);
  await until(`a bar at ${percent} %`, async () => await bar('stage').count()
    && await bar('stage').evaluate(element => 100 * element.value / element.max) === percent);
  const whole = await bar('whole').evaluate(element => element.value / element.max);
  check(whole > before && whole < percent / 100, `${whole} of the whole after ${before}, ${percent} % of the first stage`);
  before = whole;
}
await shot(page, 'busy');

await row(stem(large)).getByRole('link', { name: stem(large), exact: true }).click();
await page.locator('#orders summary', { hasText: 'Cancel' }).click();
await shot(page, 'asks');
await page.getByRole('button', { name: 'Yes, call it off' }).click();
await until('the end of it', () => page.locator('.title .badge.cancelled').count());
await page.getByRole('button', { name: 'Try again' }).click();
await until('its second run', () => page.locator('.title .badge.running').count());
rmSync(hold);
await until('its octree', () => page.locator('.title .badge.done').count(), 300);
check(complaints.length === 0, complaints.join('\n'));

// A job's page renews itself: the picture comes without a reload.
await page.goto(`${address}/`);
const name = stem(clouds[0]);
await row(name).getByRole('link', { name, exact: true }).click();
await until('its pictures', () => page.locator('#turntable').count(), 300);
await page.locator('#turntable').evaluate(picture => picture.decode());
const first = await page.locator('#turntable').screenshot();
await until('the turntable to turn', async () => !first.equals(await page.locator('#turntable').screenshot()));
await page.locator('#turn').click();
await page.locator('#turntable').evaluate(picture => picture.decode());
const rests = await page.locator('#turntable').screenshot();
await new Promise(resolve => setTimeout(resolve, 600));
check(rests.equals(await page.locator('#turntable').screenshot()), 'it rests when told to');
check((await page.locator('#log').textContent()).includes('published'), 'the log is there');
await shot(page, 'done');
const found = await axe(page);
check(found.length === 0, `job: ${found.join('\n')}`);
check((await unreached(page)).length === 0, `keyboard: ${await unreached(page)}`);

await page.goto(`${address}/`);
await until('a picture in the list', () => page.locator('#jobs img[data-turning]').count());
await page.locator('#jobs img[data-turning]').first().hover();
check(await page.locator('#jobs img[data-resting]').count() === 1, 'it turns while it is looked at');
await page.mouse.move(0, 0);
check(await page.locator('#jobs img[data-resting]').count() === 0, 'and rests');
await shot(page, 'list');
const listed = await axe(page);
check(listed.length === 0, `list: ${listed.join('\n')}`);
check((await unreached(page)).length === 0, `keyboard: ${await unreached(page)}`);
if (shots) {
  const dark = await (await context({ colorScheme: 'dark' })).newPage();
  await dark.goto(`${address}/`);
  await shot(dark, 'dark');
  check((await axe(dark)).length === 0, `dark: ${await axe(dark)}`);
  const phone = await (await context({ viewport: { width: 390, height: 844 }, deviceScaleFactor: 2, isMobile: true })).newPage();
  await phone.goto(`${address}/`);
  await shot(phone, 'phone');
  await phone.goto(page.url().replace(/\/$/, '') + '/jobs/2');
  await shot(phone, 'phone-job');
}
const wide = await (await context({ viewport: { width: 360, height: 740 } })).newPage();
for (const path of ['/', '/jobs/1']) {
  await wide.goto(address + path);
  const over = await wide.evaluate(() => document.documentElement.scrollWidth - innerWidth);
  check(over <= 0, `${path} is ${over} pixels wider than a phone`);
}
check(complaints.length === 0, complaints.join('\n'));
await browser.close();
