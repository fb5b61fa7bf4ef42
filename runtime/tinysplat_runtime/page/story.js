// A story: named views in order and notes on points (story.py has the file), shown, played, made and saved. Carried by
// pages that have one. What strangers wrote is text, and never markup.
import { add, scaled } from "./vectors.js";
import { viewFrom, viewText } from "./view.js";

const CELL_PX = 16; // of the picture, that hides what lies behind its nearest surface
const BEHIND = 0.9; // of a note's distance, in which a surface hides it
const SOLID_NOTE = 0.4; // opacity of what hides
const REST_MS = 150; // after a frame, before notes are looked for behind things
const LIMITS = { title: 120, text: 1000, note: 120, views: 200, notes: 1000 };

const made = (name, about = {}, ...children) => {
  const element = Object.assign(document.createElement(name), about);
  for (const [key, value] of Object.entries(about)) if (key.startsWith("aria-")) element.setAttribute(key, value);
  element.append(...children);
  return element;
};

function saved(name, text, type) {
  const link = made("a", { href: URL.createObjectURL(new Blob([text], { type })), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

export class Story {
  page;
  story;
  source;
  at;
  timer;
  title;
  text;
  before;
  next;
  player;
  bar;
  notes;
  form;
  spots;
  resting;
  // page: page.js; story: what story.py gives; source: the page's own text, empty where it does not carry its file.
  constructor(page, story, source) {
    Object.assign(this, { page, story, source, at: -1, timer: 0 });
    const button = (text, label, onclick) =>
      made("button", { type: "button", textContent: text, "aria-label": label, onclick });
    this.title = made("strong");
    this.text = made("span");
    this.before = button("‹", "The view before", () => this.go(this.at - 1));
    this.next = button("›", "The next view", () => this.go(this.at + 1));
    this.player = button("▶", "Play", () => (this.timer ? this.stop() : this.play()));
    this.bar = made(
      "nav",
      { id: "story", "aria-label": "Views of the story" },
      this.before,
      made("p", { "aria-live": "polite" }, this.title, " ", this.text),
      this.player,
      this.next,
    );
    this.notes = made("div", { id: "notes" });
    page.viewer.canvas.parentElement.append(this.notes);
    document.getElementById("way").after(this.bar);
    for (const name of ["pointerdown", "wheel", "keydown"])
      page.viewer.canvas.addEventListener(name, () => this.stop());
    this.#edit(button);
    this.#list();
  }

  // Once the scene shows: at the first view, and on from there.
  begin(isLinked) {
    if (!isLinked) this.go(0, true);
    if (this.story.seconds && !this.page.viewer.isStill && !isLinked) this.play();
  }

  go(at, isAtOnce) {
    const found = this.story.views[at];
    const place = found && viewFrom(found.view, this.page.viewer.scene.frame);
    if (place) {
      this.at = at;
      this.page.goTo(place, isAtOnce);
    }
    this.#shown();
  }

  play() {
    clearTimeout(this.timer);
    const { seconds, views } = this.story;
    this.timer = setTimeout(
      () => {
        this.go((this.at + 1) % views.length);
        this.play();
      },
      1000 * (seconds || 5),
    );
    this.#shown();
  }

  stop() {
    clearTimeout(this.timer);
    this.timer = 0;
    this.#shown();
  }

  #shown() {
    const { views } = this.story;
    const found = views[this.at];
    const isPlaying = this.timer > 0;
    this.bar.hidden = !views.length;
    document.body.classList.toggle("told", views.length > 0);
    this.title.textContent = found?.title ?? "";
    this.text.textContent = found?.text ?? "";
    [this.before.disabled, this.next.disabled] = [this.at < 1, this.at >= views.length - 1];
    this.player.hidden = views.length < 2;
    this.player.textContent = isPlaying ? "❚❚" : "▶";
    this.player.setAttribute("aria-label", isPlaying ? "Pause" : "Play");
    if (found && this.form) [this.form.title.value, this.form.text.value] = [found.title, found.text];
  }

  // Notes where they show, over the picture that was drawn.
  draw() {
    const { camera, canvas, scene } = this.page.viewer;
    if (!scene || !this.story.notes.length) return;
    const { clientWidth: width, clientHeight: height } = canvas;
    const show = camera.shown(width, height);
    const { scale, centre } = scene.frame;
    this.spots = this.story.notes.map(({ at }, i) => {
      const [x, y, z] = show(scaled(add(at, centre, -1), scale));
      const element = this.notes.children[i];
      const isInside = z > scene.nearPlane && x > 0 && y > 0 && x < width && y < height;
      element.hidden = !isInside;
      if (isInside) [element.style.left, element.style.top] = [`${x}px`, `${y}px`];
      return { x, y, z, isInside };
    });
    clearTimeout(this.resting);
    this.resting = setTimeout(() => this.#hide(), REST_MS);
  }

  // Notes behind things turn away.
  #hide() {
    const { viewer } = this.page;
    const { camera, canvas, cloud, scene } = viewer;
    const { clientWidth: width, clientHeight: height } = canvas;
    const show = camera.shown(width, height);
    const columns = Math.ceil(width / CELL_PX) + 2;
    const nearest = new Float32Array(columns * (Math.ceil(height / CELL_PX) + 2)).fill(Infinity);
    // With a margin of one.
    const cellOf = (x, y) => (Math.floor(y / CELL_PX) + 1) * columns + Math.floor(x / CELL_PX) + 1;
    for (let i = 0; i < cloud.opacities.length; i++) {
      if (cloud.opacities[i] < SOLID_NOTE) continue;
      const [x, y, z] = show(cloud.means.subarray(3 * i, 3 * i + 3));
      if (!(z > scene.nearPlane && x >= 0 && y >= 0 && x < width && y < height)) continue;
      const cell = cellOf(x, y);
      nearest[cell] = Math.min(nearest[cell], z);
    }
    this.spots.forEach(({ x, y, z, isInside }, i) => {
      const cell = isInside ? cellOf(x, y) : 0;
      // As surfaces have gaps.
      const about = [-columns, 0, columns].flatMap((row) => [-1, 0, 1].map((by) => nearest[cell + row + by]));
      this.notes.children[i]?.classList.toggle("behind", isInside && Math.min(...about) < BEHIND * z);
    });
  }

  // The notes' elements, and which view is shown.
  #list() {
    this.notes.replaceChildren(
      ...this.story.notes.map(({ text }) => made("p", { className: "note", textContent: text, tabIndex: 0 })),
    );
    this.#shown();
  }

  #edit(button) {
    const { page, story } = this;
    const { viewer } = page;
    const field = (name, label, most) =>
      made("input", { name, maxLength: most, "aria-label": label, placeholder: label });
    const change = (act) => () => {
      act();
      this.stop();
      this.#list();
      this.draw();
    };
    const written = () => ({
      title: this.form.title.value,
      text: this.form.text.value,
      view: viewText(viewer.camera, viewer.scene.frame, viewer.cloud.depth),
    });
    const swap = (by) => {
      const to = this.at + by;
      const { views } = story;
      if (views[this.at] && views[to]) [views[this.at], views[to], this.at] = [views[to], views[this.at], to];
    };
    const title = field("title", "Title of the view", LIMITS.title);
    const text = field("text", "A line of text", LIMITS.text);
    const note = field("note", "A note on the middle of the picture", LIMITS.note);
    this.form = { title, text };
    const rows = [
      made("p", {}, title, text),
      made(
        "p",
        {},
        button(
          "Add this view",
          null,
          change(() => {
            if (story.views.length < LIMITS.views) story.views.splice(++this.at, 0, written());
          }),
        ),
        button(
          "Replace",
          "Replace the view",
          change(() => {
            if (story.views[this.at]) story.views[this.at] = written();
          }),
        ),
        button(
          "Remove",
          "Remove the view",
          change(() => {
            story.views.splice(this.at, 1);
            this.at = Math.min(this.at, story.views.length - 1);
          }),
        ),
        button(
          "←",
          "Move the view forward",
          change(() => swap(-1)),
        ),
        button(
          "→",
          "Move the view back",
          change(() => swap(1)),
        ),
      ),
      made(
        "p",
        {},
        note,
        button(
          "Add the note",
          null,
          change(() => {
            const { clientWidth, clientHeight } = viewer.canvas;
            const { scale, centre } = viewer.scene.frame;
            const at = add(centre, viewer.pointAt(clientWidth / 2, clientHeight / 2), 1 / scale);
            if (note.value && story.notes.length < LIMITS.notes) story.notes.push({ at, text: note.value });
            note.value = "";
          }),
        ),
        button(
          "Remove the last note",
          null,
          change(() => story.notes.pop()),
        ),
      ),
      made(
        "p",
        {},
        button("Save the story", null, () => saved("story.json", JSON.stringify(story, null, 1), "application/json")),
        ...(this.source ? [button("Save the page", null, () => saved("page.html", this.pageText(), "text/html"))] : []),
      ),
    ];
    const seconds = made("input", {
      type: "number",
      min: 0,
      max: 600,
      value: story.seconds,
      oninput: () => {
        story.seconds = Math.min(Math.max(Number(seconds.value) || 0, 0), 600);
      },
    });
    rows.splice(3, 0, made("label", {}, "seconds at each view, 0 to wait ", seconds));
    document
      .getElementById("details")
      .before(made("details", { id: "editor" }, made("summary", { textContent: "Tell a story" }), ...rows));
  }

  // The page with the story as it is now.
  pageText() {
    const given = JSON.stringify({ ...this.page.given, story: this.story }).replaceAll("<", "\\u003c");
    return this.source.replace(/(<script type="application\/json" id="scene">)[^<]*/, (_, start) => start + given);
  }
}
