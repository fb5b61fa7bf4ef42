// What mouse, touch and keys tell the page's mover: events in, calls out.
import assert from "node:assert/strict";
import test from "node:test";
import { Camera } from "../../runtime/tinysplat_runtime/page/camera.js";
import { Controls } from "../../runtime/tinysplat_runtime/page/controls.js";
import { FreeMover } from "../../runtime/tinysplat_runtime/page/movers.js";
import { UP, close, view } from "./made.mjs";

function made(own) {
  const told = [];
  const listeners = {};
  const tell =
    (name) =>
    (...given) =>
      told.push([name, ...given.flat()]);
  const canvas = {
    addEventListener: (name, react, options) => {
      listeners[name] = [react, options];
    },
    setPointerCapture() {},
  };
  const mover = own ?? Object.fromEntries(["turn", "slide", "near", "keys"].map((name) => [name, tell(name)]));
  const controls = new Controls(canvas, {
    mover: () => mover,
    moved() {},
    touched() {},
    released() {},
    back: tell("back"),
    picked: tell("picked"),
    point: (x, y) => [x, y, 7],
  });
  // An event, and what was told because of it.
  const send = (type, more = {}) => {
    listeners[type][0]({
      type,
      pointerId: 1,
      buttons: 1,
      pointerType: "mouse",
      timeStamp: 0,
      preventDefault: tell("prevented"),
      ...more,
    });
    return told.splice(0);
  };
  return { controls, told, send, listeners };
}

const at = (clientX, clientY, more) => ({ clientX, clientY, offsetX: clientX - 1, offsetY: clientY - 2, ...more });

test("a drag turns by what it moves, other buttons and shift slide", () => {
  for (const [held, way] of [
    [{}, "turn"],
    [{ buttons: 2 }, "slide"],
    [{ buttons: 4 }, "slide"],
    [{ shiftKey: true }, "slide"],
  ]) {
    const { controls, send } = made();
    assert.deepEqual(send("pointermove", at(9, 9, held)), []);
    send("pointerdown", at(10, 20, held));
    assert.ok(controls.isMoving);
    assert.deepEqual(send("pointermove", at(13, 15, held)), [[way, 3, -5]]);
    assert.deepEqual(send("pointermove", at(14, 18, held)), [[way, 1, 3]]);
    send("pointerup", at(14, 18));
    assert.ok(!controls.isMoving);
    assert.deepEqual(send("pointermove", at(1, 1)), []);
  }
});

test("two fingers slide, and pinch about what showed between them", () => {
  const { controls, send } = made();
  const finger = (pointerId, x, y) => at(x, y, { pointerId, pointerType: "touch", timeStamp: 1000 * x });
  send("pointerdown", finger(1, 100, 100));
  send("pointerdown", finger(2, 130, 140));
  for (const [to, slid, factor, ...middle] of [
    [finger(2, 160, 180), [15, 20], 2, 130, 140],
    [finger(1, 110, 94), [5, -3], Math.hypot(50, 86) / 100, 135, 137],
  ]) {
    const { slide, near } = Object.fromEntries(send("pointermove", to).map(([name, ...given]) => [name, given]));
    close([slide, near], [slid, factor, middle, 130, 140, 7]);
  }
  send("pointerup", finger(2, 160, 180));
  assert.deepEqual(send("pointermove", finger(1, 111, 94)), [["turn", 1, 0]]);
  send("pointercancel", finger(1, 111, 94));
  assert.ok(!controls.isMoving);
});

test("the wheel approaches what it began on, however finely or coarsely it turns", () => {
  const { send, listeners } = made();
  const wheel = (deltaY, x, timeStamp, deltaMode = 0) =>
    send("wheel", { deltaY, deltaMode, offsetX: x, offsetY: 50, timeStamp }).find(([name]) => name === "near");
  const first = wheel(-200, 60, 1000);
  const second = wheel(-3, 64, 1300);
  const back = wheel(200, 64, 1400);
  const later = wheel(-200, 90, 9000);
  assert.ok(first[1] > 1 && second[1] > 1 && second[1] < first[1]);
  close(first[1] * back[1], 1);
  assert.deepEqual(
    [first, second, later].map(([, , , , x]) => x),
    [60, 60, 90],
  );
  assert.ok(wheel(-1e6, 9, 20000)[1] < 10);
  assert.ok(wheel(-1, 9, 30000, 1)[1] > wheel(-1, 9, 30001, 0)[1], "lines count for more than pixels");
  assert.equal(listeners.wheel[1].passive, false);
});

test("held keys walk along the camera's axes or turn its head until they are let go", () => {
  const held = (codes, shiftKey = false) => {
    const camera = new Camera(view(0), 4);
    const { controls, send } = made(new FreeMover(camera, UP, () => [800, 600], 4));
    for (const code of codes) send("keydown", { code, shiftKey });
    controls.step(0.25);
    const moved = [...camera.position, camera.rotation[2][0], camera.rotation[2][1]];
    if (codes.length > 1) send("blur");
    else send("keyup", { code: codes[0] });
    assert.ok(!controls.isMoving);
    controls.step(0.25);
    assert.deepEqual(camera.position, moved.slice(0, 3));
    return moved; // to the right, down, forward; turned to the right, down
  };
  for (const [axis, more, less] of [
    [0, "KeyD", "KeyA"],
    [1, "KeyQ", "KeyE"],
    [2, "KeyW", "KeyS"],
    [2, "Equal", "Minus"],
    [3, "ArrowRight", "ArrowLeft"],
    [4, "ArrowDown", "ArrowUp"],
  ]) {
    for (const [code, way] of [
      [more, 1],
      [less, -1],
    ]) {
      const moved = held([code]);
      moved.forEach((value, k) =>
        assert.ok(k === axis ? way * value > 0 : Math.abs(value) < 1e-9, `${code} does ${moved}`),
      );
      assert.ok(way * held([code, code], true)[axis] > way * moved[axis], "shift hurries");
    }
  }
  const both = held(["KeyW", "KeyD"]);
  assert.ok(both[0] > 0 && both[2] > 0);
});

test("keys return, and others are the browser's", () => {
  const { send } = made();
  assert.deepEqual(send("keydown", { code: "Home" }), [["back"]]);
  for (const more of [{ code: "KeyX" }, { code: "KeyW", ctrlKey: true }, { code: "KeyW", metaKey: true }])
    assert.deepEqual(send("keydown", more), []);
  assert.deepEqual(send("contextmenu"), [["prevented"]]);
  assert.deepEqual(send("dblclick", at(31, 42)), [["picked", 30, 40]]);
});

test("two quick taps of a finger at one place pick, and a third is a first one again", () => {
  const taps = (list, type = "touch") => {
    const { send } = made();
    return list.flatMap(([start, long, x, y]) => {
      send("pointerdown", at(x, y, { timeStamp: start }));
      return send("pointerup", at(x, y, { timeStamp: start + long, pointerType: type }));
    });
  };
  assert.deepEqual(
    taps([
      [0, 100, 310, 410],
      [200, 100, 315, 412],
    ]),
    [["picked", 314, 410]],
  );
  assert.equal(taps([0, 100, 200, 300].map((start) => [start, 20, 5, 5])).length, 2);
  for (const [name, list, type] of [
    [
      "held",
      [
        [0, 900, 10, 10],
        [950, 10, 10, 10],
      ],
    ],
    [
      "late",
      [
        [0, 10, 10, 10],
        [900, 5, 10, 10],
      ],
    ],
    [
      "elsewhere",
      [
        [0, 10, 10, 10],
        [100, 10, 60, 10],
      ],
    ],
    [
      "of a mouse",
      [
        [0, 10, 10, 10],
        [100, 10, 10, 10],
      ],
      "mouse",
    ],
  ])
    assert.deepEqual(taps(list, type), [], name);
});
