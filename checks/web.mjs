// node web.mjs MODEL FOLDER: runs MODEL on the inputs that checks/web.py left in FOLDER, and writes out_NAME files there.
import { readFileSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";
import { pathToFileURL } from "node:url";

const [model, folder] = process.argv.slice(2);
const require = createRequire(join(process.cwd(), "package.json")); // the package of the folder this runs in
const ort = await import(pathToFileURL(require.resolve("onnxruntime-web")));
const { InferenceSession, Tensor, env } = ort.default ?? ort;
env.wasm.numThreads = 1;

const session = await InferenceSession.create(new Uint8Array(readFileSync(model)));
const arrays = { uint16: Uint16Array, float32: Float32Array };
const feeds = {};
for (const [name, { type, shape }] of Object.entries(JSON.parse(readFileSync(join(folder, "inputs.json"))))) {
  const bytes = new Uint8Array(readFileSync(join(folder, name)));
  feeds[name] = new Tensor(type, new arrays[type](bytes.buffer), shape);
}
const start = performance.now();
const outputs = await session.run(feeds);
console.log(`onnxruntime-web ${env.versions.web}: ${(performance.now() - start).toFixed(0)} ms`);
for (const [name, tensor] of Object.entries(outputs)) writeFileSync(join(folder, `out_${name}`), new Uint8Array(tensor.data.buffer));
