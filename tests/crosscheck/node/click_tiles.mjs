// Opens a tileset in CesiumJS in a headless browser and clicks on trees:
// `node click_tiles.mjs CHROMIUM FOLDER PLACES.json SCREENSHOT.png`. PLACES.json lists {longitude, latitude, height_m} of points in crowns;
// each is looked at from above. Prints a JSON line: what a click on each point told, and what went wrong.
import { createReadStream } from 'node:fs';
import { readFile, stat } from 'node:fs/promises';
import { createServer } from 'node:http';
import { dirname, extname, join, normalize } from 'node:path';
import { fileURLToPath } from 'node:url';

import { chromium } from 'playwright-core';

const [browserPath, folder, placesFile, screenshot] = process.argv.slice(2);
const here = dirname(fileURLToPath(import.meta.url));
const roots = { cesium: join(here, 'node_modules/cesium/Build/Cesium'), tiles: folder };
const types = { '.css': 'text/css', '.glb': 'model/gltf-binary', '.html': 'text/html', '.js': 'text/javascript', '.json': 'application/json' };

const server = createServer(async (request, response) => {
  const path = new URL(request.url, 'http://localhost').pathname;
  if (path === '/') {
    response.setHeader('Content-Type', types['.html']);
    createReadStream(join(here, 'click_tiles.html')).pipe(response);
    return;
  }
  const [, root, ...rest] = normalize(path).split('/');
  const file = roots[root] && join(roots[root], ...rest);
  const found = file && (await stat(file).catch(() => null));
  if (!found?.isFile()) {
    response.writeHead(404).end();
    return;
  }
  response.setHeader('Content-Type', types[extname(file)] ?? 'application/octet-stream');
  createReadStream(file).pipe(response);
});
await new Promise((done) => server.listen(0, '127.0.0.1', done));

const browser = await chromium.launch({
  executablePath: browserPath,
  args: ['--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--disable-quic', '--no-first-run',
    '--disable-background-networking', '--disable-component-update', '--disable-sync'],
});
const problems = [];
try {
  const page = await browser.newPage({ viewport: { width: 480, height: 320 } });
  page.setDefaultTimeout(240_000);
  page.on('pageerror', (error) => problems.push(String(error)));
  page.on('console', (message) => message.type() === 'error' && problems.push(message.text()));
  page.on('requestfailed', (request) => problems.push(`${request.url()} failed`));
  await page.goto(`http://127.0.0.1:${server.address().port}/`);
  await page.waitForFunction('window.clickAt !== undefined');
  const clicks = [];
  for (const place of JSON.parse(await readFile(placesFile, 'utf8'))) {
    clicks.push(await page.evaluate((point) => window.clickAt(point), place));
  }
  await page.evaluate(() => window.showAll());
  await page.screenshot({ path: screenshot });
  console.log(JSON.stringify({ clicks, problems }));
} finally {
  await browser.close();
  server.close();
}
