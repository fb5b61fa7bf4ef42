"""One scene in a canvas: what is drawn when, where the camera stands, what shows at a pixel. The clock is made up."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from page.scripts import close
from page.scripts import run as run_with

START = """
import { Bound, poseBetween } from "./bound.js";
import { Camera, fillingZoom } from "./camera.js";
import { add, length, turned } from "./vectors.js";
import { Viewer } from "./viewer.js";
const told = [], listeners = {}, tell = (name) => (...given) => { told.push([name, ...given]); };
let frame, resized, clock = 1000;
Object.assign(globalThis, {
  document: { body: { dataset: {} } }, devicePixelRatio: 1.5, requestAnimationFrame: (next) => { frame = next; },
  ResizeObserver: class { constructor(react) { resized = react; } observe() {} },
});
const canvas = { clientWidth: 400, clientHeight: 250, setPointerCapture() {}, addEventListener: (name, react) => {
  listeners[name] = react; } };
const ROWS = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], UP = [0, -1, 0];
const view = (x, turn) => ({
  K: [300, 2, 280, 165 + x, 115], width: 320, height: 240, position: [x, 0.1 * x, 0],
    rotation: ROWS.map((row) => turned(row, UP, turn)),
});
const VIEWS = [view(0, 0), view(0.5, 0.1), view(1.5, 0.3)];
const sceneOf = (views, hasCameras = true) => ({ views, up: UP, reach: 4, hasCameras, nearPlane: 0.02 });
const cloudOf = (count = 0, more = {}) => ({
  means: new Float32Array(3 * count), opacities: new Float32Array(count).fill(1), parts: [{ view: 0, from: 0,
    to: count }], depth: 4,
  spread: 0.25, functions: 9, viewCount: 3, behind: null, ...more,
});
const fake = { isSorted: true, sortedCount: 5, load: tell("load"), setBehind: tell("behind"), sort: tell("sort"),
  draw: tell("draw") };
function made(views = VIEWS, { isBare = false, isStill = true, cloud = cloudOf(), hasCameras = true } = {}) {
  const viewer = new Viewer(canvas, { drawn: tell("drawn"), moved: tell("moved"), touched: tell("touched") }, {
    isBare, isStill });
  viewer.splats = fake;
  viewer.show(sceneOf(views, hasCameras), cloud);
  return viewer;
}
function pass(ms) { told.splice(0); frame(clock += ms); return told.splice(0); } // a frame, and what it told
const names = (list) => list.map(([name]) => name);
const pose = ({ position, rotation, zoom, K }) => [...position, ...rotation.flat(), zoom, ...K];
const posed = (view, zoom) => [...view.position, ...view.rotation.flat(), zoom, ...view.K];
const HOME = fillingZoom(VIEWS[0], 400, 250);
"""


def run(code: str) -> Any:
    return run_with(code, START)


def test_canvases_have_the_screen_s_pixels_up_to_two_and_a_zoom_survives_them() -> None:
    found = run(
        """
        const viewer = made(), sizes = [[canvas.width, canvas.height]], whole = [];
        viewer.camera.zoom *= 2;
        for (const [ratio, width, height] of [[1, 401, 250], [3, 400, 250], [0.001, 300, 250]]) {
          Object.assign(globalThis, { devicePixelRatio: ratio });
          Object.assign(canvas, { clientWidth: width, clientHeight: height });
          document.body.dataset.ready = "yes";
          resized();
          sizes.push([canvas.width, canvas.height]);
          whole.push("ready" in document.body.dataset);
        }
        const zoom = viewer.camera.zoom / fillingZoom(VIEWS[0], 300, 250);
        const home = viewer.homeZoom / fillingZoom(VIEWS[0], 300, 250), bare = made(VIEWS, { isBare: true });
        return [sizes, zoom, home, whole, bare.homeZoom, canvas.width, made(VIEWS, { hasCameras: false }).homeZoom];
        """
    )
    assert found[0] == [[600, 375], [401, 250], [800, 500], [1, 1]]
    close(found[1:3], [2, 1])
    assert found[3:] == [[False] * 3, 1, 300, 1]


def test_a_scene_begins_at_its_first_view_and_keeps_the_camera_as_it_gets_sharper() -> None:
    found = run(
        """
        const cloud = cloudOf(0, { behind: [1] }), viewer = made(VIEWS, { cloud }), begun = told.splice(0);
        const start = [pose(viewer.camera), posed(VIEWS[0], HOME)];
        const sides = [viewer.bound.side], isSame = viewer.near.bound === viewer.bound;
        viewer.camera.shift(1, 2, 3);
        viewer.show(sceneOf(VIEWS), cloudOf(0, { spread: 0.5 }), true);
        sides.push(viewer.bound.side, viewer.near.bound.side);
        const place = viewer.camera.position, lists = [viewer.path.map(({ position }) => position[0]),
          viewer.counted, viewer.current];
        viewer.show(sceneOf([VIEWS[1]], false), cloudOf());
        const bare = made(VIEWS, { isBare: true, cloud });
        return [names(begun), start, sides, isSame, place, lists, viewer.bound, viewer.near,
          viewer.mover === viewer.free, names(told),
          made(VIEWS, { hasCameras: false }).lines, viewer.camera.position[0]];
        """
    )
    assert found[0] == ["load", "behind", "sort", "sort"]
    close(*found[1])
    close(found[2], [0.28, 4 * 0.035 / 0.5**0.5, 4 * 0.035 / 0.5**0.5])
    assert found[3:] == [
        True, [1, 2, 3], [[0, 0.5, 1.5], [0, 1, 2], 0], None, None, True,
        ["load", "sort", "load", "sort", "sort", "load", "sort", "sort"], None, 0.5,
    ]  # fmt: skip


def test_orders_are_asked_for_one_at_a_time() -> None:
    found = run(
        """
        const viewer = made();
        told.splice(0);
        fake.isSorted = false;
        viewer.move();
        const asked = [names(told.splice(0)), viewer.waits, names(pass(10))];
        fake.isSorted = true;
        const [sort] = pass(10);
        asked.push(sort[1] === viewer.camera, sort[2], [...sort[3].all], viewer.waits);
        viewer.splats = undefined;
        viewer.move();
        return [...asked, names(pass(10))];
        """
    )
    assert found == [[], True, ["draw"], True, 0.02, [1, 1, 1], False, []]


def test_views_of_shares_and_without() -> None:
    found = run(
        """
        const viewer = made(), first = viewer.shares();
        viewer.settings.nearFirst = false;
        const told = [first, viewer.shares()].flatMap(({ front, all }) => [[...front], [...all]]);
        viewer.cloud.viewCount = 0;
        return [...told, viewer.shares(), made(VIEWS, { hasCameras: false }).shares()];
        """
    )
    none = {"front": [], "all": []}
    assert found[0][0] == 1 and 0 < found[0][1] < 1 and found[0][2] == 0
    assert found[1:] == [[1, 1, 1], [0, 0, 0], [1, 1, 1], none, none]


def test_flights_to_a_view_ease_in_and_out() -> None:
    found = run(
        """
        const viewer = made(VIEWS, { isStill: false });
        pass(100);
        viewer.camera.zoom = 2;
        const from = structuredClone({ ...viewer.camera });
        viewer.select(1);
        const before = [viewer.isSwinging, viewer.current, pose(viewer.camera)[0]], steps = [];
        for (const ms of [70, 210, 140, 200, 250]) {
          pass(ms);
          steps.push([pose(viewer.camera), viewer.flight?.done ?? null]);
        }
        const start = viewer.flight, way = (t) => posed(poseBetween(from, VIEWS[1], t), 2 + t * (HOME - 2));
        const smooth = (t) => t * t * (3 - 2 * t), wanted = [0.1, 0.4, 0.6, 0.6 + 2 / 7,
          1].map((t) => [way(smooth(t)), t < 1 ? t : null]);
        return [before, steps, wanted, start];
        """
    )
    assert found[0][:2] == [False, 1] and found[3] is None
    for (one, done), (other, wanted) in zip(found[1], found[2], strict=True):
        close(one, other)
        assert (done is None and wanted is None) or done == pytest.approx(wanted)


def test_far_views_bare_pages_and_stillness_are_reached_at_once() -> None:
    found = run(
        """
        const answers = [{ views: [view(1, 0), view(4.98, 0)] }, { views: [view(1, 0), view(4.97, 0)],
          isStill: false }, { views: [view(1, 0), view(4.99, 0)], isStill: false },
          { isBare: true, isStill: false }].map(({ views = VIEWS, ...options }) => {
          const viewer = made(views, { isStill: true, ...options });
          viewer.select(1);
          return [viewer.flight !== undefined, viewer.camera.position[0]];
        });
        const asked = made(VIEWS, { isStill: false });
        asked.select(2, true);
        return [...answers, asked.camera.position[0]];
        """
    )
    assert found == [[False, 4.98], [True, 1], [False, 4.99], [False, 0.5], 1.5]


@pytest.mark.parametrize("count", [2, 3])
def test_a_page_moves_from_view_to_view_and_back(count: int) -> None:
    found = run(
        f"""
        const views = VIEWS.slice(0, {count}), viewer = made(views, {{ isStill: false }}), legs = views.length - 1,
          steps = [];
        viewer.camera.zoom = 1.7;
        pass(9999);
        for (let n = 0; n < 80; n++) {{ pass(200); if (n % 9 === 0) steps.push([viewer.time, pose(viewer.camera)]); }}
        const wanted = steps.map(([time]) => {{
          const turns = time / 4 / legs, share = legs === 1 ? 0.5 - Math.cos(Math.PI * turns) / 2 : turns % 2 > 1 ?
            2 - (turns % 2) : turns % 2;
          const leg = Math.min(Math.floor(legs * share), legs - 1);
          return posed(poseBetween(views[leg], views[leg + 1], legs * share - leg), 1.7);
        }});
        viewer.time = 4 * legs - 0.25;
        pass(250);
        return [steps, wanted, pose(viewer.camera), posed(views[legs], 1.7)];
        """
    )
    close(found[2], found[3])
    close(
        [time for time, _ in found[0]], [0.25 + 0.2 + 1.8 * n for n in range(9)]
    )  # no frame counts for more than a quarter of a second
    for (_, one), other in zip(*found[:2], strict=True):
        close(one, other)


def test_a_single_view_is_looked_at_from_a_small_circle() -> None:
    found = run(
        """
        return [true, false].map((hasCameras) => {
          const viewer = made([VIEWS[1]], { isStill: false, hasCameras }), { rotation, position } = VIEWS[1];
          pass(9999);
          pass(150);
          pass(250);
          const angle = Math.PI * viewer.time / 4, wide = 0.7 * (hasCameras ? viewer.bound.side : 0.4);
          const place = add(add(position, rotation[0], wide * Math.sin(angle)), rotation[1],
            0.4 * wide * (Math.cos(angle) - 1));
          return [viewer.time, [...viewer.camera.position], place, viewer.camera.rotation.flat(), rotation.flat()];
        });
        """
    )
    for time, place, wanted, rotation, own in found:
        assert time == pytest.approx(0.65)
        close(place, wanted)
        close(rotation, own)


def test_pictures_get_coarser_only_while_they_move_and_are_slow() -> None:
    found = run(
        """
        const shares = [], next = (ms) => shares.push(...pass(ms).filter(([name]) => name === "draw").map(([, , ,
          share]) => share));
        const flying = made();
        flying.flight = { from: flying.camera, pose: VIEWS[1], done: 0 };
        next(20);
        const viewer = made();
        next(20);
        next(20); // nothing moves: nothing is drawn
        listeners.keydown({ code: "KeyW", preventDefault() {} });
        for (const ms of [90, 45, 46, 46, 46, 20]) next(ms);
        listeners.keyup({ code: "KeyW" });
        viewer.bound.pull(viewer.camera, 0);
        viewer.camera.set(VIEWS[0], 4, HOME);
        next(90);
        next(90);
        const bare = made(VIEWS, { isBare: true });
        for (const ms of [90, 90]) { bare.isDirty = true; bare.flight = { from: bare.camera, pose: VIEWS[1],
          done: 0 }; next(ms); }
        return shares;
        """
    )
    assert found == [1, 1, 1, 1, 0.5, 0.25, 0.25, 0.25, 1, 1, 1]


def test_a_page_says_when_its_picture_is_whole() -> None:
    found = run(
        """
        const viewer = made(), { dataset } = document.body, answers = [];
        const next = (change = {}) => { Object.assign(fake, change); viewer.isDirty = true;
          answers.push([names(pass(20)), dataset.ready ?? null]); };
        viewer.settings.leastOpacity = 0.3;
        next();
        next({ isSorted: false });
        next({ isSorted: true, sortedCount: -1 });
        next({ sortedCount: 0 });
        viewer.flight = { from: { ...viewer.camera }, pose: VIEWS[1], done: 0 };
        next();
        return answers;
        """
    )
    assert found == [
        [["draw", "drawn"], 0.3], [["draw"], None], [[], None], [["draw", "drawn"], 0.3], [["sort", "draw", "drawn"],
          None],
    ]  # fmt: skip


def test_what_a_hand_touched_springs_back_and_what_it_did_not_stays() -> None:
    found = run(
        """
        const viewer = made(), places = [];
        viewer.camera.shift(2, 0, 0);
        pass(20);
        places.push(viewer.camera.position[0]);
        listeners.pointerdown({ pointerId: 1, clientX: 0, clientY: 0, timeStamp: 0 });
        pass(20);
        places.push(viewer.camera.position[0]);
        viewer.isDirty = false;
        listeners.pointerup({ pointerId: 1, clientX: 0, clientY: 0, timeStamp: 0 });
        const first = names(pass(20));
        places.push(viewer.camera.position[0] < 2);
        for (let n = 0; n < 200; n++) pass(20);
        return [places, first, viewer.bound.strain(viewer.camera) < 1.01, names(pass(20)), viewer.isAway];
        """
    )
    assert found == [[2, 2, True], ["sort", "draw", "drawn"], True, [], True]


def test_coming_back_and_moving_by_itself() -> None:
    found = run(
        """
        const viewer = made(VIEWS, { isStill: false }), states = [], state = () => states.push([viewer.isSwinging,
          viewer.isAway ?? null, viewer.touched ?? null, names(told.splice(0))]);
        told.splice(0);
        listeners.keydown({ code: "KeyW", preventDefault() {} });
        state();
        listeners.keydown({ code: "KeyW", preventDefault() {} });
        state();
        listeners.keydown({ code: "Home" });
        state();
        viewer.time = 7;
        viewer.swing(true);
        state();
        viewer.flight = {};
        viewer.swing(false);
        state();
        return [states, viewer.time, viewer.flight];
        """
    )
    assert found == [
        [
            [False, True, True, ["touched", "moved", "sort"]], [False, True, True, ["moved", "sort"]], [False, False,
              False, ["moved"]],
            [True, False, False, ["moved"]], [False, True, False, ["moved"]],
        ],
        0, None,
    ]  # fmt: skip


def test_going_anywhere_frees_the_camera_until_it_is_called_back() -> None:
    found = run(
        """
        const viewer = made(), movers = [viewer.mover === viewer.near];
        viewer.isDirty = false;
        viewer.setFree(true);
        movers.push(viewer.mover === viewer.free, viewer.isDirty);
        viewer.camera.shift(5, 5, 5);
        told.splice(0);
        viewer.setFree(false);
        movers.push(viewer.mover === viewer.near, viewer.camera.position, names(told.splice(0)));
        const list = made([VIEWS[0]], { hasCameras: false });
        list.camera.shift(1, 0, 0);
        list.setFree(false);
        return [...movers, list.camera.position, list.mover === list.free];
        """
    )
    assert found == [True, True, True, True, [0, 0, 0], ["sort", "moved"], [1, 0, 0], True]


def test_a_point_is_on_the_nearest_quarter_of_what_shows_there() -> None:
    found = run(
        """
        const at = [211, 97], depths = [5, 3, 4, 2.5, 1, 0.015, -3, 2, 2, 2, 1.5], aside = [0, 0, 0, 0, 7.9, 0, 0,
          8.1, 0, 0, 0];
        const cloud = cloudOf(11, { parts: [{ view: 0, from: 0, to: 8 }, { view: -1, from: 8, to: 9 }, { view: 2,
          from: 9, to: 11 }] });
        const viewer = made([{ ...VIEWS[0], K: [300, 0, 280, 165, 115] }, ...VIEWS.slice(1)], { cloud }), {
          camera } = viewer;
        camera.shift(0.1, 0.2, -0.1);
        depths.forEach((depth, i) => {
          const [x, y] = [0.8 * aside[i], -0.6 * aside[i]];
          cloud.means.set(add(camera.position, camera.ray(at[0] + x, at[1] + y, 400, 250), depth), 3 * i);
        });
        cloud.opacities.set([1, 0.26, 0.9, 1, 1, 1, 1, 1, 0.24, 1, 1]);
        const shares = { front: [0, 0, 0], all: [1, 0, 0] };
        viewer.shares = () => shares;
        const depthAt = (x, y) => { const p = add(viewer.pointAt(x, y), camera.position, -1), ray = camera.ray(x, y,
          400, 250); return [p[2] / ray[2], p[0] / ray[0], p[1] / ray[1]]; };
        const one = depthAt(...at), none = depthAt(20, 30);
        shares.all[2] = 1;
        const all = depthAt(...at);
        cloud.opacities[8] = 0.25;
        const more = depthAt(...at);
        shares.all[0] = 0;
        return [one, none, all, more, depthAt(...at)];
        """
    )
    np.testing.assert_allclose(found, np.repeat([[2.5], [4], [1.5], [2], [1.5]], 3, axis=1), rtol=1e-5)


def test_a_double_click_returns_or_turns_to_what_shows_there() -> None:
    found = run(
        """
        const viewer = made();
        viewer.camera.shift(1, 0, 0);
        listeners.dblclick({});
        const back = viewer.camera.position; viewer.setFree(true);
        viewer.camera.shift(0.2, 0.1, -0.3);
        viewer.camera.swing(UP, 0.2, 0.1);
        const point = [0.7, 0.4, 5];
        viewer.pointAt = (x, y) => (x === 250 && y === 180 ? point : null);
        told.splice(0);
        listeners.dblclick({ offsetX: 250, offsetY: 180 });
        const away = add(point, viewer.camera.position, -1), { target } = viewer.camera;
        return [back, target, point, viewer.camera.reach, length(away), viewer.isAway, names(told),
          viewer.camera.rotation[0][1]];
        """
    )
    close(found[0], [0, 0, 0])
    np.testing.assert_allclose(found[1], found[2], atol=0.02)
    assert found[3] == pytest.approx(found[4]) and found[5:7] == [True, ["moved", "sort"]]
    assert abs(found[7]) < 1e-9


def test_frames_say_what_is_to_be_drawn() -> None:
    found = run(
        """
        const viewer = made(), plain = viewer.drawing();
        Object.assign(viewer.settings, { degree: 1, leastOpacity: 0.4, ownPixels: false, lines: true });
        viewer.touched = true;
        viewer.camera.position = add(viewer.camera.position, [0, 0, -0.28 * 1.175]);
        const strained = viewer.drawing();
        viewer.isFree = true;
        const free = viewer.drawing();
        viewer.settings.depth = true;
        const deep = viewer.drawing();
        const bare = made(VIEWS, { isBare: true });
        bare.settings.lines = true;
        return [plain, strained, free, deep, bare.drawing()].map(({ shares, lines, ...rest }) => ({ ...rest,
          shares: shares.all.length ?? Object.keys(shares.all).length, lines: lines && lines.length }));
        """
    )
    plain = {"nearPlane": 0.02, "ownPixels": True, "degree": 2, "leastOpacity": 0, "depth": False, "fades": True,
      "light": 1,
             "lightBehind": 0.6, "shares": 3, "lines": None}  # fmt: skip
    changed = {**plain, "degree": 1, "leastOpacity": 0.4, "ownPixels": False, "lines": 3 * 16 * 3}
    assert found == [
        plain, {**changed, "light": pytest.approx(0.7)}, changed, {**changed, "depth": True, "fades": False,
          "lightBehind": 0},
        {**plain, "fades": False, "lightBehind": 0},
    ]  # fmt: skip


def test_cameras_are_shown_as_their_pictures_frames() -> None:
    lines, rotation, position = run(
        "const viewer = made([VIEWS[1]]); return [[...viewer.lines], VIEWS[1].rotation, VIEWS[1].position]"
    )
    size, (fx, skew, fy, cx, cy) = 0.16, (300, 2, 280, 165.5, 115)
    corners = []
    for u, v in ((0, 0), (320, 0), (320, 240), (0, 240)):
        y = (v - cy) / fy
        corners.append(np.array(position) + size * np.array([(u - cx - skew * y) / fx, y, 1]) @ np.array(rotation))
    (a, b, c, d), eye = corners, np.array(position)
    wanted = [eye, a, eye, b, eye, c, eye, d, a, b, b, c, c, d, d, a]
    np.testing.assert_allclose(np.reshape(lines, (-1, 3)), wanted, rtol=1e-5, atol=1e-6)
