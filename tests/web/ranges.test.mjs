// Views of a file on a web server whose answers are not to be believed: WEB.md's `decodeViews` of an address.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { createServer } from "node:http";
import { test } from "node:test";

import { TsplatError, decode, decodeViews } from "../../runtime/tinysplat_runtime/web/tsplat.js";
import { rangesOf } from "../../runtime/tinysplat_runtime/web/ranges.js";

const file = readFileSync(new URL("../conformance/cases/by_view/by_view.tsplat", import.meta.url));

async function serving(answer, work) {
  const server = createServer(answer);
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  try {
    await work(`http://127.0.0.1:${server.address().port}/f.tsplat`);
  } finally {
    server.closeAllConnections();
    server.close();
  }
}

test("an honest server is asked for ranges alone", async () => {
  let sent = 0;
  const honest = ({ headers }, response) => {
    const [first, last] = headers.range.match(/\d+/g).map(Number), part = file.subarray(first, last + 1);
    sent += part.length;
    response.writeHead(206, { "Content-Range": `bytes ${first}-${first + part.length - 1}/${file.length}` }).end(part);
  };
  await serving(honest, async (address) => {
    const found = await decodeViews(address, [1], { threads: 0 }), wanted = await decode(file, { views: [1], threads: 0 });
    assert.deepEqual(found.means, wanted.means);
    assert.ok(sent < file.length);
  });
});

const lies = {
  "": (_, response) => response.writeHead(200).end(file),
  "404": (_, response) => response.writeHead(404).end(),
  "bytes 7-9/10": (_, response) => response.writeHead(206, { "Content-Range": "bytes 7-9/10" }).end("abc"),
  "20": (_, response) => {
    response.writeHead(206, { "Content-Range": "bytes 0-19/999" });
    const more = () => { while (!response.destroyed && response.write(Buffer.alloc(1 << 16))); };
    response.on("drain", more);
    more();
  },
  "3": (_, response) => response.writeHead(206, { "Content-Range": "bytes 0-19/999" }).end("abc"),
};

for (const [words, lie] of Object.entries(lies)) {
  test(`a server that lies is refused: ${words}`, () => serving(lie, (address) =>
    assert.rejects(decodeViews(address, [0]), (error) => error instanceof TsplatError && error.message.includes(words))));
}

test("a server that says nothing is given up", () => serving(() => undefined, (address) =>
  assert.rejects(rangesOf(address, undefined, 200)(0, 20), TsplatError)));
