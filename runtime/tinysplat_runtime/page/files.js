// Files as scenes that get sharper: the one that the page carries, one that was chosen or dropped, or one by its address.

const HEADS = [1 << 15, 1 << 20]; // bytes that are asked for first, and then if they do not describe the file
const MOST_BYTES = 1 << 30; // that are fetched

const SECTIONS = { // what classes of bytes are called
  depth: "distances", color: "colours", opacity: "transparency", scale: "sizes", rotation: "directions", offset: "fine positions",
  position: "positions", exact: "exact planes", photo: "photos",
};
// Bytes by what they are for: [words, bytes], of those that are there.
export function bytesByUse({ parts, channels, bytes }) {
  const uses = new Map();
  for (const { name, bytes: streams } of channels.flat()) {
    const use = SECTIONS[name.replace(/\d+$/, "")] ?? name;
    uses.set(use, (uses.get(use) ?? 0) + streams.reduce((sum, n) => sum + n, 0));
  }
  const known = () => [...uses.values()].reduce((sum, n) => sum + n, 0);
  if (!known()) uses.set("views", parts.reduce((sum, part) => sum + part.length, 0)); // of which nothing else is known yet
  uses.set("description", bytes - known());
  return [...uses].filter(([, n]) => n > 0);
}

// Bytes at hand as chunks that end where a picture gets better; waits before each until `isFree()` resolves.
export async function* paced(bytes, steps, isFree) {
  let at = 0;
  for (const step of [...steps.filter((end) => end < bytes.length).slice(0, 1), bytes.length]) {
    yield bytes.subarray(at, step);
    at = step;
    await isFree();
  }
}

// A file whose bytes are at hand, or a Blob's: { read(offset, length), size }.
export const heldIn = (bytes) => ({
  size: bytes.size ?? bytes.length,
  read: async (offset, length) => new Uint8Array(await (bytes.arrayBuffer ? bytes.slice(offset, offset + length).arrayBuffer() : bytes.subarray(offset, offset + length))),
});

// What bytes say of their file; undefined where they do not describe it, of which who reads the whole says what is wrong.
export function described(inspect, bytes) {
  try {
    return inspect(bytes);
  } catch (error) {
    if (error.name !== "TsplatError") throw error;
    return undefined;
  }
}

// What a source's first bytes say of the file, if it is a capture whose views may be read one by one.
export async function captureIn({ read }, inspect, few) {
  for (const length of HEADS) {
    const about = described(inspect, await read(0, length));
    if (about) return about.cameras.length > few && about.parts.length > 0 ? about : undefined;
  }
  return undefined;
}

// A file behind an address: `read` gives ranges of its `size` (NaN where nobody says), unless its server sends the whole, of
// which `body` is then what comes.
export async function reached(address, signal) {
  let size;
  const asked = async (from, to) => {
    const response = await request(address, signal, { Range: `bytes=${from}-${to}` });
    size ??= Number(response.headers.get("Content-Range")?.split("/")[1]);
    if (response.status === 206) return new Uint8Array(await response.arrayBuffer());
    return response.status === 416 ? new Uint8Array(0) : response;
  };
  const first = await asked(0, HEADS[0] - 1).catch((error) => {
    if (error.name !== "TypeError") throw error;
    return request(address, signal, {}); // of a server that others may not ask for ranges
  });
  if (first instanceof Response) return { body: first };
  let head = first;
  const source = { size, received: first.length, whole: first.length < HEADS[0] ? first : undefined };
  source.read = async (offset, length) => {
    if (offset + length <= head.length || head.length < HEADS[0]) return head.subarray(offset, offset + length);
    const found = await asked(offset, offset + length - 1);
    if (found instanceof Response) throw new Error(`${address} gives no more ranges`);
    source.received += found.length;
    if (offset === 0) head = found;
    return found;
  };
  return source;
}

async function request(address, signal, headers) {
  const url = new URL(address, location.href);
  if (!["http:", "https:", "blob:", "data:"].includes(url.protocol)) throw new Error(`${url.protocol} is no address that a page may read; choose the file instead`);
  const response = await fetch(url, { signal, headers, credentials: "omit", referrerPolicy: "no-referrer" });
  if (!response.ok && response.status !== 416) throw new Error(`${url.href} answers ${response.status} ${response.statusText}`);
  return response;
}

// The bytes of an answer, or of the file at an address, as they come in; `told` hears how many of how many (0 where nobody says).
export async function* fetched(from, signal, told) {
  const response = from instanceof Response ? from : await request(from, signal, {});
  const whole = Number(response.headers.get("Content-Length")) || 0, reader = response.body.getReader();
  for (let received = 0; ;) {
    const { done, value } = await reader.read();
    if (done) return;
    received += value.length;
    if (received > MOST_BYTES) throw new Error(`more than ${MOST_BYTES} bytes`);
    told(received, whole);
    yield value;
  }
}

export function inKilobytes(bytes) {
  return bytes < 1e6 ? `${Math.max(bytes / 1000, 0.1).toFixed(bytes < 1e4 ? 1 : 0)} KB` : `${(bytes / 1e6).toFixed(1)} MB`;
}
