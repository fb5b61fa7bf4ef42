// Bytes on their way into the page, and what it says of them.
import assert from "node:assert/strict";
import test from "node:test";
import { bytesByUse, fetched, inKilobytes, paced } from "../../runtime/tinysplat_runtime/page/files.js";

test("sizes are said in few digits, and are about those", () => {
  const units = { k: 1e3, m: 1e6 };
  for (const bytes of [151, 9949, 10000, 999499, 1000000, 2345678]) {
    const said = inKilobytes(bytes);
    const [, number, unit] = /^([\d.]+)\s(\w)/.exec(said);
    const about = number * (units[unit.toLowerCase()] ?? 1);
    assert.ok(said.length <= 9 && Math.abs(about - bytes) <= Math.max(50, 0.05 * bytes), `${bytes}: ${said}`);
  }
});

test("bytes are counted by what they are for, and come to the file's", () => {
  const about = {
    bytes: 1000,
    channels: [
      [
        { name: "depth0", bytes: [100, 20] },
        { name: "color12", bytes: [300] },
        { name: "opacity0", bytes: [] },
        { name: "photo0", bytes: [40, 2] },
      ],
      [{ name: "color0", bytes: [5] }],
    ],
  };
  const uses = bytesByUse(about).map(([, bytes]) => bytes);
  for (const bytes of [120, 305, 42]) assert.ok(uses.includes(bytes), "distances, colours, photos");
  assert.equal(
    uses.reduce((sum, bytes) => sum + bytes, 0),
    1000,
  );
});

test("bytes at hand come whole, and first what there is something to see of", async () => {
  const bytes = Uint8Array.from({ length: 9 }, (_, i) => i);
  for (const steps of [[3, 5, 9], [9], [], [4]]) {
    const chunks = [];
    for await (const chunk of paced(bytes, steps, async () => {})) chunks.push([...chunk]);
    assert.deepEqual(chunks.flat(), [...bytes]);
    assert.equal(chunks[0].length, steps[0] ?? 9);
  }
});

test("addresses are read as they come in, without credentials, and up to a limit", async () => {
  let answer;
  let asked;
  let told;
  Object.assign(globalThis, {
    location: { href: "https://example.org/a/page.html" },
    fetch: async (url, options) => {
      asked = [url.href, options];
      const left = [...answer.sizes];
      const read = async () => (left.length ? { value: { length: left.shift() }, done: false } : { done: true });
      return {
        ok: true,
        status: 200,
        statusText: "OK",
        headers: new Map(Object.entries({ "Content-Length": "7" })),
        ...answer,
        body: { getReader: () => ({ read }) },
      };
    },
  });
  const lengths = async (address, given) => {
    answer = given;
    const got = [];
    for await (const chunk of fetched(address, "stop", (...progress) => {
      told = progress;
    }))
      got.push(chunk.length);
    return got;
  };
  assert.deepEqual(await lengths("b.tsplat", { sizes: [3, 4] }), [3, 4]);
  assert.deepEqual(told, [7, 7]);
  await lengths("b.tsplat", { sizes: [3], headers: new Map() });
  assert.deepEqual(told, [3, 0], "nobody says how many there are");
  assert.equal(asked[0], "https://example.org/a/b.tsplat");
  assert.deepEqual([asked[1].credentials, asked[1].referrerPolicy, asked[1].signal], ["omit", "no-referrer", "stop"]);
  await assert.rejects(lengths("http://example.org/c", { sizes: Array(64).fill(2 ** 30) }));
  await assert.rejects(lengths("file:///etc/passwd", { sizes: [] }), /file:/);
  await assert.rejects(lengths("blob:abc", { sizes: [], ok: false, status: 404, statusText: "Not Found" }), /404/);
});
