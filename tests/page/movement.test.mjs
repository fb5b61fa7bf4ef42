// Where the page's camera may go: near the views, by whatever a hand does.
import assert from "node:assert/strict";
import test from "node:test";
import { Bound, elastic, lightAt, poseBetween, walk } from "../../runtime/tinysplat_runtime/page/bound.js";
import { Camera } from "../../runtime/tinysplat_runtime/page/camera.js";
import { fadeAt } from "../../runtime/tinysplat_runtime/page/cloud.js";
import { BoundMover, FreeMover } from "../../runtime/tinysplat_runtime/page/movers.js";
import { add, dot, length, turned } from "../../runtime/tinysplat_runtime/page/vectors.js";
import { ROWS, UP, close, randoms, view } from "./made.mjs";

const WINDOW = [800, 600];
const random = randoms();

function start(views, spread = 0.25) {
  const camera = new Camera(views[0], 4);
  const bound = new Bound(views, 4, spread);
  return { camera, bound, mover: new BoundMover(camera, bound, UP, () => WINDOW) };
}

function settle(mover) {
  for (let i = 0; i < 300 && mover.spring(0.016); i++);
}

for (const [name, views] of Object.entries({
  "one view": [view(0)],
  "two views": [view(0), view(0.4, 0.05)],
  "a walk": [0, 1, 2, 3, 4, 5, 6].map((v) => view(v, v / 4)),
})) {
  test(`no drag, slide or key leaves the bound of ${name}`, () => {
    for (let n = 0; n < 60; n++) {
      const { camera, bound, mover } = start(views);
      const x = 400 * (random() - 0.5);
      const y = 400 * (random() - 0.5);
      const ways = [() => mover.turn(x, y), () => mover.slide(x, y), () => mover.keys([0, 1, 1, 1, 1], 0.1, true)];
      for (let i = 0; i < 30; i++) ways[n % 3]();
      assert.ok(bound.strain(camera) < 2);
      settle(mover);
      assert.ok(bound.strain(camera) < 1.05);
      assert.ok(Math.abs(dot(camera.rotation[0], UP)) < 1e-6, "the horizon tilts");
      assert.ok(Math.hypot(...bound.stray(camera, ...WINDOW)) < 0.01, "the window leaves the picture");
    }
  });
}

test("an untouched camera stays and a small drag is kept", () => {
  const { camera, bound, mover } = start([view(0), view(0.4)]);
  assert.ok(!mover.spring(0.1));
  mover.turn(20, 0);
  const after = [...camera.position];
  const strain = bound.strain(camera);
  assert.ok(strain > 0 && strain < 1);
  settle(mover);
  close(camera.position, after);
});

test("the hull is the ways between neighbours", () => {
  const { bound } = start([view(0), view(0.4, 0.1)]);
  const on = poseBetween(view(0), view(0.4, 0.1), 0.3);
  const off = (axis) => bound.strain({ ...on, position: add(on.position, on.rotation[axis], bound.side) });
  close([bound.strain(on), off(1)], [0, 1], 1e-3);
  assert.ok(off(2) < off(1), "ahead there is more room than aside");
  // In the middle of a ring of views that look inwards nothing is known of what one sees from there.
  const ring = [...Array(12).keys()].map((n) => ({
    ...view(0, (n * Math.PI) / 6),
    position: turned([0, 0, -4], UP, (n * Math.PI) / 6),
  }));
  assert.ok(new Bound(ring, 4, 0.25).strain({ position: [0, 0, 0], rotation: ROWS }) > 1);
});

test("poses between views are between their places and share their lenses", () => {
  const [a, b] = [view(0), { ...view(1, 0.4), K: [600, 2, 500, 330, 240] }];
  const half = poseBetween(a, b, 0.5);
  close(half.position, [0.5, 0, 0]);
  close(half.rotation, view(0, 0.2).rotation);
  close(half.K, [550, 1, 500, 325, 240]);
  close(poseBetween(a, { ...b, width: 700 }, 0.3).K, a.K);
});

test("deep scenes bind closer", () => {
  const [flat, deep, deepest] = [0.1, 0.5, 50].map((spread) => new Bound([view(0)], 4, spread).side);
  assert.ok(flat > deep && deep > deepest && deepest > 0);
});

test("the wheel goes to the pointer and stops before the surface", () => {
  const { camera, bound, mover } = start([view(0), view(0.4)]);
  const far = [0.5, 0.3, 3];
  const near = [0.1, 0, 0.3];
  const onScreen = () => {
    const { projection: P, principal } = camera.fitted(...WINDOW);
    const ray = add(far, camera.position, -1);
    const z = dot(P.slice(6), ray);
    return [dot(P.slice(0, 3), ray) / z + principal[0], dot(P.slice(3, 6), ray) / z + principal[1]];
  };
  const [x, y] = onScreen();
  mover.near(1.1, x, y, far);
  assert.ok(length(add([x, y, 0], [...onScreen(), 0], -1)) < 1);
  for (let i = 0; i < 100; i++) mover.near(1.3, 400, 300, near);
  settle(mover);
  assert.ok(camera.position[2] < near[2] && bound.strain(camera) < 1.05);
  assert.ok(camera.zoom > 1 && camera.zoom < 100);
  for (let i = 0; i < 100; i++) mover.near(1 / 1.3, 400, 300, near);
  settle(mover);
  assert.equal(camera.zoom, 1);
});

test("free movement comes near and goes not too far", () => {
  const { camera } = start([view(0)]);
  const free = new FreeMover(camera, UP, () => WINDOW, 4);
  const point = [0, 0, 4];
  for (let i = 0; i < 50; i++) free.near(1.2, 400, 300, point);
  assert.ok(length(add(point, camera.position, -1)) < 0.1 && camera.position[2] < 4);
  for (let i = 0; i < 200; i++) free.near(1 / 1.2, 400, 300, point);
  const far = length(add(point, camera.position, -1));
  assert.ok(far > 4 && far < 1e4);
  assert.ok(!free.spring(1), "nothing pulls it back");
});

test("a free drag orbits, or looks around while it flies", () => {
  for (const flies of [false, true]) {
    const { camera } = start([view(0)]);
    const free = new FreeMover(camera, UP, () => WINDOW, 4);
    const { target } = camera;
    free.flies = flies;
    free.turn(60, -35);
    close(flies ? camera.position : camera.target, flies ? [0, 0, 0] : target);
    const { focal } = camera.fitted(...WINDOW);
    const [x, y] = [0, 1].map((k) => (focal * dot(camera.rotation[k], add(target, camera.position, -1))) / 4);
    if (flies) assert.ok(Math.abs(x - 60) < 1 && Math.abs(y + 35) < 1, "what was in the middle goes with the hand");
    else assert.ok(camera.position[0] < 0 && camera.position[1] > 0, "the camera goes the other way");
  }
});

test("a free slide carries along what lies at the point that is orbited", () => {
  const { camera } = start([view(0, 0.3)]);
  const free = new FreeMover(camera, UP, () => WINDOW, 4);
  const { target } = camera;
  const { focal } = camera.fitted(...WINDOW);
  free.slide(31, -17);
  const point = add(target, camera.position, -1);
  close(
    camera.rotation.map((row) => dot(row, point)),
    [(31 * 4) / focal, (-17 * 4) / focal, 4],
  );
});

test("keys the other way undo what free keys did, of a camera that is turned", () => {
  for (const [key, isFast] of [0, 1, 2, 3, 4].flatMap((key) => [
    [key, false],
    [key, true],
  ])) {
    const { camera } = start([view(0, 0.3)]);
    const free = new FreeMover(camera, UP, () => WINDOW, 4);
    const keys = [0, 0, 0, 0, 0];
    for (const way of [1, -1]) {
      keys[key] = way;
      free.keys(keys, 0.2, isFast);
    }
    close([camera.position, camera.rotation], [[0, 0, 0], view(0, 0.3).rotation]);
  }
});

test("arrows and letters turn as a drag to the other side does", () => {
  const after = (act) => {
    const { camera, mover } = start([view(0, 0.1), view(0.4, 0.1)]);
    camera.zoom = 1.4; // so that the picture goes on beyond the window, to all sides
    act(mover);
    return [camera.position, camera.rotation];
  };
  const keyed = (keys, isFast = false) => after((mover) => mover.keys(keys, 0.1, isFast));
  const still = after(() => {});
  const gone = (pose) => add(pose[0], still[0], -1);
  const far = (pose) => length(gone(pose));
  for (const [way, dx, dy] of [
    [0, -20, 0],
    [1, 0, -20],
  ]) {
    const keys = [0, 0, 0, 0, 0];
    const dragged = gone(after((mover) => mover.turn(dx, dy)));
    keys[way] = 1;
    const once = keyed(keys);
    assert.ok(dot(gone(once), dragged) > 0.9 * far(once) * length(dragged), "the same way");
    assert.ok(far(once) > 0 && far(keyed(keys, true)) > far(once));
    keys[way + 3] = 1;
    assert.ok(far(keyed(keys)) > far(once));
    keys[way] = 0;
    close(keyed(keys), once);
    keys[way] = -1;
    close(keyed(keys), still);
  }
  const [closer, away] = [1, -1].map((forward) => keyed([0, 0, forward, 0, 0])[0]);
  assert.ok(closer[2] > still[0][2] && away[2] < still[0][2]);
});

test("what lies beyond a picture fades", () => {
  for (const isFront of [true, false]) {
    const shares = [...Array(960)].map((_, x) => fadeAt(view(0), isFront, 320 + x, 240)); // from its middle to its width away
    assert.ok(shares[0] === 1 && shares.at(-1) === 0 && shares.some((share) => share > 0 && share < 1));
    assert.ok(shares.every((share, x) => share <= (shares[x - 1] ?? 1)));
  }
});

test("the border gives, less and less, and dims", () => {
  assert.equal(elastic(0, 0.7), 0.7);
  const [near, far, again] = [elastic(0, 1.5), elastic(0, 9), elastic(1.3, 1.4)];
  assert.ok(
    1 < near && near < 1.5 && near < far && (far - near) / 7.5 < (near - 1) / 0.5 && again > 1.3 && again < 1.4,
  );
  const lights = [0.5, 1, 1.2, 1.35].map(lightAt);
  assert.deepEqual(lights.slice(0, 2), [1, 1]);
  assert.ok(lights[2] < 1 && lights[3] < lights[2] && lights[3] > 0);
});

test("a walk goes on to the nearest, and turns of the head are ways too", () => {
  assert.deepEqual(walk([view(0), view(3), view(1), view(2)], 4), [0, 2, 3, 1]);
  assert.deepEqual(walk([view(0), view(0, 1.6), view(2.5)], 40), [0, 2, 1]);
});
