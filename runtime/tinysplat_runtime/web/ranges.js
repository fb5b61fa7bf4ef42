/** Ranges of a file on a web server, none of whose answers is believed: it says which bytes it sends, and sends no more. */
import { TsplatError, require } from "./errors.js";

const SILENT_MS = 20000;

/**
 * What reads ranges of the file at an address.
 *
 * @param {string | URL} url
 * @param {AbortSignal} [signal]
 * @param {number} [silentMs] how long the server may say nothing
 * @returns {(offset: number, length: number) => Promise<Uint8Array>}
 */
export function rangesOf(url, signal, silentMs = SILENT_MS) {
  const where = String(url);
  return async (offset, length) => {
    const gaveUp = new AbortController();
    const both = AbortSignal.any([gaveUp.signal, ...(signal ? [signal] : [])]);
    const slow = new TsplatError(`the server says nothing for ${silentMs / 1000} s`, where);
    let timer = setTimeout(() => gaveUp.abort(slow), silentMs);
    try {
      const asked = `bytes ${offset}-${offset + length - 1}`;
      const response = await fetch(url, { headers: { Range: asked.replace(" ", "=") }, signal: both });
      const { status, headers, body } = response;
      const none = "the server gives no ranges of a file, which reading it in parts needs";
      require(status === 206, status === 200 ? `${none}; download it and decode the whole` : `the server answers ${status}`, where);
      const stated = headers.get("Content-Range"); // which servers of other origins may hide
      require(!stated || stated.split("/")[0] === asked, `Content-Range '${stated?.slice(0, 60)}' where ${asked} were asked for`, where);
      const parts = [];
      let received = 0;
      for await (const part of chunksOf(/** @type {ReadableStream<Uint8Array>} */ (body))) {
        received += part.length;
        require(received <= length, `the server sends more than the ${length} bytes that were asked for`, where);
        parts.push(part);
        clearTimeout(timer);
        timer = setTimeout(() => gaveUp.abort(slow), silentMs);
      }
      return new Uint8Array(await new Blob(/** @type {any} */ (parts)).arrayBuffer());
    } finally {
      clearTimeout(timer);
      gaveUp.abort(); // nothing more of the body is received
    }
  };
}

/** What a stream brings: not every browser iterates over one. @param {ReadableStream<Uint8Array>} stream */
export async function* chunksOf(stream) {
  const reader = stream.getReader();
  try {
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return;
      yield value;
    }
  } finally {
    void reader.cancel().catch(() => undefined);
  }
}
