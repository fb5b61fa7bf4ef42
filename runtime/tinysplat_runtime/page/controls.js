// The camera and what moves it: mouse, touch and keys. OpenCV axes: x right, y down, z forward.
"use strict";

const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

function turned(v, axis, angle) { // Rodrigues; the axis has length 1
  const c = Math.cos(angle), s = Math.sin(angle), along = dot(v, axis) * (1 - c), side = cross(axis, v);
  return [0, 1, 2].map((i) => v[i] * c + side[i] * s + axis[i] * along);
}

class Camera {
  // view: {K: [fx, skew, fy, cx, cy], width, height, rotation: rows right, down, forward; position}
  constructor(view, reach) { this.set(view, reach); }

  set(view, reach) {
    Object.assign(this, { K: view.K, width: view.width, height: view.height, reach });
    this.rotation = view.rotation.map((row) => [...row]);
    this.position = [...view.position];
    this.zoom = 1;
  }

  // What a picture of another size shows: the view's own picture as large as fits, and more around it.
  fitted(width, height) {
    const scale = Math.min(width / this.width, height / this.height) * this.zoom;
    const [fx, skew, fy, cx, cy] = this.K.map((value) => value * scale), [x, y, z] = this.rotation;
    const principal = [width / 2 + cx - (scale * this.width) / 2, height / 2 + cy - (scale * this.height) / 2];
    const projection = [...add(x.map((v) => v * fx), y, skew), ...y.map((v) => v * fy), ...z];
    return { principal, focals: [fx, fy], focal: Math.sqrt(fx * fy), projection };
  }

  get target() { return add(this.position, this.rotation[2], this.reach); }

  turn(axis, angle, about) {
    this.rotation = this.rotation.map((row) => turned(row, axis, angle));
    if (about) this.position = add(about, turned(add(this.position, about, -1), axis, angle));
  }

  // Turns by angles about the upright and the camera's own horizontal; about a point, or on the spot.
  swing(up, across, down, about) {
    this.turn(up, across, about);
    const height = Math.acos(Math.max(-1, Math.min(1, dot(this.rotation[2], up))));
    const least = 0.05, angle = Math.max(least - height, Math.min(Math.PI - least - height, down));
    this.turn(cross(this.rotation[2], up).map((v, _, c) => v / (Math.hypot(...c) || 1)), -angle, about);
  }

  shift(right, down, forward) {
    const [x, y, z] = this.rotation;
    this.position = add(add(add(this.position, x, right), y, down), z, forward);
  }

  // Nearer to the target, by a factor.
  approach(factor) {
    const target = this.target;
    this.reach *= factor;
    this.position = add(target, this.rotation[2], -this.reach);
  }
}

const KEYS = { // right, down, forward, turn, tilt
  KeyA: [-1, 0, 0, 0, 0], KeyD: [1, 0, 0, 0, 0], KeyQ: [0, 1, 0, 0, 0], KeyE: [0, -1, 0, 0, 0],
  KeyW: [0, 0, 1, 0, 0], KeyS: [0, 0, -1, 0, 0], ArrowLeft: [0, 0, 0, -1, 0], ArrowRight: [0, 0, 0, 1, 0],
  ArrowUp: [0, 0, 0, 0, -1], ArrowDown: [0, 0, 0, 0, 1],
};

// Moves `camera` by what the user does on `canvas`; `moved` is called after each change, `picked` with a point clicked twice.
class Controls {
  constructor(canvas, camera, up, { moved, picked }) {
    Object.assign(this, { canvas, camera, up, moved, picked, flies: false, fingers: new Map(), held: new Set() });
    canvas.addEventListener("pointerdown", (event) => this.#down(event));
    canvas.addEventListener("pointermove", (event) => this.#move(event));
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => this.fingers.delete(event.pointerId));
    canvas.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("dblclick", (event) => this.picked(event.offsetX, event.offsetY));
    canvas.addEventListener("keydown", (event) => this.#key(event));
    canvas.addEventListener("keyup", (event) => this.held.delete(event.code));
    canvas.addEventListener("blur", () => this.held.clear());
  }

  get isMoving() { return this.held.size > 0 || this.fingers.size > 0; }

  #down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.canvas.focus({ preventScroll: true });
    this.fingers.set(event.pointerId, [event.clientX, event.clientY]);
  }

  #move(event) {
    const before = this.fingers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY], other = [...this.fingers].find(([id]) => id !== event.pointerId)?.[1];
    this.fingers.set(event.pointerId, now);
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]], { camera } = this;
    if (other) { // two fingers: slide with their middle, approach with their distance
      this.#slide(dx / 2, dy / 2);
      const apart = (finger) => Math.hypot(finger[0] - other[0], finger[1] - other[1]) || 1;
      this.#near(apart(before) / apart(now));
    } else if (event.buttons & 2 || event.buttons & 4 || event.shiftKey) {
      this.#slide(dx, dy);
    } else if (this.flies) {
      camera.swing(this.up, -dx / this.#focal, -dy / this.#focal);
    } else {
      camera.swing(this.up, (-4 * dx) / this.canvas.clientWidth, (4 * dy) / this.canvas.clientHeight, camera.target);
    }
    this.moved();
  }

  get #focal() { return this.camera.fitted(this.canvas.clientWidth, this.canvas.clientHeight).focal; }

  #slide(dx, dy) {
    const share = this.camera.reach / this.#focal;
    this.camera.shift(-dx * share, -dy * share, 0);
  }

  #near(factor) {
    if (this.flies) this.camera.shift(0, 0, (1 - factor) * this.camera.reach);
    else this.camera.approach(factor);
  }

  #wheel(event) {
    event.preventDefault();
    const pixels = event.deltaY * [1, 16, 100][event.deltaMode];
    this.#near(Math.exp(Math.max(-0.5, Math.min(0.5, pixels / 500))));
    this.moved();
  }

  #key(event) {
    if (!(event.code in KEYS) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    this.held.add(event.code);
    this.fast = event.shiftKey;
    this.moved();
  }

  // What held keys do in `seconds`.
  step(seconds) {
    if (!this.held.size) return;
    const sum = [0, 0, 0, 0, 0];
    for (const code of this.held) KEYS[code].forEach((value, i) => { sum[i] += value; });
    const way = seconds * this.camera.reach * (this.fast ? 1.5 : 0.4), angle = seconds * (this.fast ? 1.8 : 0.6);
    this.camera.shift(sum[0] * way, sum[1] * way, sum[2] * way);
    this.camera.swing(this.up, sum[3] * angle, sum[4] * -angle);
    this.moved();
  }
}
