// Validates glTF files and counts their instances: `node check_gltf.mjs FILE...` prints a JSON line a file.
import { readFile } from 'node:fs/promises';
import { dirname, resolve } from 'node:path';

import { Logger, NodeIO } from '@gltf-transform/core';
import { ALL_EXTENSIONS } from '@gltf-transform/extensions';
import validator from 'gltf-validator';

const io = new NodeIO().registerExtensions(ALL_EXTENSIONS).setLogger(new Logger(Logger.Verbosity.SILENT));

for (const file of process.argv.slice(2)) {
  const report = await validator.validateBytes(new Uint8Array(await readFile(file)), {
    uri: file,
    maxIssues: 1000,
    externalResourceFunction: async (uri) => new Uint8Array(await readFile(resolve(dirname(file), uri))),
  });
  const document = await io.read(file);
  let instances = 0;
  const groups = [];
  for (const node of document.getRoot().listNodes()) {
    const batch = node.getExtension('EXT_mesh_gpu_instancing');
    if (!batch) continue;
    const translation = batch.getAttribute('TRANSLATION');
    instances += translation.getCount();
    groups.push({
      name: node.getName(),
      count: translation.getCount(),
      attributes: batch.listSemantics().sort(),
      min: translation.getMin([]),
      max: translation.getMax([]),
      triangles: node.getMesh().listPrimitives().reduce((sum, p) => sum + p.getIndices().getCount() / 3, 0),
    });
  }
  console.log(JSON.stringify({
    file,
    errors: report.issues.numErrors,
    warnings: report.issues.numWarnings,
    messages: report.issues.messages.filter((m) => m.severity < 2).slice(0, 20),
    infos: [...new Set(report.issues.messages.filter((m) => m.severity >= 2).map((m) => m.code))],
    materials: document.getRoot().listMaterials().length,
    instances,
    groups,
  }));
}
