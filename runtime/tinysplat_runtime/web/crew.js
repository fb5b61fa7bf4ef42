/** Pictures decoded on several workers where there are any, and else here, with pauses. */
import { TsplatError } from "./errors.js";
import { PictureDecoder } from "./hevc/picture.js";

/**
 * A picture to decode. `width` and `height` are those wanted of the luma of a picture coded as `codedWidth` ×
 * `codedHeight`; `chroma` 1 has three planes, which are wanted whole.
 *
 * @typedef {object} Job
 * @property {Uint8Array} sets parameter sets
 * @property {Uint8Array} data slice NAL unit
 * @property {number} width
 * @property {number} height
 * @property {number} codedWidth
 * @property {number} codedHeight
 * @property {number} chroma
 * @property {number} bits
 * @property {string} where for messages
 */

/**
 * @typedef {object} Task
 * @property {Job} job
 * @property {AbortSignal} signal
 * @property {(planes: Uint16Array[]) => void} resolve
 * @property {(reason: unknown) => void} reject
 */

const NAME = "tsplat-pictures";
const MOST_WORKERS = 8;
/** Bytes of pictures, of all files so far, from which workers pay: each has to compile what is compiled here by then. */
const WORTH_WORKERS = 1 << 19;
const IDLE_MS = 10000;
/** At most so long is nothing else done where there are no workers. */
const SLICE_MS = 12;
const PER_WORKER = 2;

/** @type {any} */
const host = globalThis;
const isNode = Boolean(host.process?.versions?.node) && !host.Deno;

/** @param {string} name of a module of node's */
function nodeModule(name) {
  return isNode ? host.process.getBuiltinModule?.(`node:${name}`) : undefined;
}

/** Decoders by what they were made from: files have one or two. @type {Map<string, PictureDecoder>} */
const decoders = new Map();

/** A decoder for pictures like a job's. @param {Job} job */
function decoderOf({ sets, codedWidth, codedHeight, chroma, bits }) {
  const key = [codedWidth, codedHeight, chroma, bits, sets].join();
  const known = decoders.get(key);
  if (known) return known;
  if (decoders.size >= 4) decoders.clear();
  const decoder = new PictureDecoder(sets, codedWidth, codedHeight, chroma, bits);
  decoders.set(key, decoder);
  return decoder;
}

/**
 * Decode a picture here and now.
 *
 * @param {Job} job
 * @returns {Uint16Array[]}
 */
function decodePicture(job) {
  const { width, height, chroma } = job;
  try {
    const decoder = decoderOf(job);
    const { left, top } = decoder.sps;
    const planes = decoder.decode(job.data);
    if (chroma) return planes.map((plane) => plane.samples.slice());
    const { samples, width: stride } = planes[0];
    const out = new Uint16Array(width * height);
    for (let y = 0; y < height; y++) {
      const at = (y + top) * stride + left;
      out.set(samples.subarray(at, at + width), y * width);
    }
    return [out];
  } catch (error) {
    if (error instanceof TsplatError) throw new TsplatError(error.message, job.where, error.offset);
    throw error;
  }
}

/** Let other work of this thread happen. @returns {Promise<void>} */
export function breathe() {
  if (host.setImmediate) return new Promise((resolve) => host.setImmediate(resolve));
  return new Promise((resolve) => {
    const { port1, port2 } = new MessageChannel();
    port1.onmessage = () => {
      port1.close();
      resolve();
    };
    port2.postMessage(0);
  });
}

/** One worker, of the browser's kind or node's. */
class Helper {
  /** @param {Crew} crew */
  constructor(crew) {
    this.crew = crew;
    /** @type {Map<number, Task>} */
    this.tasks = new Map();
    this.isReady = false;
    this.worker = startWorker();
    const { worker } = this;
    if (worker.on) {
      worker.on("message", (/** @type {any} */ data) => this.answered(data));
      worker.on("error", () => this.lost());
      worker.unref();
    } else {
      worker.onmessage = (/** @type {MessageEvent} */ event) => this.answered(event.data);
      worker.onerror = (/** @type {Event} */ event) => {
        event.preventDefault();
        this.lost();
      };
    }
  }

  /** @param {number} id @param {Task} task */
  give(id, task) {
    if (this.tasks.size === 0) this.worker.ref?.();
    this.tasks.set(id, task);
    const { job } = task;
    this.worker.postMessage({ id, job: { ...job, data: job.data.slice(), sets: job.sets.slice() } });
  }

  /** @param {any} data */
  answered({ id, planes, error }) {
    if (id === undefined) {
      this.isReady = true;
    } else {
      const task = this.tasks.get(id);
      this.tasks.delete(id);
      if (this.tasks.size === 0) this.worker.unref?.();
      if (planes) task?.resolve(planes);
      else
        task?.reject(
          error.section ? new TsplatError(error.message, error.section, error.offset) : new Error(error.message),
        );
    }
    this.crew.feed();
  }

  /** The worker could not be started, or died: what it was at is done by others. */
  lost() {
    this.worker.terminate();
    this.crew.dismiss(this);
  }
}

/** @returns {any} */
function startWorker() {
  const { url } = import.meta;
  const address = url.startsWith("blob:") || url.startsWith("data:") ? url : new URL("./tsplat.js", url);
  const threads = nodeModule("worker_threads");
  if (threads) return new threads.Worker(address, { workerData: NAME });
  if (address === url) return new Worker(url, { type: "module", name: NAME });
  return new Worker(new URL("./tsplat.js", import.meta.url), { type: "module", name: NAME });
}

/** The workers of this thread, started when there is work for them and let go when there has been none for a while. */
class Crew {
  constructor() {
    /** @type {Helper[]} */
    this.helpers = [];
    /** @type {Task[]} */
    this.queue = [];
    this.ids = 0;
    /** Workers that there may be. */
    this.wanted = 0;
    /** Of all pictures so far. */
    this.bytes = 0;
    this.isAtWork = false;
    this.canStart = true;
    /** @type {any} */
    this.timer = undefined;
  }

  /** Start the workers that are wanted, once they are worth it. */
  hire() {
    if (this.bytes < WORTH_WORKERS || !this.canStart) return;
    try {
      while (this.helpers.length < Math.min(this.wanted, MOST_WORKERS)) this.helpers.push(new Helper(this));
    } catch {
      this.canStart = false; // a page's policy forbids them
    }
  }

  /**
   * @param {Job} job
   * @param {AbortSignal} signal
   * @returns {Promise<Uint16Array[]>}
   */
  run(job, signal) {
    this.bytes += job.data.length;
    this.hire();
    return new Promise((resolve, reject) => {
      this.queue.push({ job, signal, resolve, reject });
      this.feed();
    });
  }

  /** @param {Helper} helper */
  dismiss(helper) {
    this.canStart = false;
    this.helpers = this.helpers.filter((other) => other !== helper);
    this.queue.unshift(...helper.tasks.values());
    this.feed();
  }

  /** The next task that has not been aborted. */
  next() {
    for (;;) {
      const task = this.queue.shift();
      if (!task?.signal.aborted) return task;
      task.reject(task.signal.reason);
    }
  }

  feed() {
    const ready = this.helpers.filter((helper) => helper.isReady);
    for (let round = 0; round < PER_WORKER; round++) {
      for (const helper of ready) {
        if (helper.tasks.size > round) continue;
        const task = this.next();
        if (task) helper.give(this.ids++, task);
      }
    }
    clearTimeout(this.timer);
    if (ready.length === 0) {
      if (!this.isAtWork && this.queue.length) void this.work();
    } else if (this.queue.length === 0 && ready.every((helper) => helper.tasks.size === 0)) {
      this.timer = setTimeout(() => this.leave(), IDLE_MS);
      this.timer.unref?.();
    }
  }

  leave() {
    for (const { worker } of this.helpers) worker.terminate();
    this.helpers = [];
  }

  /** Decode here, until there are workers to do it. */
  async work() {
    this.isAtWork = true;
    await breathe();
    let since = performance.now();
    while (!this.helpers.some((helper) => helper.isReady)) {
      const task = this.next();
      if (!task) break;
      try {
        task.resolve(decodePicture(task.job));
      } catch (error) {
        task.reject(error);
      }
      if (performance.now() - since > SLICE_MS) {
        await breathe();
        since = performance.now();
      }
    }
    this.isAtWork = false;
    if (this.queue.length) this.feed();
  }
}

export const crew = new Crew();

/** Threads that this machine runs at a time. */
export function processors() {
  return host.navigator?.hardwareConcurrency ?? nodeModule("os")?.availableParallelism() ?? 1;
}

/** Decode what is sent here, if this is a worker that a crew started. */
export function serve() {
  const threads = nodeModule("worker_threads");
  const port = threads
    ? threads.workerData === NAME
      ? threads.parentPort
      : undefined
    : host.name === NAME
      ? host
      : undefined;
  if (!port || (!threads && typeof host.WorkerGlobalScope === "undefined")) return;
  /** @param {{ id: number, job: Job }} message */
  const answer = ({ id, job }) => {
    try {
      const planes = decodePicture(job);
      port.postMessage(
        { id, planes },
        planes.map((plane) => plane.buffer),
      );
    } catch (caught) {
      const error = /** @type {TsplatError} */ (caught);
      port.postMessage({ id, error: { message: error.message, section: error.section, offset: error.offset } });
    }
  };
  if (port.on) port.on("message", answer);
  else port.onmessage = (/** @type {MessageEvent} */ event) => answer(event.data);
  port.postMessage({});
}
