// Real files and folders dropped onto the page; a form that works without scripts.
// Arguments: program, address, the paths to drop at once (files and a folder of tiles),
// a file for the form.
import { check, open, until } from './browser.mjs';

const [program, address, ...rest] = process.argv.slice(2);
const byForm = rest.pop();
const shots = process.env.LODESTONE_SHOTS;
const { browser, context, complaints } = await open(program);
const page = await (await context()).newPage();
await page.goto(`${address}/`);
const cdp = await page.context().newCDPSession(page);
const drag = (type, files) => cdp.send('Input.dispatchDragEvent', {
  type, x: 300, y: 500, data: { items: [], files, dragOperationsMask: 1 },
});

// Over the page, wherever: the zone says that it would take them.
await drag('dragEnter', rest);
// As of a hand that holds them there, it comes again and again.
await until('a word on it', async () => {
  await drag('dragOver', rest);
  return page.locator('#drop.over').count();
});
await drag('drop', rest);
await until('bars', () => page.locator('.uploads li').count());
if (shots) await page.screenshot({ path: `${shots}/upload.png` });
check(await page.locator('#drop.over').count() === 0, 'it is not over it any more');
// What is no cloud is told what to do with it, and nothing of it is sent.
const refused = page.locator('.uploads li[data-end=bad]');
await until('the refusal', () => refused.count());
check(/scan\.e57 .*is no LAS or LAZ/.test(await refused.textContent()), await refused.textContent());
await until('the others to arrive', async () => await page.locator('.uploads progress').count() === 0);
for (const path of rest) {
  const name = path.split('/').pop().replace(/\.la[sz]$/, '');
  if (name.endsWith('.e57')) continue;
  const row = page.locator('#jobs tbody tr').filter({ has: page.getByRole('link', { name, exact: true }) });
  await until(`${name} in the list, done`, () => row.locator('.badge.done').count());
  check(await row.count() === 1, `${name} is one data set`);
}

// Without scripts the form does it.
const plain = await (await context({ javaScriptEnabled: false })).newPage();
await plain.goto(`${address}/`);
await plain.locator('#drop input[type=file]').first().setInputFiles(byForm);
await plain.getByRole('button', { name: 'Upload' }).click();
await plain.waitForURL(/said=uploaded/);
check(await plain.getByText('One upload arrived.').isVisible(), 'it says so');
check(complaints.length === 0, complaints.join('\n'));
await browser.close();
