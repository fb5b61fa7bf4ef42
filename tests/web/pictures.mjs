// node pictures.mjs FOLDER: decodes the HEVC pictures that FOLDER/pictures.json lists, each into a file of samples.
import { readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { PictureDecoder } from "../../runtime/tinysplat_runtime/web/hevc/picture.js";

const folder = process.argv[2];
for (const { name, width, height, chroma, bits } of JSON.parse(readFileSync(join(folder, "pictures.json")))) {
  const [sets, picture] = ["sets", "picture"].map(
    (kind) => new Uint8Array(readFileSync(join(folder, `${name}.${kind}`))),
  );
  const planes = new PictureDecoder(sets, width, height, chroma, bits).decode(picture);
  writeFileSync(
    join(folder, `${name}.samples`),
    Buffer.concat(planes.map(({ samples }) => Buffer.from(samples.buffer))),
  );
}
