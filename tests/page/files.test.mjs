// Bytes on their way into the page, and what it says of them.
import assert from "node:assert/strict";
import test from "node:test";
import { bytesByUse, fetched, inKilobytes, paced } from "../../runtime/tinysplat_runtime/page/files.js";

test("sizes are said in few digits", () => {
  const sizes = [[0, "0.1 KB"], [151, "0.2 KB"], [9949, "9.9 KB"], [10000, "10 KB"], [999499, "999 KB"], [1000000, "1.0 MB"], [2345678, "2.3 MB"]];
  for (const [bytes, said] of sizes) assert.equal(inKilobytes(bytes), said);
});

test("bytes are counted by what they are for, and come to the file's", () => {
  const about = {
    bytes: 1000, sections: [{ name: "PHOT[0]", bytes: 40 }, { name: "PHOT[1]", bytes: 2 }, { name: "LAYR[0]", bytes: 50 }],
    channels: [[{ name: "depth0", bytes: [100, 20] }, { name: "color12", bytes: [300] }, { name: "opacity0", bytes: [] }], [{ name: "color0", bytes: [5] }]],
  };
  const uses = bytesByUse(about), of = Object.fromEntries(uses);
  assert.deepEqual([of.distances, of.colours, of.photos], [120, 305, 42]);
  assert.equal(uses.reduce((sum, [, bytes]) => sum + bytes, 0), 1000);
});

test("bytes at hand come in two when there is something to see before", async () => {
  const bytes = Uint8Array.from({ length: 9 }, (_, i) => i);
  for (const [steps, wanted] of [[[3, 5, 9], [3, 6]], [[9], [9]], [[], [9]], [[4], [4, 5]]]) {
    const chunks = [];
    for await (const chunk of paced(bytes, steps, async () => {})) chunks.push(chunk.length);
    assert.deepEqual(chunks, wanted);
  }
});

test("addresses are read as they come in, without credentials, and up to a limit", async () => {
  let answer, asked;
  Object.assign(globalThis, { location: { href: "https://example.org/a/page.html" }, fetch: async (url, options) => {
    asked = [url.href, options];
    const left = [...answer.sizes];
    const read = async () => (left.length ? { value: { length: left.shift() }, done: false } : { done: true });
    return { ok: true, status: 200, statusText: "OK", headers: new Map(Object.entries({ "Content-Length": "7" })), ...answer, body: { getReader: () => ({ read }) } };
  } });
  const lengths = async (address, given) => {
    answer = given;
    const got = [];
    for await (const chunk of fetched(address, "stop", () => {})) got.push(chunk.length);
    return got;
  };
  assert.deepEqual(await lengths("b.tsplat", { sizes: [3, 4] }), [3, 4]);
  assert.equal(asked[0], "https://example.org/a/b.tsplat");
  assert.deepEqual([asked[1].credentials, asked[1].referrerPolicy, asked[1].signal], ["omit", "no-referrer", "stop"]);
  await assert.rejects(lengths("http://example.org/c", { sizes: Array(64).fill(2 ** 30) }), /more than \d+ bytes/);
  await assert.rejects(lengths("file:///etc/passwd", { sizes: [] }), /no address that a page may read/);
  await assert.rejects(lengths("blob:abc", { sizes: [], ok: false, status: 404, statusText: "Not Found" }), /404 Not Found/);
});
