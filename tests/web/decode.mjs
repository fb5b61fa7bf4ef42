// node decode.mjs F.tsplat OUT.npz [OPTIONS]: decodes a file with tsplat.js. OPTIONS are those of `decode`, as JSON.
// node decode.mjs --serve: the same for every line {file, out, options} of standard input, with an answer in a line each.
import { readFileSync, writeFileSync } from "node:fs";
import { createInterface } from "node:readline";
import { crc32 } from "../../runtime/tinysplat_runtime/web/cursor.js";
import { TsplatError, decode } from "../../runtime/tinysplat_runtime/web/tsplat.js";

const TYPES = new Map([
  [Float32Array, "<f4"],
  [Float64Array, "<f8"],
  [Int32Array, "<i4"],
  [Uint16Array, "<u2"],
]);

/** An array as .npy has it. */
function npy(array, shape) {
  const dictionary = `{'descr': '${TYPES.get(array.constructor)}', 'fortran_order': False, 'shape': (${shape.join()}${shape.length ? "," : ""}), }`;
  const head = dictionary.padEnd(Math.ceil((dictionary.length + 11) / 64) * 64 - 11) + "\n";
  const length = Buffer.alloc(2);
  length.writeUInt16LE(head.length);
  const data = Buffer.from(array.buffer, array.byteOffset, array.byteLength);
  return Buffer.concat([Buffer.from("\x93NUMPY\x01\0", "latin1"), length, Buffer.from(head), data]);
}

/** Arrays by name as .npz has them: a ZIP archive whose files are stored. */
export function npz(arrays) {
  const [files, rows] = [[], []];
  let at = 0;
  for (const [name, [array, shape]] of Object.entries(arrays)) {
    const [data, path] = [npy(array, shape), Buffer.from(`${name}.npy`)];
    const fields = Buffer.alloc(26);
    fields.writeUInt16LE(20, 0);
    fields.writeUInt32LE(crc32(data), 10);
    fields.writeUInt32LE(data.length, 14);
    fields.writeUInt32LE(data.length, 18);
    fields.writeUInt16LE(path.length, 22);
    const place = Buffer.alloc(14);
    place.writeUInt32LE(at, 10);
    files.push(Buffer.from("PK\x03\x04"), fields, path, data);
    rows.push(Buffer.from("PK\x01\x02\x14\0"), fields, place, path);
    at += 30 + path.length + data.length;
  }
  const table = Buffer.concat(rows);
  const end = Buffer.alloc(18);
  end.writeUInt16LE(rows.length / 4, 4);
  end.writeUInt16LE(rows.length / 4, 6);
  end.writeUInt32LE(table.length, 8);
  end.writeUInt32LE(at, 12);
  return Buffer.concat([...files, table, Buffer.from("PK\x05\x06"), end]);
}

/** A scene's arrays as `Gaussians.flat()` has them, with the layers' shapes and the cameras. */
function arraysOf({ count, degree, means, quats, scales, opacities, sh, origin, layers, cameras }) {
  const shapes = layers.flatMap((layer) => [layer.views, layer.height, layer.width, layer.degree, layer.offset]);
  const views = cameras.flatMap(({ fx, fy, cx, cy, skew, c2w }) => [fx, fy, cx, cy, skew, ...c2w]);
  return {
    means: [means, [count, 3]],
    quats: [quats, [count, 4]],
    scales: [scales, [count, 3]],
    opacities: [opacities, [count]],
    sh: [sh, [count, (degree + 1) ** 2, 3]],
    origin: [Float64Array.from(origin), [3]],
    layers: [Int32Array.from(shapes), [layers.length, 5]],
    cameras: [Float64Array.from(views), [cameras.length, 21]],
  };
}

/**
 * A network that gives what FOLDER has: layers.json, and each layer's arrays of all views. It leaves the photos that it is
 * shown there. Of a view that it is shown again, all is 0.
 */
function networkOf(folder) {
  const shown = {};
  return async ({ photos, width, height, cameras, near, far, name }) => {
    const { layers, origin } = JSON.parse(readFileSync(`${folder}/layers.json`));
    const views = cameras.map(({ c2w }) =>
      layers[0].cameras.findIndex((camera) => camera.c2w.every((x, i) => x === c2w[i])),
    );
    const isNew = views.map((view) => !(view in shown));
    photos.forEach((photo, i) => (shown[views[i]] = [photo, [height, width, 3]]));
    writeFileSync(`${folder}/photos.npz`, npz(shown));
    writeFileSync(`${folder}/asked.json`, JSON.stringify({ near, far, name }));
    const arrays = ["means", "quats", "scales", "opacities", "sh"];
    layers.forEach((layer, n) => {
      for (const array of arrays) {
        const all = new Float32Array(new Uint8Array(readFileSync(`${folder}/${n}.${array}`)).buffer);
        const size = all.length / layer.cameras.length;
        layer[array] = new Float32Array(size * views.length);
        views.forEach(
          (view, i) => isNew[i] && layer[array].set(all.subarray(size * view, size * (view + 1)), size * i),
        );
      }
      layer.cameras = views.map((view) => layer.cameras[view]);
    });
    return { layers, origin };
  };
}

async function answer({ file, out, options = {} }) {
  if (options.network) options = { ...options, network: networkOf(options.network) };
  const began = performance.now();
  try {
    const scene = await decode(readFileSync(file), { threads: 0, ...options });
    const ms = performance.now() - began;
    if (out) writeFileSync(out, npz(arraysOf(scene)));
    const { count, notes, missing, mode } = scene;
    return { count, notes, missing, mode, ms, mb: process.memoryUsage.rss() / 2 ** 20 };
  } catch (error) {
    const ms = performance.now() - began;
    const kind = error instanceof TsplatError ? "TsplatError" : error.name;
    const { message, section, stack } = error;
    return {
      error: kind,
      message,
      section,
      stack: kind === "TsplatError" ? undefined : stack,
      ms,
      mb: process.memoryUsage.rss() / 2 ** 20,
    };
  }
}

if (process.argv[2] === "--serve") {
  for await (const line of createInterface({ input: process.stdin }))
    console.log(JSON.stringify(await answer(JSON.parse(line))));
} else if (process.argv[2]) {
  const [, , file, out, options] = process.argv;
  const said = await answer({ file, out, options: options && JSON.parse(options) });
  if (said.error) {
    console.error(`${said.error}: ${said.message}`);
    process.exitCode = said.error === "TsplatError" ? 2 : 1;
  }
}
