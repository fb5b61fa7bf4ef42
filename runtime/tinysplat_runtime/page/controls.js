// Mouse, touch and keys, told to a mover (movers.js).

const KEYS = {
  // right, down, forward, turn, tilt
  KeyA: [-1, 0, 0, 0, 0],
  KeyD: [1, 0, 0, 0, 0],
  KeyQ: [0, 1, 0, 0, 0],
  KeyE: [0, -1, 0, 0, 0],
  KeyW: [0, 0, 1, 0, 0],
  KeyS: [0, 0, -1, 0, 0],
  ArrowLeft: [0, 0, 0, -1, 0],
  ArrowRight: [0, 0, 0, 1, 0],
  ArrowUp: [0, 0, 0, 0, -1],
  ArrowDown: [0, 0, 0, 0, 1],
  Equal: [0, 0, 1, 0, 0],
  NumpadAdd: [0, 0, 1, 0, 0],
  Minus: [0, 0, -1, 0, 0],
  NumpadSubtract: [0, 0, -1, 0, 0],
};
const BACK = new Set(["Home", "Escape", "Digit0"]);
const NOTCH = 1000; // pixels of a wheel to a factor of e
const TAP_PX = 24; // between two taps that are one
const TAP_MS = 350;

export class Controls {
  canvas;
  mover;
  point;
  moved;
  back;
  picked;
  touched;
  released;
  isEmbedded;
  fingers;
  held;
  anchor;
  tap;
  // mover(): who moves now. point(x, y): what shows at a pixel. moved() after each change, back() when asked to return,
  // picked(x, y) on a double click, touched() before the first movement, released() when a finger is lifted.
  // isEmbedded: the page around scrolls by what is no drag.
  constructor(canvas, { mover, point, moved, back, picked, touched, released }, isEmbedded = false) {
    Object.assign(this, {
      isEmbedded,
      canvas,
      mover,
      point,
      moved,
      back,
      picked,
      touched,
      released,
      fingers: new Map(),
      held: new Set(),
      anchor: null,
      tap: null,
    });
    canvas.addEventListener("pointerdown", (event) => this.#down(event));
    canvas.addEventListener("pointermove", (event) => this.#move(event));
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => this.#up(event));
    canvas.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("dblclick", (event) => this.picked(event.offsetX, event.offsetY));
    canvas.addEventListener("keydown", (event) => this.#key(event));
    canvas.addEventListener("keyup", (event) => this.held.delete(event.code));
    canvas.addEventListener("blur", () => this.held.clear());
  }

  get holdsKeys() {
    return this.held.size > 0;
  }

  get isMoving() {
    return this.held.size > 0 || this.fingers.size > 0;
  }

  #down(event) {
    this.touched();
    this.canvas.setPointerCapture(event.pointerId);
    this.fingers.set(event.pointerId, [event.clientX, event.clientY]);
    this.pressed = { x: event.clientX, y: event.clientY, at: event.timeStamp };
    this.anchor = null;
  }

  #up(event) {
    this.fingers.delete(event.pointerId);
    this.anchor = null;
    if (event.pointerType === "touch" && event.type === "pointerup") this.#tapped(event);
    this.moved(); // the spring
    if (!this.fingers.size) this.released();
  }

  #tapped({ clientX, clientY, timeStamp, offsetX, offsetY }) {
    // browsers do not tell of double taps where panning is off
    const isTap =
      timeStamp - this.pressed.at < TAP_MS && Math.hypot(clientX - this.pressed.x, clientY - this.pressed.y) < TAP_PX;
    const isSecond =
      isTap &&
      this.tap &&
      timeStamp - this.tap.at < TAP_MS &&
      Math.hypot(clientX - this.tap.x, clientY - this.tap.y) < TAP_PX;
    this.tap = isTap && !isSecond ? { x: clientX, y: clientY, at: timeStamp } : null;
    if (isSecond) this.picked(offsetX, offsetY);
  }

  #move(event) {
    const before = this.fingers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    const other = [...this.fingers].find(([id]) => id !== event.pointerId)?.[1];
    this.fingers.set(event.pointerId, now);
    const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
    const mover = this.mover();
    if (other) {
      // two fingers: slide with their middle, approach with their distance
      mover.slide(dx / 2, dy / 2);
      const apart = (finger) => Math.hypot(finger[0] - other[0], finger[1] - other[1]) || 1;
      this.#near(apart(now) / apart(before), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
    } else if (event.buttons & 2 || event.buttons & 4 || event.shiftKey) {
      mover.slide(dx, dy);
    } else {
      mover.turn(dx, dy);
    }
    this.moved();
  }

  // Towards what showed at a pixel when the gesture began.
  #near(factor, x, y) {
    if (!this.anchor || Math.hypot(x - this.anchor.x, y - this.anchor.y) > TAP_PX)
      this.anchor = { x, y, point: this.point(x, y) };
    this.mover().near(factor, x, y, this.anchor.point);
  }

  #wheel(event) {
    if (this.isEmbedded && !event.ctrlKey && !event.metaKey) return;
    event.preventDefault();
    this.touched();
    const pixels = event.deltaY * [1, 16, 100][event.deltaMode];
    if (event.timeStamp - (this.wheeled ?? 0) > 500) this.anchor = null;
    this.wheeled = event.timeStamp;
    this.#near(Math.exp(-Math.max(-0.25, Math.min(0.25, pixels / NOTCH))), event.offsetX, event.offsetY);
    this.moved();
  }

  #key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (BACK.has(event.code)) this.back();
    if (!(event.code in KEYS)) return;
    event.preventDefault();
    this.touched();
    this.held.add(event.code);
    this.isFast = event.shiftKey;
    this.moved();
  }

  // What held keys do in `seconds`.
  step(seconds) {
    if (!this.held.size) return;
    const sum = [0, 0, 0, 0, 0];
    for (const code of this.held)
      KEYS[code].forEach((value, i) => {
        sum[i] += value;
      });
    this.mover().keys(sum, seconds, this.isFast);
    this.moved();
  }
}
