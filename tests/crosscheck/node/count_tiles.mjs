// Walks a tileset with 3d-tiles-tools: `node count_tiles.mjs TILESET.JSON` prints a JSON line of its tiles, contents, and
// the instances that its leaves hold.
import { readFile } from 'node:fs/promises';
import { dirname, resolve } from 'node:path';

import { Logger, NodeIO } from '@gltf-transform/core';
import { ALL_EXTENSIONS } from '@gltf-transform/extensions';
import { FileResourceResolver, TilesetTraverser } from '3d-tiles-tools';

const file = resolve(process.argv[2]);
const home = dirname(file);
const io = new NodeIO().registerExtensions(ALL_EXTENSIONS).setLogger(new Logger(Logger.Verbosity.SILENT));
const counts = { tiles: 0, contents: 0, levels: 0, instances: 0 };

const traverser = new TilesetTraverser(home, new FileResourceResolver(home), { depthFirst: true });
await traverser.traverse(JSON.parse(await readFile(file, 'utf8')), async (tile) => {
  counts.tiles += 1;
  counts.levels = Math.max(counts.levels, tile.level + 1);
  const isLeaf = (await tile.getChildren()).length === 0;
  for (const content of tile.getFinalContents()) {
    counts.contents += 1;
    if (!isLeaf) continue;
    const document = await io.read(resolve(home, content.uri));
    for (const node of document.getRoot().listNodes()) {
      const batch = node.getExtension('EXT_mesh_gpu_instancing');
      if (batch) counts.instances += batch.getAttribute('TRANSLATION').getCount();
    }
  }
  return true;
});
console.log(JSON.stringify(counts));
