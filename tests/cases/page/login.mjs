// A daemon with a token: in by the form, out by the button; and a daemon that dies
// under an open page. Arguments: program, address, token, PID of the daemon.
import { axe, check, open, until } from './browser.mjs';

const [program, address, token, pid] = process.argv.slice(2);
const shots = process.env.LODESTONE_SHOTS;
const { browser, context, complaints } = await open(program);
const page = await (await context()).newPage();
await page.goto(`${address}/?state=done`);
check(await page.getByLabel('Token').isVisible(), `a way in: ${await page.content()}`);
if (shots) await page.screenshot({ path: `${shots}/login.png` });
const found = await axe(page);
check(found.length === 0, found.join('\n'));
await page.getByLabel('Token').fill('not the token');
await page.keyboard.press('Enter');
await until('a word on it', () => page.getByText('That is not the token').isVisible());
await page.getByLabel('Token').fill(token);
await page.keyboard.press('Enter');
await until('the page', () => page.locator('#strip').count());
check(page.url().includes('state=done'), `the one that was asked for, not ${page.url()}`);
await page.goto(`${address}/`);
await page.getByRole('button', { name: 'Drain' }).click();
await until('the order', () => page.getByText('Draining:').isVisible());

// The page says when the daemon is gone.
check(await page.locator('#gone').isHidden(), 'all is well');
const calm = complaints.filter(text => !text.includes('401'));
check(calm.length === 0, calm.join('\n'));
process.kill(Number(pid), 'SIGKILL');
await until('a word on that it is gone', () => page.locator('#gone').isVisible());
await browser.close();
