// Puts the page together: its scene, its panel and its words.
import { makeCloud } from "./cloud.js";
import { bytesByUse, described, fetched, inKilobytes, paced } from "./files.js";
import { frontView } from "./front.js";
import { sceneOf } from "./scene.js";
import { Tools } from "./tools.js";
import { viewFrom, viewText } from "./view.js";
import { Viewer } from "./viewer.js";

/** @type {(id: string) => any} */
const find = (id) => document.getElementById(id);
const SAYS = "it is made into a .tsplat file by: tinysplat"; // what other files are, by how they begin
/** @type {[RegExp, string][]} */
const OTHERS = [
  [/^\x1f\x8b/, "gzip, as .spz files are; " + SAYS + " compress F.spz -o F.tsplat"],
  [/^NGSP/, "a .spz file; " + SAYS + " compress F.spz -o F.tsplat"],
  [/^ply\r?\n/, "a .ply file; " + SAYS + " compress F.ply -o F.tsplat"],
  [/^PK/, "a zip archive, as .sog files are; " + SAYS + " compress F.sog -o F.tsplat"],
  [/^glTF/, "a glTF file; " + SAYS + " compress F.glb -o F.tsplat"],
  [
    /^(\xff\xd8|\x89PNG|RIFF....WEBP|....ftyp(hei|mif|avif))/s,
    "a photo; a folder of them is made into a .tsplat file by: tinysplat poses FOLDER -o SCENE, tinysplat encode SCENE -o F.tsplat",
  ],
  [
    /^(....ftyp|\x1aE\xdf\xa3)/s,
    "a video; it is made into a .tsplat file by: tinysplat poses F.mp4 -o SCENE, tinysplat encode SCENE -o F.tsplat",
  ],
  [/^\s*</, "a web page, not a scene"],
];
const MAGIC_BYTES = 16;
const HINT_MS = 9000;
const THREADS = globalThis.origin === "null" ? 0 : undefined; // pages from disk may not start workers that are modules
const MOST = { maxPixels: 2 ** 25, maxMemory: 2 ** 31, maxPerByte: 256 }; // of what strangers send: docs/PLAYER.md
const FIRST = "first picture"; // a mark of the browser's clock, for measurements

class Panel {
  // link(): the address of what shows now.
  constructor(viewer, link) {
    this.viewer = viewer;
    this.link = link;
    this.scene = null;
    this.photos = [];
    this.#listen();
  }

  // A scene, and what tsplat.js says of its file.
  show(scene, cloud, about) {
    const { views, hasCameras } = scene;
    const { attribution, licence } = about.notes;
    this.scene = scene;
    find("summary").textContent = [
      `${scene.count.toLocaleString("en")} Gaussians, colours of degree ${Math.sqrt(cloud.functions) - 1}, mode ${about.mode}${about.profile ? `, profile ${about.profile}` : ""}`,
      bytesByUse(about)
        .map(([use, bytes]) => `${use} ${inKilobytes(bytes)}`)
        .join(", "),
      [attribution, licence].filter(Boolean).join(", "),
    ]
      .filter(Boolean)
      .join("; ");
    find("panel").hidden = false;
    find("way").hidden = !hasCameras || views.length < 2;
    find("linkRow").hidden = !/^(http|file)/.test(location.protocol);
    find("freeRow").hidden = !hasCameras;
    find("fliesRow").hidden = hasCameras;
    find("place").max = views.length;
    this.shown();
  }

  // What of the file is there: a line beside the title.
  tell(views, received, whole) {
    const photos = views ? `${views} ${views > 1 ? "photos" : "photo"} · ` : "";
    find("caption").textContent =
      photos +
      (received < whole ? `${Math.floor((100 * received) / whole)} % of ${inKilobytes(whole)}` : inKilobytes(whole));
  }

  #listen() {
    const { viewer } = this;
    find("place").oninput = () => this.select(viewer.order[find("place").value - 1]);
    find("before").onclick = () => viewer.step(-1);
    find("after").onclick = () => viewer.step(1);
    find("depth").oninput = () => viewer.showDepth(find("depth").checked);
    find("opacity").oninput = () => {
      viewer.showOpaque(Number(find("opacity").value));
      find("opacity").setAttribute("aria-valuetext", `below ${Math.round(100 * find("opacity").value)} %`);
    };
    find("swing").checked = viewer.isSwinging;
    find("swing").onchange = () => viewer.swing(find("swing").checked);
    find("free").onchange = () => {
      viewer.setFree(find("free").checked);
      find("fliesRow").hidden = !find("free").checked;
    };
    find("flies").onchange = () => {
      viewer.free.flies = find("flies").checked;
    };
    find("back").onclick = () => {
      viewer.back();
      viewer.canvas.focus();
    };
    find("link").onclick = async () => {
      find("link").textContent = (await copied(this.link())) ? "Copied" : "The address bar has the link";
      setTimeout(() => {
        find("link").textContent = words;
      }, 2000);
    };
    const compare = (isAsked) => {
      this.compares = isAsked;
      // What moves stops at a photo's place.
      if (isAsked && this.scene && viewer.isSwinging) viewer.select(viewer.nearest()[0]);
      this.shown();
    };
    const words = find("link").textContent;
    const isC = ({ code, ctrlKey, metaKey }) => code === "KeyC" && !ctrlKey && !metaKey;
    find("compare").onpointerdown = () => compare(true);
    for (const name of ["pointerup", "pointercancel", "blur"])
      addEventListener(name, () => {
        if (this.compares) compare(false);
      });
    find("compare").onclick = ({ detail }) => {
      if (!detail) compare(!this.compares);
    }; // by a key
    addEventListener("keydown", (event) => {
      if (isC(event) && !this.compares) compare(true);
    });
    addEventListener("keyup", (event) => {
      if (isC(event)) compare(false);
    });
  }

  select(i) {
    this.viewer.select(i);
    this.shown();
  }

  shown() {
    const { viewer, scene } = this;
    if (!scene) return;
    const { current } = viewer;
    const photo = this.photos[current];
    const at = viewer.order.indexOf(current) + 1;
    const { length } = viewer.order;
    find("place").value = at;
    find("placeOf").textContent = `${at} / ${length}`;
    find("place").setAttribute("aria-valuetext", `${at} of ${length}`);
    [find("before").disabled, find("after").disabled] = [at === 1, at === length];
    find("swing").checked = viewer.isSwinging;
    find("compareRow").hidden = !photo;
    find("photo").hidden = !photo || !this.compares;
    if (photo) find("photo").src = photo;
    find("back").hidden = !viewer.isAway && current === viewer.start;
  }
}

// Whether a text is in the clipboard.
async function copied(text) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    return false; // not allowed here
  }
}

function hint(isTouch) {
  const words = find("hint");
  words.textContent = isTouch
    ? "Drag to look around · pinch to come closer · tap twice to return"
    : "Drag to look around · scroll to come closer · double click to return";
  words.hidden = false;
  setTimeout(() => words.classList.add("done"), HINT_MS);
}

// What was given in place of a scene, by its first bytes.
function refuseForeign(chunk) {
  const start = String.fromCharCode(...chunk.subarray(0, MAGIC_BYTES));
  const found = OTHERS.find(([sign]) => sign.test(start));
  if (found) throw Object.assign(new Error(`this is ${found[1]}`), { name: "TsplatError" });
}

// Options of the address, behind ? and #.
const optionsOf = ({ search, hash }) => new URLSearchParams(`${search.slice(1)}&${hash.slice(1)}`);

// Whether there are no colours yet, in a prefix that has forms alone.
const isGrey = ({ sh, degree, count }) => {
  for (let i = 0, stride = 3 * (degree + 1) ** 2; i < count; i += 1 + (count >> 10))
    if (Math.abs(sh[stride * i] - sh[stride * i + 1]) + Math.abs(sh[stride * i] - sh[stride * i + 2]) > 0.01)
      return false;
  return true;
};

const picturesOf = ({ channels }) => channels.flat().reduce((sum, { bytes }) => sum + bytes.length, 0) || 1;

// What a part of a file shows.
function shareOf({ count }, about) {
  return count < about.count
    ? `${count.toLocaleString("en")} of ${about.count.toLocaleString("en")} Gaussians`
    : "all of it in less detail";
}

const nextFrame = () =>
  new Promise((done) => {
    requestAnimationFrame(() => setTimeout(done));
  });

class Page {
  decoder;
  given;
  story;
  isBare;
  isEmbedded;
  first;
  constructor(decoder, given, options) {
    const isBare = options.has("bare");
    const isEmbedded = options.has("embed");
    const isStill = options.has("still") || matchMedia("(prefers-reduced-motion: reduce)").matches;
    document.body.classList.toggle("bare", isBare);
    document.body.classList.toggle("embed", isEmbedded);
    Object.assign(this, {
      decoder,
      given,
      isBare,
      isEmbedded,
      first: options.has("camera") ? Number(options.get("camera")) : given.first,
    });
    this.linked = isBare ? null : options.get("view");
    this.viewer = new Viewer(
      find("view"),
      {
        drawn: () => this.#drawn(),
        moved: () => this.panel.shown(),
        touched: () => {
          find("hint").classList.add("done");
          this.panel.shown();
        },
        rested: () => this.#rested(),
      },
      { isBare, isEmbedded, isStill, background: given.background },
    );
    for (const name of ["popstate", "hashchange"]) addEventListener(name, () => this.#follow());
    this.viewer.canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.viewer.lose();
    });
    this.viewer.canvas.addEventListener("webglcontextrestored", () => {
      this.isAgain = true;
      this.reopen?.()?.catch((error) => this.fail(error));
    });
    this.panel = new Panel(this.viewer, () => this.#address());
    this.tools = new Tools(this.viewer, find("found"), { measure: find("measure"), crop: find("crop") });
    globalThis.page = this.viewer; // for the console, and for checks
  }

  // To the view that the address has.
  #follow() {
    const text = optionsOf(location).get("view");
    if (this.isBare || !this.viewer.scene || text === this.linked) return;
    this.linked = text;
    if (!this.#goLinked()) this.viewer.back();
  }

  #goLinked(isAtOnce) {
    const found = viewFrom(this.linked, this.viewer.scene.frame);
    if (found) this.goTo(found, isAtOnce);
    return Boolean(found);
  }

  // To a view as addresses and stories have it.
  goTo({ zoom, ...pose }, isAtOnce) {
    const { bound } = this.viewer;
    this.viewer.goTo(bound ? { ...pose, K: bound.foot(pose).K } : pose, isAtOnce, zoom);
    this.viewer.touched = this.viewer.isAway = true;
    this.panel.shown();
  }

  #view() {
    return viewText(this.viewer.camera, this.viewer.scene.frame, this.viewer.cloud.depth);
  }

  #address(view = this.#view()) {
    const kept = location.hash
      .slice(1)
      .split("&")
      .filter((part) => part && !/^(view|camera)=/.test(part));
    return `${location.href.split("#")[0]}#${[...kept, `view=${view}`].join("&")}`;
  }

  // The address is that of the view, once the camera rests where somebody has led it.
  #rested() {
    const { isSwinging, isAway, current, start } = this.viewer;
    if (this.isBare || isSwinging || (!isAway && current === start && !this.linked)) return;
    const text = this.#view();
    if (text === this.linked) return;
    this.linked = text;
    try {
      history.replaceState(null, "", this.#address(text));
    } catch {
      // where the address is none of the page's own, as in srcdoc
    }
  }

  #drawn() {
    if (!performance.getEntriesByName(FIRST).length) performance.mark(FIRST);
    find("cover").classList.add("done");
    this.tools.draw();
    this.story?.draw();
    this.wake?.();
  }

  #whenDrawn() {
    return new Promise((done) => {
      this.wake = done;
      setTimeout(done, 1000);
    });
  }

  fail(error) {
    if (error.name === "AbortError") return;
    this.viewer.clear();
    for (const id of ["panel", "way", "back", "hint", "photo"]) find(id).hidden = true;
    this.#say(`This scene cannot be shown: ${error.message ?? error}`);
    find("cover").classList.add("done");
    if (error.name !== "TsplatError") console.error(error); // a file's fault is said, ours is to be found
  }

  #say(text) {
    find("fault").textContent = text;
    find("fault").hidden = false;
  }

  // For a file that takes the place of what is shown.
  #begin(name) {
    this.opening?.abort();
    this.opening = new AbortController();
    this.tools.reset();
    find("open").hidden = find("fault").hidden = true;
    find("cover").classList.remove("done");
    delete document.body.dataset.whole;
    find("status").textContent = "Loading …";
    if (name) document.title = find("name").textContent = name;
    return this.opening.signal;
  }

  // Shows a file of which there are chunks, better and better. about: what tsplat.js says of it, where it has been
  // asked.
  async open(name, chunks, whole, about = undefined) {
    const signal = this.#begin(name);
    const parts = [];
    let frame = null;
    let received = 0;
    let isSame = this.isAgain;
    this.isAgain = false;
    const kept = async function* () {
      for await (const chunk of chunks(signal)) {
        if (!parts.length) refuseForeign(chunk);
        parts.push(chunk);
        yield chunk;
      }
    };
    const held = async () => new Uint8Array(await new Blob(parts).arrayBuffer());
    const show = (decoded, isAll = !decoded.missing.length) => {
      if (signal.aborted || (!isAll && !decoded.cameras.length && isGrey(decoded))) return;
      const scene = sceneOf(decoded, this.given.cameras, frame);
      const cloud = makeCloud(scene);
      const isFirst = !frame && !isSame;
      this.viewer.show(scene, cloud, !isFirst, this.first in scene.views ? this.first : frontView(scene.views));
      frame = scene.frame;
      isSame = true;
      this.panel.show(scene, cloud, about);
      this.tools.unit = about.notes.unit;
      this.panel.tell(scene.hasCameras ? scene.views.length : 0, decoded.received ?? received, whole || about.bytes);
      if (isFirst) this.#begun();
    };
    const options = {
      signal,
      threads: THREADS,
      limits: MOST,
      onPicture: () => {
        if (about)
          find("status").textContent =
            `Loading … ${Math.min(99, Math.floor((100 * ++this.pictures) / picturesOf(about)))} %`;
      },
    };
    this.pictures = 0;
    try {
      for await (const decoded of this.decoder.decodeStream(kept(), options)) {
        about ??= this.decoder.inspect(await held());
        show(decoded);
      }
    } catch (error) {
      const bytes = await held();
      received = bytes.length;
      about ??= described(this.decoder.inspect, bytes);
      if (error.name !== "TsplatError" || !about || about.bytes <= bytes.length) throw error;
      const decoded = await this.decoder.decode(bytes, { ...options, maxBytes: received });
      show(decoded, true);
      this.#say(
        `This file is cut short: ${inKilobytes(received)} of ${inKilobytes(about.bytes)}, which show ${shareOf(decoded, about)}.`,
      );
    }
    document.body.dataset.whole = "";
  }

  // Once something can be seen: to what the address names, and a word on how to look around.
  #begun() {
    const isLinked = this.linked && this.#goLinked(true);
    if (this.story) this.story.begin(isLinked || this.isBare);
    else if (!isLinked && !this.isBare && !this.isEmbedded) hint(matchMedia("(pointer: coarse)").matches);
  }

  async openOwn(bytes) {
    this.reopen = () => this.openOwn(bytes);
    const about = this.decoder.inspect(bytes);
    const steps = this.isBare || find("poster") ? [] : about.steps;
    return this.open("", () => paced(bytes, steps, () => this.#whenDrawn()), bytes.length, about);
  }

  async openChosen(file) {
    this.reopen = () => this.openChosen(file);
    this.panel.photos = [];
    this.first = undefined;
    return this.open(file.name.replace(/\.tsplat$/, ""), () => file.stream(), file.size);
  }

  // name: what the file is called, if not as its address ends.
  async openAddress(address, given) {
    this.reopen = () => this.openAddress(address, given);
    const name =
      given ?? decodeURIComponent(new URL(address, location.href).pathname.split("/").at(-1)).replace(/\.tsplat$/, "");
    const told = (received, whole) => {
      find("status").textContent = whole
        ? `Loading … ${Math.floor((100 * received) / whole)} %`
        : `Loading … ${inKilobytes(received)}`;
    };
    return this.open(name, (signal) => fetched(address, signal, told), 0);
  }

  listen() {
    // for files that are dropped or chosen
    const take = (file) => {
      if (file) this.openChosen(file).catch((error) => this.fail(error));
    };
    find("chosen").onchange = () => take(find("chosen").files[0]);
    find("open").onsubmit = (event) => event.preventDefault();
    addEventListener("dragover", (event) => {
      event.preventDefault();
      document.body.classList.add("dropping");
    });
    addEventListener("dragleave", (event) => {
      if (!event.relatedTarget) document.body.classList.remove("dropping");
    });
    addEventListener("drop", (event) => {
      event.preventDefault();
      document.body.classList.remove("dropping");
      take(event.dataTransfer.files[0]);
    });
  }
}

// Until a page within another is tapped.
const tapped = () =>
  new Promise((done) => {
    const button = find("begin");
    [button.hidden, find("status").hidden] = [false, true];
    find("cover").onclick = () => {
      [button.hidden, find("status").hidden, find("cover").onclick] = [true, false, null];
      find("view").focus();
      done();
    };
  });

// decoder: tsplat.js; own: the file that the page carries, empty where it has none; story: story.js, where there is
// one.
export async function start(decoder, own, story) {
  // The text as it came, before anything changes.
  const source = story && own.length ? `<!DOCTYPE html>\n${document.documentElement.outerHTML}` : "";
  find("blocked")?.remove();
  const given = JSON.parse(find("scene").textContent);
  const options = optionsOf(location);
  const page = new Page(decoder, given, options);
  page.panel.photos = given.photos;
  if (story && given.story) page.story = new story.Story(page, given.story, source);
  if (given.isPlayer) page.listen();
  try {
    await nextFrame(); // the poster first
    const isGiven = own.length || given.source || options.get("file");
    if (page.isEmbedded && isGiven) await tapped();
    if (own.length) await page.openOwn(own);
    else if (given.source) await page.openAddress(given.source, "");
    else if (isGiven) await page.openAddress(options.get("file"));
    else [find("open").hidden, find("cover").hidden] = [false, true];
  } catch (error) {
    page.fail(error);
  }
}
