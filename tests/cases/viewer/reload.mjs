// A viewer's page in a Chromium with a cache on disk, while the octree that it shows is
// replaced, again and again: what it shows after a single reload each time.
// Arguments: browser, profile, page, the API's list of jobs, the file in the inbox, how
// many points it has, then each replacement and how many points that has.
import { copyFile } from 'node:fs/promises';
import { chromium } from 'playwright-core';

const [executablePath, profile, address, jobs, source, count, ...others] = process.argv.slice(2);
const context = await chromium.launchPersistentContext(profile, {
  executablePath,
  args: ['--no-sandbox', '--disable-quic', '--no-first-run', '--disable-background-networking',
    '--disable-component-update', '--disable-sync', '--disable-dev-shm-usage', '--use-angle=swiftshader',
    '--enable-unsafe-swiftshader', '--ignore-gpu-blocklist'],
});
const errors = [];
const told = [];
try {
  const page = await context.newPage();
  page.on('pageerror', (error) => errors.push(String(error)));

  // What the page shows once that many points have come, or what it has by then.
  async function shown(points) {
    await page.waitForFunction((wanted) => window.seen?.points >= wanted, Number(points), { timeout: 60_000 })
      .catch(() => {});
    told.push(await page.evaluate(() => window.seen ?? null));
  }

  await page.goto(address);
  await shown(count);
  for (let turn = 0; turn < others.length; turn += 2) {
    await copyFile(others[turn], source);
    for (let done = false; !done; await new Promise((resolve) => setTimeout(resolve, 100))) {
      const list = (await (await fetch(jobs)).json()).jobs;
      done = list.some((job) => job.revision === turn / 2 + 2 && job.state === 'done');
    }
    await page.reload();
    await shown(others[turn + 1]);
  }
} finally {
  await context.close();
}
console.log(JSON.stringify({ told, errors }));
