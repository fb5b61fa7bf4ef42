"""What movements of a hand do to the page's camera: each step as it is described, on a camera like any other."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from page.scripts import run as run_with

START = """
import { Bound, elastic } from "./bound.js";
import { Camera } from "./camera.js";
import { BoundMover, FreeMover } from "./movers.js";
import { add, dot, length, mix, turned } from "./vectors.js";
const UP = [0, -1, 0], SIZE = [800, 650], WINDOW = () => SIZE, ROWS = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
const view = (x, turn) => ({
  K: [500, 3, 480, 310 + 9 * x, 250], width: 640, height: 470, position: [x, 0.1 * x, 0],
    rotation: ROWS.map((row) => turned(row, UP, turn)),
});
function bounded(zoom = 1.4, views = [view(0, 0), view(0.5, 0.1)]) {
  const camera = new Camera(views[0], 4), bound = new Bound(views, 4, 0.25);
  camera.zoom = zoom;
  camera.shift(0.05, 0.03, -0.02);
  return { camera, bound, mover: new BoundMover(camera, bound, UP, WINDOW) };
}
function free() {
  const camera = new Camera(view(0.2, 0.15), 3);
  camera.zoom = 1.4;
  return { camera, mover: new FreeMover(camera, UP, WINDOW, 4) };
}
const pose = ({ position, rotation, zoom, reach, K }) => [...position, ...rotation.flat(), zoom, reach, ...K];
// What follows every movement near the views: the look goes back to the picture, and what is beyond the bound gives.
function held({ camera, bound }, change) {
  const before = bound.strain(camera);
  change(camera);
  const [x, y] = bound.stray(camera, ...SIZE);
  camera.swing(UP, 0.7 * x, -0.7 * y);
  bound.pull(camera, elastic(before, bound.strain(camera)));
  camera.K = bound.foot(camera).K;
}
// One of two alike moves by itself, the other as is said.
function both(make, move, change) {
  const [one, other] = [make(), make()];
  move(one.mover);
  change(other);
  return [pose(one.camera), pose(other.camera)];
}
"""


def run(code: str) -> Any:
    return run_with(code, START)


def alike(code: str) -> None:
    for found, wanted in run(code):
        np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12)
    assert len(found) == 19


def test_drags_near_the_views_turn_about_the_scene_and_look_where_the_picture_goes_on() -> None:
    alike(
        """
        const one = ([dx, dy, zoom], far) => both(
          () => bounded(zoom, [view(0, 0), view(far, 0.1)]), (mover) => mover.turn(dx, dy),
          (other) => held(other, (camera) => {
            const [width, height] = SIZE, { bound } = other, rate = Math.min(1, 3 * bound.width / 4) / width;
            const scale = zoom * (height > 600 ? 1.25 : 500 / 470), rest = [640 * scale - width,
              470 * scale - height].map((n) => Math.max(n, 0));
            camera.swing(UP, -rate * dx, rate * dy, add(camera.position, camera.rotation[2], 4));
            camera.swing(UP, dx * rest[0] / (0.8 * width) / (500 * scale),
              -dy * rest[1] / (0.8 * height) / (480 * scale));
          }));
        return [[800, 650], [900, 500]].flatMap((size) => {
          SIZE.splice(0, 2, ...size);
          return [[60, -35, 1.4], [-300, 0, 1.1], [0, 90, 3], [900, 400, 1]].flatMap((drag) => [0.5,
            3.9].map((far) => one(drag, far)));
        });
        """
    )


def test_slides_near_the_views_are_a_quarter_of_what_a_hand_moves() -> None:
    alike(
        """
        return [[60, -35], [-500, 220]].map(([dx, dy]) => both(bounded, (mover) => mover.slide(dx, dy),
          (other) => held(other, (camera) => {
            const share = 0.25 * 4 / (1.4 * 1.25 * Math.sqrt(500 * 480));
            camera.shift(-dx * share, -dy * share, 0);
          })));
        """
    )


def test_approaches_share_between_way_and_lens_and_keep_their_distance() -> None:
    alike(
        """
        const cases = [[1.2, [0.3, 0.2, 4], 0], [0.9, [0.3, 0.2, 4], 0], [5, [0, 0.1, 3], 0], [0.01, [0, 0.1, 3], 0],
          [1.5, [0.1, 0, 0.3], 0],
          [2.5, [0.3, 0.2, 4], 2.2], [2.5, [0.3, 0.2, 4], 2.8]];
        const ahead = (far) => { const made = bounded(); made.camera.shift(0, 0, far); return made; };
        return cases.map(([factor, point, far]) => both(() => ahead(far), (mover) => mover.near(factor, 300, 350,
          point), (other) => {
          const { camera, bound } = other, before = camera.zoom, zoom = Math.min(Math.max(before * factor, 1), 4);
          const foot = bound.foot(camera), depth = length(add(point, foot.position, -1)), now = length(add(point,
            camera.position, -1));
          const wanted = Math.max(now * Math.sqrt(before / zoom), Math.min(now, 0.4 * depth));
          held(other, () => {
            camera.zoom = zoom;
            camera.position = mix(point, camera.position, wanted / now);
            const angles = (v) => [0, 1].map((k) => Math.atan2(dot(v, camera.rotation[k]), dot(v, camera.rotation[2])));
            const [asked, found] = [camera.ray(300, 350, ...SIZE), add(point, camera.position, -1)].map(angles);
            camera.swing(UP, asked[0] - found[0], found[1] - asked[1]);
          });
        }));
        """
    )


def test_a_zoom_has_its_home_for_least() -> None:
    assert run(
        """
        return [0.01, 100].map((factor) => {
          const { camera, mover } = bounded();
          mover.least = 1.2;
          mover.near(factor, 400, 325, [0, 0, 4]);
          return camera.zoom;
        });
        """
    ) == [1.2, pytest.approx(4.8)]


def test_keys_near_the_views_are_drags_and_approaches() -> None:
    alike(
        """
        const cases = [[[1, 0, 0, 0, 0], -0.1 * 0.35 * 800, 0], [[0.5, 0, 0, 2, 0], -0.1 * 0.35 * 800 * 2.5, 0],
          [[0, 1, 0, 0, 0], 0, -0.1 * 0.35 * 800], [[0, 0.5, 0, 0, -2], 0, 0.1 * 0.35 * 800 * 1.5],
          [[0, 0, 0, 1, 0], -0.1 * 0.8 * 800, 0, true], [[0, 0, 0, 0, 1], 0, -0.1 * 0.8 * 800, true]];
        const turns = cases.map(([keys, dx, dy, isFast = false]) =>
          both(bounded, (mover) => mover.keys(keys, 0.1, isFast), ({ mover }) => mover.turn(dx, dy)));
        const ways = [[1, false, 0.06], [-1, false, -0.06], [2, true, 0.3]].map(([forward, isFast, log]) =>
          both(bounded, (mover) => mover.keys([0, 0, forward, 0, 0], 0.1, isFast), ({ mover, camera }) =>
            mover.near(Math.exp(log), 400, 325, add(camera.position, camera.rotation[2], 4))));
        return [...turns, ...ways];
        """
    )
    assert run(
        """
        const { mover } = bounded(), told = [];
        mover.turn = mover.near = () => told.push(1);
        return [[0, 0, 0, 0, 0], [0, 0, 0, 1, 0], [0, 1, 0, 0, 0], [0, 0, 1, 0, 0], [1, 1, 1, 0, 0]].map((keys) => {
          mover.keys(keys, 0.1, false);
          return told.splice(0).length;
        });
        """
    ) == [0, 1, 1, 1, 3]


def test_the_spring_takes_half_a_second_and_then_rests() -> None:
    alike(
        """
        const away = () => { const made = bounded(); made.camera.shift(0.7, -0.1, 0.2); made.camera.swing(UP, 0.3,
          0.2); return made; };
        return [0.016, 0.1].map((seconds) => both(away, (mover) => mover.spring(seconds), ({ camera, bound }) => {
          const left = Math.exp(-seconds / 0.12), [x, y] = bound.stray(camera, ...SIZE);
          camera.swing(UP, (1 - left) * x, -(1 - left) * y);
          bound.pull(camera, 1 + (bound.strain(camera) - 1) * left);
        }));
        """
    )
    states = run(
        """
        const rests = (zoom, up, aside) => {
          const { camera, bound, mover } = bounded(zoom, [view(0, 0)]);
          camera.set(view(0, 0), 4, zoom);
          camera.position = [0, up * bound.side, 0];
          let [least, most] = [0, zoom > 2 ? 0 : 0.3]; // the turn that the picture's edge allows
          for (let i = 0; i < 50; i++) {
            const angle = (least + most) / 2;
            camera.rotation = view(0, angle).rotation;
            if (bound.stray(camera, ...SIZE)[0] === 0) least = angle;
            else most = angle;
          }
          camera.rotation = view(0, least + aside).rotation;
          return !mover.spring(0);
        };
        return [rests(3, 1.0005, 0), rests(3, 1.002, 0), rests(1, 0, 0.0005), rests(1, 0, 0.002), rests(1, 1.2, 0.1)];
        """
    )
    assert states == [True, False, True, False, False]


def test_free_drags_orbit_or_look_around_and_slide_with_the_hand() -> None:
    alike(
        """
        const focal = 1.4 * 1.25 * Math.sqrt(500 * 480), drags = [[60, -35], [-200, 80]];
        return drags.flatMap(([dx, dy]) => [
          both(free, (mover) => mover.turn(dx, dy), ({ camera }) =>
            camera.swing(UP, -4 * dx / 800, 4 * dy / 800, add(camera.position, camera.rotation[2], 3))),
          both(free, (mover) => { mover.flies = true; mover.turn(dx, dy); }, ({ camera }) => camera.swing(UP,
            dx / focal, -dy / focal)),
          both(free, (mover) => mover.slide(dx, dy), ({ camera }) => camera.shift(-dx * 3 / focal, -dy * 3 / focal, 0)),
        ]);
        """
    )


def test_free_approaches_and_keys() -> None:
    alike(
        """
        const point = [0.5, -0.3, 5], far = [0, 0, 33];
        const nears = [[1.25, point, 0.2], [0.8, point, -0.25], [2, far, 0.5], [0.8, far, 0], [0.8, [-31.7, 0.02, 0],
          -0.25]].map(([factor, to, share]) =>
          both(free, (mover) => mover.near(factor, 9, 9, to), ({ camera }) => {
            camera.position = mix(camera.position, to, share);
            camera.reach *= 1 - share;
          }));
        const keys = [[false, 0.4, 0.6], [true, 1.5, 1.8]].map(([isFast, way, angle]) =>
          both(free, (mover) => mover.keys([1, -2, 3, 0.5, -0.7], 0.1, isFast), ({ camera }) => {
            camera.shift(0.3 * way, -0.6 * way, 0.9 * way);
            camera.swing(UP, -0.05 * angle, -0.07 * angle);
          }));
        return [...nears, ...keys];
        """
    )
    assert run("return free().mover.spring(1)") is False
