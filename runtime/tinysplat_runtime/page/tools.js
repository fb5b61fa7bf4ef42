// What one measures and crops with, over the picture: two points and the length between them, and a box whose sides one
// drags. Both say the option of `tinysplat convert` that does it, in the file's world.
import { bulkOf, solidOf } from "./front.js";
import { add, clamp, length, mix, scaled } from "./vectors.js";

const OVERLAY = "http://www.w3.org/2000/svg";
const CLICK_PX = 4; // that a click may move
const BESIDE_PX = 2; // of an end, about which a length's uncertainty is measured
const MARGIN = 16; // of the window, that a handle stays within
const KEY_STEP = 0.02; // of the box, that a key moves a side
const EDGES = [0, 1, 2].flatMap((k) =>
  [0, 1, 2, 3]
    .map((n) => [n & 1, n >> 1].reduce((corner, bit, i) => corner | (bit << ((k + 1 + i) % 3)), 0))
    .map((corner) => [corner, corner | (1 << k)]),
);

const rounded = (values, step) =>
  values.map((x) => Number(x.toFixed(Math.max(0, Math.ceil(2 - Math.log10(step || 1))))));
const lengthText = (x, unit) =>
  unit === "metre"
    ? x < 1
      ? `${(100 * x).toPrecision(3)} cm`
      : `${x.toPrecision(3)} m`
    : `${x.toPrecision(4)} ${unit || "units"}`;

export class Tools {
  viewer;
  words;
  buttons;
  held;
  kind;
  points;
  box;
  unit;
  // words: the element that says what was found. buttons: { measure, crop }, which turn them on and off.
  constructor(viewer, words, buttons) {
    Object.assign(this, { viewer, words, buttons, kind: "", points: [], box: null, unit: "" });
    const { canvas } = viewer;
    this.overlay = document.createElementNS(OVERLAY, "svg");
    this.overlay.id = "overlay";
    canvas.after(this.overlay);
    for (const kind of ["measure", "crop"]) buttons[kind].onclick = () => this.use(this.kind === kind ? "" : kind);
    canvas.addEventListener("pointerdown", ({ offsetX, offsetY }) => {
      this.pressed = [offsetX, offsetY];
    });
    canvas.addEventListener("click", ({ offsetX: x, offsetY: y }) => {
      if (Math.hypot(x - this.pressed?.[0], y - this.pressed?.[1]) < CLICK_PX) this.#pick(x, y);
    });
    canvas.addEventListener("keydown", ({ code }) => {
      if (code === "Enter") this.#pick(canvas.clientWidth / 2, canvas.clientHeight / 2);
    });
    addEventListener(
      "dblclick",
      (event) => {
        if (this.kind === "measure" && event.target === canvas) event.stopImmediatePropagation();
      },
      true,
    );
  }

  // kind: "measure", "crop" or "" for none.
  use(kind) {
    this.kind = kind;
    this.points = [];
    for (const [name, button] of Object.entries(this.buttons)) button.setAttribute("aria-pressed", name === kind);
    if (kind === "crop") this.box ??= bulkOf(solidOf(this.viewer.cloud).points);
    this.overlay.replaceChildren();
    this.#say();
    this.draw();
  }

  // For another scene.
  reset() {
    this.box = null;
    this.use("");
  }

  // A point of the page in the file's world.
  #world(point) {
    const { scale, centre } = this.viewer.scene.frame;
    return add(centre, point, 1 / scale);
  }

  #pick(x, y) {
    if (this.kind !== "measure") return;
    if (this.points.length > 1) this.points = [];
    const near = [
      [0, 0],
      [BESIDE_PX, 0],
      [-BESIDE_PX, 0],
      [0, BESIDE_PX],
      [0, -BESIDE_PX],
    ];
    this.points.push(near.map(([dx, dy]) => this.#world(this.viewer.pointAt(x + dx, y + dy))));
    this.#say();
    this.draw();
  }

  #say() {
    const { kind, points, box, unit } = this;
    const [one, other] = points;
    this.words.hidden = !kind;
    if (kind === "crop") {
      const corners = box.map((corner) => this.#world(corner));
      const size = Math.min(...add(corners[1], corners[0], -1));
      this.words.textContent = `Drag the sides. tinysplat convert F -o G --crop=${rounded(corners.flat(), size)}`;
    } else if (kind && !other) {
      this.words.textContent = one
        ? "Now the other end."
        : "Click on one end, or press Enter for the middle of the picture.";
    } else if (kind) {
      const apart = one.flatMap((a) => other.map((b) => length(add(b, a, -1))));
      const [found] = apart;
      const off = Math.sqrt(apart.reduce((sum, x) => sum + (x - found) ** 2, 0) / apart.length);
      const option = `tinysplat convert F -o G --length=${rounded([...one[0], ...other[0]], found)}=`;
      this.words.textContent = `${lengthText(found, unit)} ± ${lengthText(off, unit)}.${unit ? "" : ` To have metres, say how long it is, such as 0.74m: ${option}0.74m`}`;
    }
  }

  // Where points of the page show, [x, y], of a segment as much as lies in front of the camera; null where none does.
  #segment(a, b) {
    const { camera, canvas, scene } = this.viewer;
    const show = camera.shown(canvas.clientWidth, canvas.clientHeight);
    const least = 10 * scene.nearPlane;
    const [za, zb] = [show(a)[2], show(b)[2]];
    if (za < least && zb < least) return null;
    const cut = (point, other, z, w) => (z < least ? mix(point, other, (least - z) / (w - z)) : point);
    return [cut(a, b, za, zb), cut(b, a, zb, za)].map(show);
  }

  #line(a, b) {
    const ends = this.#segment(a, b);
    if (ends) this.#shape("line", { x1: ends[0][0], y1: ends[0][1], x2: ends[1][0], y2: ends[1][1] });
  }

  #shape(name, attributes) {
    const shape = document.createElementNS(OVERLAY, name);
    for (const [key, value] of Object.entries(attributes)) shape.setAttribute(key, value);
    this.overlay.append(shape);
    return shape;
  }

  // Over the picture that was drawn.
  draw() {
    const { kind, points, box } = this;
    const { scale, centre } = this.viewer.scene?.frame ?? {};
    if (!kind) return;
    for (const line of this.overlay.querySelectorAll("line, circle:not([tabindex])")) line.remove();
    if (kind === "measure") {
      const ends = points.map(([world]) => scaled(add(world, centre, -1), scale));
      if (ends.length > 1) this.#line(ends[0], ends[1]);
      for (const end of ends) {
        const at = this.#segment(end, end);
        if (at) this.#shape("circle", { cx: at[0][0], cy: at[0][1], r: 4 });
      }
      return;
    }
    const corner = (bits) => [0, 1, 2].map((k) => box[(bits >> k) & 1][k]);
    for (const [from, to] of EDGES) this.#line(corner(from), corner(to));
    for (let side = 0; side < 6; side++) this.#handle(side);
  }

  // What one drags a side by; it stays the same element, so that it keeps the focus.
  #handle(side) {
    const { box, overlay } = this;
    const k = side >> 1;
    const end = side & 1;
    const middle = mix(box[0], box[1], 0.5).map((x, i) => (i === k ? box[end][k] : x));
    const { clientWidth, clientHeight } = this.viewer.canvas;
    const at = this.#segment(middle, middle)?.[0];
    const inside = (x, size) => (at ? clamp(x, MARGIN, size - MARGIN) : -MARGIN);
    const handle =
      overlay.querySelectorAll("[tabindex]")[side] ??
      this.#shape("circle", {
        r: 9,
        tabindex: 0,
        role: "slider",
        "aria-label": `${"xyz"[k]}, ${end ? "upper" : "lower"} side`,
      });
    handle.setAttribute("cx", inside(at?.[0], clientWidth));
    handle.setAttribute("cy", inside(at?.[1], clientHeight));
    handle.setAttribute("aria-valuenow", rounded(this.#world(box[end]), box[1][k] - box[0][k])[k]);
    handle.onpointerdown = (event) => {
      handle.setPointerCapture(event.pointerId);
      this.viewer.swing(false);
      this.held = event;
    };
    handle.onpointermove = (event) => {
      if (!handle.hasPointerCapture(event.pointerId)) return;
      const dx = event.clientX - this.held.clientX;
      const dy = event.clientY - this.held.clientY;
      this.held = event;
      const unit = middle.map((x, i) => (i === k ? x + 0.01 * (box[1][k] - box[0][k]) : x));
      const [from, to] = this.#segment(middle, unit) ?? [];
      if (!from) return;
      const way = [to[0] - from[0], to[1] - from[1]];
      const square = Math.max(way[0] ** 2 + way[1] ** 2, 0.01);
      this.#move(k, end, (0.01 * (dx * way[0] + dy * way[1])) / square);
    };
    handle.onkeydown = ({ code }) => {
      const by = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 }[code];
      if (by) this.#move(k, end, by * KEY_STEP);
    };
  }

  #move(k, end, share) {
    const { box } = this;
    const wide = box[1][k] - box[0][k];
    const least = 0.01 * wide;
    const moved = box[end][k] + share * wide;
    box[end][k] = end ? Math.max(moved, box[0][k] + least) : Math.min(moved, box[1][k] - least);
    this.#say();
    this.draw();
  }
}
