// One scene in a canvas: what is drawn when, where the camera stands, what shows at a pixel. The clock is made up.
import assert from "node:assert/strict";
import test from "node:test";
import { add, scaled } from "../../runtime/tinysplat_runtime/page/vectors.js";
import { Viewer } from "../../runtime/tinysplat_runtime/page/viewer.js";
import { UP, close, view } from "./made.mjs";

const told = [];
const listeners = {};
const tell =
  (name) =>
  (...given) => {
    told.push([name, ...given]);
  };
let frame;
let resized;
let clock = 1000;
Object.assign(globalThis, {
  document: { body: { dataset: {} } },
  devicePixelRatio: 1.5,
  requestAnimationFrame: (next) => {
    frame = next;
  },
  ResizeObserver: class {
    constructor(react) {
      resized = react;
    }
    observe() {}
  },
});
const canvas = {
  clientWidth: 400,
  clientHeight: 250,
  setPointerCapture() {},
  addEventListener: (name, react) => {
    listeners[name] = react;
  },
};
const VIEWS = [view(0, 0), view(0.5, 0.1), view(1.5, 0.3)];
const sceneOf = (views, hasCameras = true) => ({ views, up: UP, reach: 4, hasCameras, nearPlane: 0.02 });
const cloudOf = (count = 0, more = {}) => ({
  means: new Float32Array(3 * count),
  opacities: new Float32Array(count).fill(1),
  parts: [{ view: 0, from: 0, to: count }],
  depth: 4,
  spread: 0.25,
  functions: 9,
  viewCount: 3,
  ground: [0, 0, 0],
  ...more,
});
const screen = { hasOrder: true, load: tell("load"), clear: tell("clear"), sort: tell("sort"), draw: tell("draw") };

function made(views = VIEWS, { isBare = false, isStill = true, cloud = cloudOf(), hasCameras = true } = {}) {
  const viewer = new Viewer(
    canvas,
    { drawn: tell("drawn"), moved: tell("moved"), touched: tell("touched") },
    { isBare, isStill },
  );
  Object.assign(screen, { isSorted: true, sortedCount: 5 });
  viewer.splats = screen;
  viewer.show(sceneOf(views, hasCameras), cloud);
  told.splice(0);
  return viewer;
}

function pass(ms) {
  told.splice(0);
  frame((clock += ms));
  return told.map(([name]) => name);
} // a frame, and what it told
const press = (type) => listeners[type]({ pointerId: 1, clientX: 0, clientY: 0, timeStamp: 0 });

function letGo(at) {
  // of a camera that a hand has drawn to a place: where it comes to rest
  press("pointerdown");
  Object.assign(at.camera, { position: [40, 0, 0] });
  press("pointerup");
  for (let n = 0; n < 400; n++) pass(20);
  return at.camera.position;
}

test("a canvas has the screen's pixels and keeps its zoom", () => {
  const viewer = made();
  viewer.camera.zoom *= 2;
  for (const [ratio, width, height, wanted] of [
    [1, 401, 250, [401, 250]],
    [1.5, 300, 250, [450, 375]],
  ]) {
    Object.assign(globalThis, { devicePixelRatio: ratio });
    Object.assign(canvas, { clientWidth: width, clientHeight: height });
    resized();
    pass(20);
    assert.deepEqual([canvas.width, canvas.height], wanted);
    close(viewer.camera.zoom, 2);
  }
  Object.assign(canvas, { clientWidth: 400 });
});

test("a scene begins at its first view and keeps the camera as it gets sharper", () => {
  const viewer = made();
  close(
    [viewer.camera.position, viewer.camera.rotation, viewer.camera.zoom],
    [VIEWS[0].position, VIEWS[0].rotation, 1],
  );
  viewer.camera.shift(1, 2, 3);
  viewer.show(sceneOf(VIEWS), cloudOf(), true);
  close(viewer.camera.position, [1, 2, 3]);
  viewer.show(sceneOf([VIEWS[1]], false), cloudOf());
  close(viewer.camera.position, VIEWS[1].position);
  close(letGo(viewer), [40, 0, 0]); // without cameras nothing holds one back
});

test("nothing is drawn while nothing changes, and one order is asked for at a time", () => {
  const viewer = made();
  viewer.isDirty = true;
  assert.ok(pass(20).includes("draw") && !pass(20).includes("draw"));
  screen.isSorted = false;
  viewer.move();
  assert.ok(!pass(10).includes("sort"));
  screen.isSorted = true;
  assert.ok(pass(10).includes("sort"));
});

test("nearer views have larger shares, unless all are alike", () => {
  const shares = made().shares();
  assert.ok(shares[0] > shares[2] && shares[2] >= shares[4] && shares.length === 6);
  assert.deepEqual([...made([view(0), view(0)]).shares()], [1, 1, 1, 1]);
});

test("a view is flown to, or reached at once by who wants stillness", () => {
  for (const isStill of [false, true]) {
    const viewer = made(VIEWS, { isStill });
    pass(100);
    viewer.select(1);
    if (!isStill) {
      const places = [...Array(400)].map(() => {
        pass(20);
        return viewer.camera.position[0];
      });
      assert.ok(
        places.every((x, n) => x >= (places[n - 1] ?? 0)) && new Set(places).size > 2,
        "it goes there bit by bit",
      );
    }
    close(
      [viewer.camera.position, viewer.camera.rotation, viewer.camera.zoom],
      [VIEWS[1].position, VIEWS[1].rotation, 1],
    );
  }
});

test("a page moves by itself along its views until it is touched", () => {
  const viewer = made(VIEWS, { isStill: false });
  const places = [];
  for (let n = 0; n < 2000; n++) {
    pass(125);
    places.push(viewer.camera.position[0]);
  } // so that it is at the ends, too
  assert.ok(
    Math.max(...places) > 1.4 && Math.min(...places) < 0.1 && Math.max(...places) <= 1.5 && Math.min(...places) >= 0,
  );
  listeners.keydown({ code: "KeyW", preventDefault() {} });
  listeners.keyup({ code: "KeyW" });
  assert.ok(told.some(([name]) => name === "touched"));
  const { position } = viewer.camera;
  pass(125);
  close(viewer.camera.position, position);
  const single = made([VIEWS[1]], { isStill: false });
  const strains = [...Array(40)].map(() => {
    pass(125);
    return single.bound.strain(single.camera);
  });
  assert.ok(Math.max(...strains) > 0 && Math.max(...strains) <= 1, "one view is looked at from close by");
});

test("pictures get coarser only while they move and are slow", () => {
  const viewer = made();
  const shares = [];
  const next = (ms) => {
    pass(ms);
    shares.push(...told.filter(([name]) => name === "draw").map(([, , , share]) => share));
  };
  viewer.isDirty = true;
  next(20);
  listeners.keydown({ code: "KeyW", preventDefault() {} });
  for (let n = 0; n < 8; n++) next(240);
  assert.ok(shares[0] === 1 && shares.at(-1) < 1);
  listeners.keyup({ code: "KeyW" });
  for (let n = 0; n < 200; n++) next(240);
  assert.equal(shares.at(-1), 1);
});

test("a page says when its picture is whole", () => {
  const viewer = made();
  const { dataset } = document.body;
  const ready = (change) => {
    Object.assign(screen, change);
    viewer.isDirty = true;
    pass(20);
    return "ready" in dataset;
  };
  assert.deepEqual(
    [ready({}), ready({ isSorted: false }), ready({ isSorted: true, hasOrder: false }), ready({ hasOrder: true })],
    [true, false, false, true],
  );
});

test("what a hand drew away springs back when it lets go, and what it did not stays", () => {
  const viewer = made();
  viewer.camera.shift(2, 0, 0);
  pass(20);
  assert.equal(viewer.camera.position[0], 2);
  press("pointerdown");
  pass(20);
  assert.equal(viewer.camera.position[0], 2);
  letGo(viewer);
  assert.ok(viewer.bound.strain(viewer.camera) < 1.01);
});

test("a drag beyond the bound goes on to the view that lies there", () => {
  const views = [0, 2, 4, 6, 8, 10].map((x) => view(x));
  const viewer = made(views); // too far apart to stay between them
  for (const [way, wanted] of [
    [1, 1],
    [1, 2],
    [-1, 1],
    [0, 1],
  ]) {
    press("pointerdown");
    viewer.camera.shift(1.3 * way * viewer.bound.side, 0, 0);
    press("pointerup");
    for (let n = 0; n < 60; n++) pass(50);
    close(viewer.camera.position, views[wanted].position);
  }
});

test("slow devices show their first picture, and stop what moves by itself", () => {
  const viewer = made(VIEWS, { isStill: false });
  screen.isSorted = false; // orders come late
  viewer.isDirty = true;
  assert.ok(pass(400).includes("drawn"));
  screen.isSorted = true;
  const places = [...Array(40)].map(() => {
    viewer.isDirty = true;
    pass(400);
    return viewer.camera.position;
  });
  close(places.at(-1), places.at(-2));
});

test("going anywhere frees the camera until it is called back", () => {
  const viewer = made();
  viewer.setFree(true);
  close(letGo(viewer), [40, 0, 0]);
  viewer.setFree(false);
  close(viewer.camera.position, [0, 0, 0]);
  viewer.camera.shift(1, 0, 0);
  listeners.keydown({ code: "Home" });
  close(viewer.camera.position, [0, 0, 0]);
});

test("a point is on the nearest of what shows there", () => {
  const depths = [5, 3, 0.01, -3, 2];
  const cloud = cloudOf(5);
  const viewer = made(VIEWS, { cloud });
  const { camera } = viewer;
  depths.forEach((depth, i) => cloud.means.set(add(camera.position, camera.ray(211, 97, 400, 250), depth), 3 * i));
  cloud.opacities[4] = 0.1; // hardly shows
  const far = (x, y) => {
    const along = add(viewer.pointAt(x, y), camera.position, -1);
    const ray = camera.ray(x, y, 400, 250);
    const distance = along[2] / ray[2];
    close(along, scaled(ray, distance), 1e-5);
    return distance;
  };
  close([far(211, 97)], [3], 1e-5);
  assert.ok(far(20, 30) > 0, "before the camera, where nothing shows");
});

test("a double click turns to what shows there, or returns", () => {
  const cloud = cloudOf(1);
  const viewer = made(VIEWS, { cloud });
  const point = scaled(viewer.camera.ray(250, 180, 400, 250), 3);
  cloud.means.set(point);
  viewer.camera.shift(1, 0, 0);
  listeners.dblclick({});
  close(viewer.camera.position, [0, 0, 0]);
  viewer.setFree(true);
  listeners.dblclick({ offsetX: 250, offsetY: 180 });
  close([viewer.camera.target, viewer.camera.rotation[0][1]], [point, 0], 0.02);
});

test("a bare page fades nothing, as render does", () => {
  const [usual, bare] = [false, true].map((isBare) => made(VIEWS, { isBare }).drawing());
  assert.ok(usual.fades && !bare.fades);
});

test("where nothing is shows the background that is told, and no surroundings of the picture", () => {
  const viewer = made(VIEWS, { cloud: cloudOf(0, { ground: [0.2, 0.3, 0.4] }) });
  assert.deepEqual(viewer.drawing().ground, [0.2, 0.3, 0.4]);
  viewer.background = [1, 1, 1];
  const { ground, isFramed } = viewer.drawing();
  assert.deepEqual([ground, isFramed], [[1, 1, 1], false]);
  viewer.showDepth(true);
  assert.deepEqual(viewer.drawing().ground, [0, 0, 0]);
});
