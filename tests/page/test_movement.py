"""Where the page's camera may go: near the views, by whatever a hand does."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest
from web.node import node

import tinysplat_runtime as ts

PAGE = Path(ts.__file__).parent / "page"

START = """
import { Bound, elastic, lightAt, poseBetween, walk } from "./bound.js";
import { Camera, fillingZoom } from "./camera.js";
import { fadeAt } from "./cloud.js";
import { BoundMover, FreeMover } from "./movers.js";
import { add, dot, length, turned } from "./vectors.js";
const ROWS = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], UP = [0, -1, 0], WINDOW = [800, 600];
const view = (x, turn = 0) => ({
  K: [500, 0, 500, 320, 240], width: 640, height: 480, position: [x, 0, 0],
  rotation: ROWS.map((row) => turned(row, UP, turn)),
});
let seed = 5;
const random = () => (seed = (seed * 16807) % 2147483647) / 2147483647;
function start(views, spread = 0.25) {
  const camera = new Camera(views[0], 4), bound = new Bound(views, 4, spread);
  camera.zoom = fillingZoom(camera, ...WINDOW);
  return { camera, bound, mover: new BoundMover(camera, bound, UP, () => WINDOW) };
}
function settle(mover) { for (let i = 0; i < 300 && mover.spring(0.016); i++); }
"""


def run(code: str) -> Any:
    """What `code` returns, in node, with the page's modules at hand."""
    text = f"{START}\nconst answer = (() => {{ {code} }})();\nconsole.log(JSON.stringify(answer));"
    command = [node(), "--input-type=module", "-e", text]
    done = subprocess.run(command, cwd=PAGE, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize(
    "views", ["[view(0)]", "[view(0), view(0.4, 0.05)]", "[0, 1, 2, 3, 4, 5, 6].map((v) => view(v, v / 4))"]
)
def test_no_drag_slide_or_key_leaves_the_bound(views: str) -> None:
    pulled, settled, rolls, strays = run(
        f"""
        const pulled = [], settled = [], rolls = [], strays = [];
        for (let n = 0; n < 60; n++) {{
          const {{ camera, bound, mover }} = start({views}), x = 400 * (random() - 0.5), y = 400 * (random() - 0.5);
          const ways = [() => mover.turn(x, y), () => mover.slide(x, y), () => mover.keys([0, 1, 1, 1, 1], 0.1, true)];
          for (let i = 0; i < 30; i++) ways[n % 3]();
          pulled.push(bound.strain(camera));
          settle(mover);
          settled.push(bound.strain(camera));
          rolls.push(Math.abs(dot(camera.rotation[0], UP)));
          strays.push(Math.hypot(...bound.stray(camera, ...WINDOW)));
        }}
        return [pulled, settled, rolls, strays].map((values) => Math.max(...values));
        """
    )
    assert 1.1 < pulled < 1.37
    assert 0.99 < settled < 1.02
    assert rolls < 1e-6 and strays < 0.01


def test_an_untouched_camera_stays_and_a_small_drag_is_kept() -> None:
    moved, strain, back = run(
        """
        const { camera, bound, mover } = start([view(0), view(0.4)]);
        const isMoved = mover.spring(0.1);
        mover.turn(20, 0);
        const after = [...camera.position], strain = bound.strain(camera);
        settle(mover);
        return [isMoved, strain, length(add(after, camera.position, -1))];
        """
    )
    assert not moved and 0.1 < strain < 1 and back < 1e-9


def test_the_hull_is_the_ways_between_neighbours() -> None:
    assert run(
        """
        const { bound } = start([view(0), view(0.4, 0.1)]), on = poseBetween(view(0), view(0.4, 0.1), 0.3);
        const away = { ...on, position: add(on.position, on.rotation[1], bound.side) };
        const ahead = { ...on, position: add(on.position, on.rotation[2], bound.side) };
        return [bound.strain(on), bound.strain(away), bound.strain(ahead)];
        """
    ) == pytest.approx([0, 1, 0.4], abs=1e-3)
    # in the middle of a ring of views that look inwards nothing is known of what one sees from there
    assert (
        run(
            """
            const on = (angle) => ({ ...view(0, angle), position: turned([0, 0, -4], UP, angle) });
            const ring = [...Array(12).keys()].map((n) => on(n * Math.PI / 6));
            const bound = new Bound(ring, 4, 0.25);
            return bound.strain({ position: [0, 0, 0], rotation: ROWS });
            """
        )
        > 3
    )


def test_deep_scenes_bind_closer() -> None:
    flat, deep, deepest = run("return [0.1, 0.5, 50].map((spread) => new Bound([view(0)], 4, spread).side / 4)")
    assert flat == pytest.approx(0.035 / 0.1**0.5) and deep == pytest.approx(0.035 / 0.5**0.5) and deepest == 0.02


def test_the_wheel_goes_to_the_pointer_and_stops_before_the_surface() -> None:
    pixels, distance, zoom, strain, away = run(
        """
        const { camera, bound, mover } = start([view(0), view(0.4)]), point = [0.5, 0.3, 0.3];
        const onScreen = () => {
          const { projection: P, principal } = camera.fitted(...WINDOW);
          const ray = add(point, camera.position, -1), z = dot(P.slice(6), ray);
          return [dot(P.slice(0, 3), ray) / z + principal[0], dot(P.slice(3, 6), ray) / z + principal[1]];
        };
        const far = [0.5, 0.3, 3], free = new FreeMover(camera, UP, () => WINDOW, 4), before = camera.position;
        point.splice(0, 3, ...far);
        const [x, y] = onScreen();
        mover.near(1.1, x, y, point);
        const shift = length(add([x, y, 0], [...onScreen(), 0], -1));
        point.splice(0, 3, 0.1, 0, 0.3);
        for (let i = 0; i < 100; i++) mover.near(1.3, 400, 300, point);
        settle(mover);
        const result = [shift, length(add(point, camera.position, -1)), camera.zoom, bound.strain(camera)];
        for (let i = 0; i < 100; i++) mover.near(1 / 1.3, 400, 300, point);
        settle(mover);
        return [...result, camera.zoom];
        """
    )
    assert pixels < 1 and distance > 0.12 and strain < 1.02
    assert 3 < zoom < 6 and away == 1


def test_free_movement_comes_near_and_goes_not_too_far() -> None:
    near, far = run(
        """
        const { camera } = start([view(0)]), free = new FreeMover(camera, UP, () => WINDOW, 4), point = [0, 0, 4];
        for (let i = 0; i < 50; i++) free.near(1.2, 400, 300, point);
        const near = length(add(point, camera.position, -1)) * Math.sign(4 - camera.position[2]);
        for (let i = 0; i < 200; i++) free.near(1 / 1.2, 400, 300, point);
        return [near, length(add(point, camera.position, -1))];
        """
    )
    assert 0 < near < 0.01 and 30 < far < 45


def test_windows_are_filled_where_little_is_lost() -> None:
    whole, wide, tall = run("return [[640, 480], [800, 500], [390, 844]].map(([w, h]) => fillingZoom(view(0), w, h))")
    assert whole == 1 and wide == pytest.approx(1.2) and tall == pytest.approx((844 / 480 * 640 / 390) ** 0.5)


def test_what_lies_beyond_a_picture_fades() -> None:
    inside, edge, beyond, far, backdrop = run(
        """
        const at = (isFront, x) => fadeAt(view(0), isFront, x, 240);
        return [at(true, 320), at(true, 639), at(false, 660), at(false, 720), at(false, 320)];
        """
    )
    assert inside == backdrop == 1 and far == 0 and edge < 0.05 and 0.3 < beyond < 1


def test_the_border_gives_and_dims() -> None:
    kept, over, again, lights = run(
        "return [elastic(0, 0.7), elastic(0, 9), elastic(1.3, 1.4), [0.5, 1, 1.2, 1.35].map(lightAt)]"
    )
    assert kept == 0.7 and 1.3 < over < 1.35 and 1.3 < again < 1.32
    assert lights[:2] == [1, 1] and lights[2] > lights[3] == pytest.approx(0.4)


def test_a_walk_goes_on_to_the_nearest() -> None:
    assert run("return walk([view(0), view(3), view(1), view(2)], 4)") == [0, 2, 3, 1]
