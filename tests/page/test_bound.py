"""How near the views the page's camera is kept, beside the same in numpy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from page.scripts import close
from page.scripts import run as run_with
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation, Slerp

START = """
import { Bound, elastic, lightAt, poseBetween, walk } from "./bound.js";
import { Camera } from "./camera.js";
"""
DEPTH, SPREAD = 4.0, 0.25
SIDE = DEPTH * 0.07


def view(n: int) -> dict[str, Any]:
    """Views along an arc, all different."""
    rotation = Rotation.from_rotvec([0.05 * n, 0.2 * n - 0.3, 0.02]).as_matrix()
    return {
        "K": [500 + n, 3 - n, 480 - n, 310 + 2 * n, 250], "width": 640, "height": 470, "rotation": rotation.tolist(),
        "position": [0.9 * n, -0.05 * n * n, 0.1 * n],
    }  # fmt: skip


def run(code: str, **given: Any) -> Any:
    return run_with(code, START, **given)


def between(a: dict[str, Any], b: dict[str, Any], t: float) -> tuple[NDArray, NDArray]:
    """Place and rotation."""
    rotations = Rotation.from_matrix([a["rotation"], b["rotation"]])
    return (1 - t) * np.array(a["position"]) + t * np.array(b["position"]), Slerp([0, 1], rotations)(t).as_matrix()


def test_a_walk_takes_turns_of_the_head_for_ways_too() -> None:
    turned, aside = dict(view(8), position=[0, 0, 0]), dict(view(0), position=[2.5, 0, 0])
    found = run("return [2, 4, 40].map((depth) => walk(views, depth))", views=[view(0), turned, aside])
    assert found == [[0, 1, 2], [0, 2, 1], [0, 2, 1]]
    far = dict(aside, position=[3.5, 0, 0])
    assert run("return walk(views, 4)", views=[view(0), turned, far]) == [0, 1, 2]
    assert run("return walk(views, 4)", views=[view(n) for n in (3, 0, 2, 5, 1)]) == [0, 2, 4, 1, 3]


@pytest.mark.parametrize("t", [0, 0.3, 0.5, 0.8])
def test_poses_between_views_share_their_lenses(t: float) -> None:
    a, b = view(0), view(3)
    found = run(f"return [poseBetween(a, b, {t}), poseBetween(a, wider, {t})]", a=a, b=b, wider=dict(b, width=700))
    place, rotation = between(a, b, t)
    for pose in found:
        close(pose["position"], place)
        close(pose["rotation"], rotation)
    close(found[0]["K"], (1 - t) * np.array(a["K"]) + t * np.array(b["K"]))
    assert (found[1]["K"], found[1]["width"]) == ((a["K"], 640) if t < 0.5 else (b["K"], 700))
    tall = run(f"return poseBetween(a, tall, {t})", a=a, tall=dict(b, height=500))
    assert (tall["K"], tall["height"]) == ((a["K"], 470) if t < 0.5 else (b["K"], 500))


@pytest.mark.parametrize("count", [1, 2, 4, 5, 7])
def test_few_views_are_all_joined_and_many_to_their_nearest(count: int) -> None:
    views = [view(n) for n in range(count)]
    edges, width, side = run(
        f"const bound = new Bound(views, {DEPTH}, {SPREAD}); return [bound.edges, bound.width, bound.side]", views=views
    )
    if count == 1:
        wanted = [[0, 0]]
    elif count <= 4:
        wanted = [[i, j] for i in range(count) for j in range(i + 1, count)]
    else:
        places = np.array([one["position"] for one in views])
        forward = np.array([one["rotation"][2] for one in views])
        far = np.hypot(
            *(np.linalg.norm(x[:, None] - x[None], axis=2) * by for x, by in ((places, 1 / DEPTH), (forward, 0.5)))
        )
        wanted = [[i, int(j)] for i in range(count) for j in np.argsort(far[i])[1:4]]
    assert edges == wanted and side == pytest.approx(SIDE)
    longest = max(np.linalg.norm(np.subtract(views[i]["position"], views[j]["position"])) for i, j in wanted)
    assert width == pytest.approx(SIDE + longest / 2)


def test_sides_follow_depth_and_its_spread_within_limits() -> None:
    spreads = [0, 1e-9, 0.2, 1, 3, 4, 100]
    found = run("return spreads.map((spread) => new Bound(views, 3, spread).side)", views=[view(0)], spreads=spreads)
    close(found, [0.36, 0.36, 3 * 0.035 / 0.2**0.5, 0.105, 3 * 0.035 / 3**0.5, 0.06, 0.06])


@pytest.mark.parametrize("seed", range(4))
def test_the_foot_is_the_nearest_pose_on_the_ways(seed: int) -> None:
    rng = np.random.default_rng(seed)
    views = [view(n) for n in range(3)]
    rotation = Rotation.from_rotvec(rng.normal(0, 0.3, 3)).as_matrix()
    camera = {"position": rng.normal(0.9, 0.8, 3).tolist(), "rotation": rotation.tolist()}
    foot, strain, pulled = run(
        f"""
        const bound = new Bound(views, {DEPTH}, {SPREAD}), foot = bound.foot(camera), strain = bound.strain(camera);
        const places = [strain / 2, 2 * strain].map((most) => {{
          const moved = {{ ...camera }};
          bound.pull(moved, most);
          return moved.position;
        }});
        return [foot, strain, places];
        """,
        views=views, camera=camera,
    )  # fmt: skip

    def away(i: int, j: int, t: float) -> float:
        place, forward = (
            (1 - t) * np.array(views[i][key][2] if key == "rotation" else views[i][key])
            + t * np.array(views[j][key][2] if key == "rotation" else views[j][key])
            for key in ("position", "rotation")
        )
        return float(
            np.hypot(np.linalg.norm(place - camera["position"]), 0.02 * DEPTH * np.linalg.norm(forward - rotation[2]))
        )

    found = []
    for i, j in ((0, 1), (0, 2), (1, 2)):
        t = minimize_scalar(
            lambda t, i=i, j=j: away(i, j, t), bounds=(0, 1), method="bounded", options={"xatol": 1e-10}
        ).x
        t = min((t, 0.0, 1.0), key=lambda t, i=i, j=j: away(i, j, t))
        found.append((away(i, j, t), i, j, t))
    _, i, j, t = min(found)
    place, turned = between(views[i], views[j], t)
    close(foot["position"], place, 1e-6)
    close(foot["rotation"], turned, 1e-6)
    off = np.subtract(camera["position"], foot["position"])
    ahead = off @ np.array(foot["rotation"][2])
    aside = np.linalg.norm(off - ahead * np.array(foot["rotation"][2]))
    assert strain == pytest.approx(np.hypot(aside, ahead / 2.5 if ahead > 0 else ahead) / SIDE)
    close(pulled, [(np.add(foot["position"], camera["position"]) / 2), camera["position"]])


def test_turns_decide_between_ways_that_are_equally_near() -> None:
    ways = [dict(view(0), position=[0, 0, 0]), dict(view(5), position=[0, 0, 0]), dict(view(2), position=[0, 0, 0])]
    camera = {"position": [0.01, 0.02, 0.03], "rotation": view(5)["rotation"]}
    foot, ahead, behind = run(
        f"""
        const bound = new Bound(views, {DEPTH}, {SPREAD}), ahead = new Bound([views[0]], {DEPTH}, {SPREAD});
        const at = (far) => ahead.strain({{ rotation: camera.rotation,
          position: views[0].rotation[2].map((x) => far * x) }});
        return [bound.foot(camera), at(0.5), at(-0.5)];
        """,
        views=ways, camera=camera,
    )  # fmt: skip
    close(foot["rotation"], view(5)["rotation"], 1e-9)
    assert (ahead, behind) == (pytest.approx(0.2 / SIDE), pytest.approx(0.5 / SIDE))


@pytest.mark.parametrize(
    ("zoom", "turn", "window"),
    [(1, 0.4, (800, 650)), (2.2, -0.5, (800, 650)), (1.5, 0.02, (500, 650)), (1.5, 0.3, (900, 400))],
)
def test_windows_stray_by_what_they_leave_of_the_picture(zoom: float, turn: float, window: tuple[int, int]) -> None:
    one, (width, height) = view(1), window
    place = np.add(one["position"], [0.1, -0.2, 0.15])
    rotation = Rotation.from_rotvec([0.8 * turn, turn, 0]).apply(np.array(one["rotation"]))
    found = run(
        f"""
        const camera = new Camera({{ ...view, rotation, position }}, 4);
        camera.zoom = {zoom};
        return new Bound([view], {DEPTH}, {SPREAD}).stray(camera, {width}, {height});
        """,
        view=one, rotation=rotation.tolist(), position=place.tolist(),
    )  # fmt: skip
    fx, skew, fy, cx, cy = one["K"]
    scale = min(width / 640, height / 470) * zoom
    ray = np.array([(320 - cx) / fx, (235 - cy) / fy, 1]) @ rotation
    x, y, z = np.array(one["rotation"]) @ (place + DEPTH * ray - one["position"])
    at = np.array([fx * x / z + skew * y / z + cx, fy * y / z + cy])
    whole = np.array([640, 470])
    free = (np.maximum(whole - np.array([width, height]) / scale, 0) + 0.08 * whole) / 2
    close(found, (at - np.clip(at, whole / 2 - free, whole / 2 + free)) / [fx, fy])


def test_what_is_pulled_beyond_gives_less_and_less() -> None:
    pulls = [(0.2, 0.9), (0.2, 1), (0.2, 1.5), (1.2, 1.1), (1.2, 1.5), (1.5, 2)]
    wanted = [0.9, 1, 1 + 0.35 * (1 - np.exp(-0.5 / 0.35)), 1.1, 1.2 + 0.15 * (1 - np.exp(-0.3 / 0.35)), 1.5]
    found = run("return [pulls.map(([a, b]) => elastic(a, b)), [0, 1, 1.07, 1.175, 1.35, 2].map(lightAt)]", pulls=pulls)
    close(found[0], wanted)
    close(found[1], [1, 1, 1 - 0.6 * 0.04 * 2.6, 0.7, 0.4, 0.4])
