"""The page's vectors and its camera, beside numpy and scipy."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from page.scripts import close
from page.scripts import run as run_with
from scipy.spatial.transform import Rotation, Slerp

START = """
import { Camera } from "./camera.js";
import { add, between, clamp, cross, dot, length, mix, scaled, turned, unit } from "./vectors.js";
const camera = new Camera(VIEW, 4);
camera.zoom = 1.3;
"""
ROWS = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix()
VIEW = {
    "K": [500, 7, 480, 310, 250],
    "width": 640,
    "height": 470,
    "rotation": ROWS.tolist(),
    "position": [0.4, -1.2, 2.5],
}
WINDOW = 800, 650
AXIS = np.array([2, -3, 6]) / 7


def run(code: str, **given: Any) -> Any:
    return run_with(code, **{"start": f"const VIEW = {VIEW};{START}", **given})


def test_vectors_are_numpy_s() -> None:
    a, b = np.array([1.5, -2.0, 3.0]), np.array([0.25, 5.0, -7.0])
    found = run(
        "return [add(a, b), add(a, b, -3), dot(a, b), cross(a, b), length(a), scaled(a, -2), unit(b), unit([0, 0, 0]), "
        "mix(a, b, 0.3), clamp(3, 1, 2), clamp(0, 1, 2), clamp(1.5, 1, 2), turned(a, axis, 0.7)]",
        a=a.tolist(),
        b=b.tolist(),
        axis=AXIS.tolist(),
    )
    norm = np.linalg.norm
    rotated = Rotation.from_rotvec(0.7 * AXIS).apply(a)
    wanted = [a + b, a - 3 * b, a @ b, np.cross(a, b), norm(a), -2 * a, b / norm(b), [0, 0, 0], 0.7 * a + 0.3 * b,
              2, 1, 1.5, rotated]  # fmt: skip
    for one, other in zip(found, wanted, strict=True):
        close(one, other)


@pytest.mark.parametrize("t", [0, 0.2, 0.7, 1])
def test_ways_between_rotations_are_the_shorter_ones(t: float) -> None:
    turns = [[1.1, 0.4, -0.2], [-0.5, 0.9, 2.3], [0.2, 0.1, -3.0]]
    others = [(Rotation.from_rotvec(turn) * Rotation.from_matrix(ROWS)).as_matrix() for turn in turns]
    found = run(f"return others.map((to) => between(VIEW.rotation, to, {t}))", others=[o.tolist() for o in others])
    for one, other in zip(found, others, strict=True):
        close(one, Slerp([0, 1], Rotation.from_matrix([ROWS, other]))(t).as_matrix())


def test_a_window_shows_the_picture_as_large_as_fits_times_the_zoom() -> None:
    found = run(
        f"const {{ principal, focals, focal, projection }} = camera.fitted({WINDOW[0]}, {WINDOW[1]});"
        f"return [principal, focals, focal, projection, camera.ray(123, 456, {WINDOW[0]}, {WINDOW[1]}), "
        "camera.target, camera.fitted(3000, 300).focal, camera.fitted(300, 3000).focal]"
    )
    times = 1.3 * min(WINDOW[0] / 640, WINDOW[1] / 470)
    fx, skew, fy, cx, cy = times * np.array(VIEW["K"])
    principal = np.array([WINDOW[0] / 2 + cx - times * 320, WINDOW[1] / 2 + cy - times * 235])
    close(found[0], principal)
    close(found[1], [fx, fy])
    close(found[2], np.sqrt(fx * fy))
    close(found[3], (np.array([[fx, skew, 0], [0, fy, 0], [0, 0, 1]]) @ ROWS).ravel())
    close(found[4], [*((np.array([123, 456]) - principal) / [fx, fy]), 1] @ ROWS)
    close(found[5], np.array(VIEW["position"]) + 4 * ROWS[2])
    wide, tall = 1.3 * 300 / 470, 1.3 * 300 / 640
    close(found[6:], [wide * np.sqrt(500 * 480), tall * np.sqrt(500 * 480)])


def swung(rotation: NDArray, position: NDArray, left: float, down: float, about: NDArray) -> tuple[NDArray, NDArray]:
    """Rows and place after turning left about `up` and then downwards."""
    up = np.array([0, -1, 0.0])
    first = Rotation.from_rotvec(left * up)
    rotation, position = first.apply(rotation), about + first.apply(position - about)
    side = np.cross(rotation[2], up)
    second = Rotation.from_rotvec(-down * side / np.linalg.norm(side))
    return second.apply(rotation), about + second.apply(position - about)


@pytest.mark.parametrize(("left", "down"), [(0.3, 0.2), (-1.1, -0.4)])
def test_swings_turn_to_the_left_and_downwards_about_a_point(left: float, down: float) -> None:
    about, start = np.array([0.3, 0.8, 5.0]), np.array(VIEW["position"])
    found = run(f"camera.swing([0, -1, 0], {left}, {down}, [0.3, 0.8, 5]); return [camera.rotation, camera.position]")
    for one, other in zip(found, swung(ROWS, start, left, down, about), strict=True):
        close(one, other)
    found = run(f"camera.swing([0, -1, 0], {left}, {down}); return [camera.rotation, camera.position]")
    for one, other in zip(found, (swung(ROWS, start, left, down, about)[0], start), strict=True):
        close(one, other)


def test_nobody_swings_past_straight_up_or_down() -> None:
    forward, right = np.array(
        run(
            "return [9, -9].map((down) => { camera.swing([0, -1, 0], 0.1, down); return [camera.rotation[2], "
            "camera.rotation[0]]; })"
        )
    ).swapaxes(0, 1)
    assert forward[0, 1] > 0.9 and forward[1, 1] < -0.9  # y points down
    assert right[0] @ right[1] > 0.9  # no side is swapped
