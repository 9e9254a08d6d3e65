// Opens each octree, or the COPC file of a folder without one, in a page of the real
// Potree viewer, in Chromium without a screen. Arguments: the folder of Potree 1.8 (build
// and libs in it), the folder of octrees, the browser, and a folder for a picture of each.
// Standard output: for each what went wrong on the page and what the viewer has loaded
// and drawn.
import { createServer } from 'node:http';
import { open, readdir } from 'node:fs/promises';
import { extname, join, normalize } from 'node:path';
import { chromium } from 'playwright-core';

const [potree, octrees, executablePath, pictures] = process.argv.slice(2);

// What is opened of a folder.
async function cloudIn(name) {
  const files = await readdir(join(octrees, name));
  return files.includes('metadata.json') ? 'metadata.json' : files.find((file) => file.endsWith('.copc.laz'));
}

const page = (name, file) => `<!DOCTYPE html><html><head><meta charset="utf-8">
<link rel="stylesheet" href="/potree/build/potree/potree.css">
<link rel="stylesheet" href="/potree/libs/jquery-ui/jquery-ui.min.css">
<link rel="stylesheet" href="/potree/libs/openlayers3/ol.css"></head><body>
${[
  'jquery/jquery-3.1.1.min.js', 'spectrum/spectrum.js', 'jquery-ui/jquery-ui.min.js', 'other/BinaryHeap.js',
  'tween/tween.min.js', 'd3/d3.js', 'proj4/proj4.js', 'openlayers3/ol.js', 'i18next/i18next.js', 'jstree/jstree.js',
  'copc/index.js',
].map((script) => `<script src="/potree/libs/${script}"></script>`).join('\n')}
<script src="/potree/build/potree/potree.js"></script>
<div class="potree_container" style="position:absolute;width:100%;height:100%;left:0;top:0">
<div id="potree_render_area"></div><div id="potree_sidebar_container"></div></div>
<script type="module">
window.viewer = new Potree.Viewer(document.getElementById('potree_render_area'));
viewer.setPointBudget(1_000_000);
viewer.loadGUI(() => {
  Potree.loadPointCloud('/octrees/${name}/${file}', 'cloud', ({ pointcloud }) => {
    viewer.scene.addPointCloud(pointcloud);
    viewer.fitToScreen();
    window.cloud = pointcloud;
  });
});
</script></body></html>`;

const types = { '.js': 'text/javascript', '.css': 'text/css', '.html': 'text/html', '.json': 'application/json',
  '.svg': 'image/svg+xml', '.png': 'image/png' };

async function send(request, response) {
  const path = normalize(decodeURIComponent(new URL(request.url, 'http://x').pathname));
  if (path.startsWith('/page/')) {
    return response.writeHead(200, { 'content-type': 'text/html' }).end(page(path.slice(6), await cloudIn(path.slice(6))));
  }
  const root = path.startsWith('/potree/') ? potree : octrees;
  const file = await open(join(root, path.split('/').slice(2).join('/')));
  try {
    const { size } = await file.stat();
    const [, first, last] = /^bytes=(\d+)-(\d+)$/.exec(request.headers.range ?? '') ?? [];
    const from = Number(first ?? 0);
    const to = Math.min(Number(last ?? size - 1), size - 1);
    const bytes = Buffer.alloc(Math.max(0, to - from + 1));
    await file.read(bytes, 0, bytes.length, from);
    response.writeHead(first === undefined ? 200 : 206, { 'content-type': types[extname(path)] ?? 'application/octet-stream' });
    response.end(bytes);
  } finally {
    await file.close();
  }
}

const server = createServer((request, response) => {
  send(request, response).catch(() => response.writeHead(404).end());
}).listen(0, '127.0.0.1');
await new Promise((resolve) => server.once('listening', resolve));
const { port } = server.address();

const browser = await chromium.launch({
  executablePath,
  args: ['--no-sandbox', '--disable-quic', '--no-first-run', '--disable-background-networking',
    '--disable-component-update', '--disable-sync', '--enable-unsafe-swiftshader', '--use-gl=angle', '--use-angle=swiftshader'],
});
const seen = {};
try {
  for (const name of (await readdir(octrees)).sort()) {
    const tab = await browser.newPage({ viewport: { width: 400, height: 300 } });
    const errors = [];
    tab.on('pageerror', (error) => errors.push(String(error)));
    await tab.goto(`http://127.0.0.1:${port}/page/${name}`, { timeout: 120_000 });
    let loaded = true;
    // Frames go on, and more than the root comes, or nothing more can.
    await tab.waitForFunction(() => {
      const cloud = window.cloud;
      return cloud && cloud.visibleNodes.length > 0 && cloud.numVisiblePoints >= Math.min(cloud.pcoGeometry.root.numPoints, 1000)
        && Potree.numNodesLoading === 0 && (window.still = (window.still ?? 0) + 1) > 20;
    }, null, { timeout: 120_000, polling: 100 }).catch(() => { loaded = false; });
    seen[name] = await tab.evaluate((loaded) => ({
      loaded,
      nodes: window.cloud?.visibleNodes.length ?? 0,
      points: window.cloud?.numVisiblePoints ?? 0,
      projection: window.cloud?.projection,
      attributes: window.cloud?.pcoGeometry.pointAttributes.attributes.map((a) => a.name),
      drawn: (() => {
        viewer.renderer.domElement.getContext('webgl2', { preserveDrawingBuffer: true });
        viewer.render();
        const gl = viewer.renderer.getContext();
        const pixels = new Uint8Array(4 * gl.drawingBufferWidth * gl.drawingBufferHeight);
        gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
        return new Set(new Uint32Array(pixels.buffer)).size;
      })(),
    }), loaded).catch((error) => ({ loaded: false, error: String(error) }));
    seen[name].errors = errors.slice(0, 5);
    await tab.screenshot({ path: join(pictures, `${name}.png`) });
    await tab.close();
  }
} finally {
  await browser.close();
  server.close();
}
console.log(JSON.stringify(seen));
