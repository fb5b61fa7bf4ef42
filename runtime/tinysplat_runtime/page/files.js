// Files as scenes that get sharper: the one that the page carries, one that was chosen or dropped, or one by its
// address.

const MOST_BYTES = 1 << 30; // that are fetched

const SECTIONS = {
  // what classes of bytes are called
  depth: "distances",
  color: "colours",
  opacity: "transparency",
  scale: "sizes",
  rotation: "directions",
  offset: "fine positions",
  position: "positions",
  exact: "exact planes",
  photo: "photos",
};
// Bytes by what they are for: [words, bytes], of those that are there.
export function bytesByUse({ channels, bytes }) {
  const uses = new Map();
  for (const { name, bytes: streams } of channels.flat()) {
    const use = SECTIONS[name.replace(/\d+$/, "")] ?? name;
    uses.set(use, (uses.get(use) ?? 0) + streams.reduce((sum, n) => sum + n, 0));
  }
  uses.set("description", bytes - [...uses.values()].reduce((sum, n) => sum + n, 0));
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

// What bytes say of their file; undefined where they do not describe it, of which who reads the whole says what is
// wrong.
export function described(inspect, bytes) {
  try {
    return inspect(bytes);
  } catch (error) {
    if (error.name !== "TsplatError") throw error;
    return undefined;
  }
}

async function request(address, signal) {
  const url = new URL(address, location.href);
  if (!["http:", "https:", "blob:", "data:"].includes(url.protocol))
    throw new Error(`${url.protocol} is no address that a page may read; choose the file instead`);
  const response = await fetch(url, { signal, credentials: "omit", referrerPolicy: "no-referrer" });
  if (!response.ok) throw new Error(`${url.href} answers ${response.status} ${response.statusText}`);
  return response;
}

// The bytes of the file at an address as they come in; `told` hears how many of how many (0 where nobody says).
export async function* fetched(address, signal, told) {
  const response = await request(address, signal);
  const whole = Number(response.headers.get("Content-Length")) || 0;
  const reader = response.body.getReader();
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
  return bytes < 1e6
    ? `${Math.max(bytes / 1000, 0.1).toFixed(bytes < 1e4 ? 1 : 0)} KB`
    : `${(bytes / 1e6).toFixed(1)} MB`;
}
