// node de265.mjs FOLDER: decodes what tests/web/pictures.mjs does with libde265, as the npm package libheif-js has it.
import { readFileSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";

const [folder] = process.argv.slice(2);
const require = createRequire(join(process.cwd(), "package.json")); // the package of the folder this runs in
const made = require("libheif-js/libheif-wasm/libheif.js")({
  wasmBinary: readFileSync(join(require.resolve("libheif-js"), "..", "libheif-wasm", "libheif.wasm")),
});
const library = await (made.then ? made : (made.ready ?? made));
const M = library?._de265_init ? library : made;
M._de265_init();

/** NAL units of a byte stream. */
function units(bytes) {
  const starts = [];
  for (let i = 0; i + 2 < bytes.length; i++) if (!bytes[i] && !bytes[i + 1] && bytes[i + 2] === 1) starts.push(i + 3);
  return starts.map((start, n) => {
    let end = n + 1 < starts.length ? starts[n + 1] - 3 : bytes.length;
    while (!bytes[end - 1]) end--;
    return bytes.subarray(start, end);
  });
}

function decoded(nals) {
  const decoder = M._de265_new_decoder();
  for (const nal of nals) {
    const at = M._malloc(nal.length);
    M.HEAPU8.set(nal, at);
    M._de265_push_NAL(decoder, at, nal.length, 0, 0, 0);
    M._free(at);
  }
  M._de265_flush_data(decoder);
  const more = M._malloc(4);
  let picture = 0;
  for (let i = 0; i < 100 && !picture; i++) {
    M._de265_decode(decoder, more);
    picture = M._de265_get_next_picture(decoder);
  }
  if (!picture) throw new Error("libde265 gives no picture");
  const planes = [];
  for (let c = 0; c < (M._de265_get_chroma_format(picture) ? 3 : 1); c++) {
    const at = M._de265_get_image_plane(picture, c, more);
    const stride = M.HEAP32[more >> 2];
    const [width, height] = [M._de265_get_image_width(picture, c), M._de265_get_image_height(picture, c)];
    for (let y = 0; y < height; y++) planes.push(Buffer.from(M.HEAPU8.slice(at + y * stride, at + y * stride + 2 * width)));
  }
  M._free(more);
  M._de265_free_decoder(decoder);
  return Buffer.concat(planes);
}

for (const { name } of JSON.parse(readFileSync(join(folder, "pictures.json")))) {
  const [sets, picture] = ["sets", "picture"].map((kind) => new Uint8Array(readFileSync(join(folder, `${name}.${kind}`))));
  writeFileSync(join(folder, `${name}.de265`), decoded([...units(sets), picture]));
}
