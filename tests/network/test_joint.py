"""The step in which all photos of a capture agree on depth: what it costs a plane, and what comes of it."""

import itertools
import math

import numpy as np
import pytest
from networks.two_planes import FAR, NEAR, TracedScene, trace
from numpy.typing import NDArray

from tinysplat_runtime.network import kernels_joint as k
from tinysplat_runtime.network.joint import Photos, joint_depth
from tinysplat_runtime.network.kernels_joint import SEARCH
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.system.threads import Crew

H, W = 48, 64


@pytest.fixture(scope="module")
def scene() -> TracedScene:
    return trace(5, H, W)


def agreed(inverse: NDArray, scene: TracedScene, threads: int = 1) -> NDArray:
    Ks = np.stack([camera.K for camera in scene.cameras])
    return joint_depth(inverse, Photos(scene.images, Ks, scene.cameras, NEAR, FAR), Crew(threads).map)


def wrong_in_places(scene: TracedScene) -> tuple[NDArray, NDArray]:
    """True inverse depths (V, H, W), but in a block of each photo those of something a third nearer; where that is."""
    inverse, block = (1 / scene.depth).astype(np.float32), np.zeros(scene.depth.shape, bool)
    for v in range(len(inverse)):
        block[v, 12:22, 20 + 3 * v : 32 + 3 * v] = True
    return np.where(block, inverse * np.float32(1.33), inverse), block


def test_depths_that_others_contradict_are_corrected_and_right_ones_stay(scene: TracedScene) -> None:
    wrong, block = wrong_in_places(scene)
    off = np.abs(agreed(wrong, scene) * scene.depth - 1) > 0.05
    assert off[block].mean() < 0.2 and off[~block].mean() < 0.03  # edges of what is nearer are a pixel wide


def test_no_depth_depends_on_threads(scene: TracedScene) -> None:
    wrong, _ = wrong_in_places(scene)
    assert np.array_equal(agreed(wrong, scene, 1), agreed(wrong, scene, 3))


def test_a_photo_of_elsewhere_stays_and_tells_others_nothing(scene: TracedScene) -> None:
    away = scene.cameras[2].c2w.copy()
    away[:3, :3] = away[:3, :3] @ np.diag([-1.0, 1, -1])  # looks the other way
    cameras = [c if v != 2 else Camera(c.K, away, W, H) for v, c in enumerate(scene.cameras)]
    wrong, _ = wrong_in_places(scene)
    Ks = np.stack([camera.K for camera in cameras])
    found = joint_depth(wrong, Photos(scene.images, Ks, cameras, NEAR, FAR), Crew(1).map)
    assert np.array_equal(found[2], wrong[2])
    others = [0, 1, 3, 4]
    four = TracedScene(**{**vars(scene), "cameras": [cameras[v] for v in others]})
    four = TracedScene(**{**vars(four), "images": scene.images[others], "depth": scene.depth[others]})
    assert np.array_equal(found[others], agreed(wrong[others], four))


def reference_cost(grey, colours, inverse, A, b, plane, x, y, first) -> float:
    """What a plane costs, by its definition and pixel by pixel, float64; no smoothness (the caller has one plane)."""
    taps = [t for t in itertools.product(range(-SEARCH.radius, SEARCH.radius + 1), repeat=2) if sum(t) % 2 == 0]
    near = [(min(max(x + dx, 0), W - 1), min(max(y + dy, 0), H - 1)) for dx, dy in taps]
    weights = np.array(
        [
            math.exp(
                -np.abs(colours[0][j, i] - colours[0][y, x]).sum() / 3 / SEARCH.reach_colour
                - math.hypot(dx, dy) / SEARCH.reach_place
            )
            for (dx, dy), (i, j) in zip(taps, near, strict=True)
        ]
    )
    weights /= weights.sum()
    own = np.array([grey[0][j, i] for i, j in near])
    mean = weights @ own
    variance = weights @ own**2 - mean**2
    p = np.array([x + 0.5, y + 0.5, 1])
    slope = np.array([plane[1], plane[2], 0])

    def bilinear(maps: NDArray, u: float, v: float) -> NDArray:
        u, v = min(max(u - 0.5, 0), W - 1), min(max(v - 0.5, 0), H - 1)
        i, j = min(int(u), W - 2), min(int(v), H - 2)
        s, t = u - i, v - j
        return (1 - t) * ((1 - s) * maps[j, i] + s * maps[j, i + 1]) + t * (
            (1 - s) * maps[j + 1, i] + s * maps[j + 1, i + 1]
        )

    costs, shifts = [], []
    for s in range(len(A)):

        def at(dx: float, dy: float, s: int = s) -> NDArray:
            off = np.array([dx, dy, 0])
            return A[s] @ (p + off) + (plane[0] + slope @ off) * b[s]

        place = at(0, 0)
        u, v = place[:2] / place[2]
        step = 1e-4
        by_x, by_y = ((at(*d)[:2] / at(*d)[2] - place[:2] / place[2]) / step for d in ((step, 0), (0, step)))
        move = np.linalg.norm(b[s][:2] - place[:2] / place[2] * b[s][2])
        shifts.append(move / place[2])
        if not (0.5 <= u <= W - 0.5 and 0.5 <= v <= H - 0.5):
            continue
        values = np.array([bilinear(grey[s + 1], *(np.array([u, v]) + dx * by_x + dy * by_y)) for dx, dy in taps])
        its = weights @ values
        spread = weights @ values**2 - its**2
        likeness = (weights @ (own * values) - mean * its) / math.sqrt(
            (variance + SEARCH.noise) * (spread + SEARCH.noise)
        )
        apart = np.abs(bilinear(colours[s + 1], u, v) - colours[0][y, x]).mean()
        cost = min(1 - likeness, 1)
        cost += (
            SEARCH.colour
            * (min(apart, SEARCH.colour_most) + min(abs(mean - its), SEARCH.colour_most))
            / (2 * SEARCH.colour_most)
        )
        gap = abs(inverse[s + 1][min(int(v), H - 1), min(int(u), W - 1)] - plane[0] / place[2])
        costs.append(cost + SEARCH.agree * min(gap * move, SEARCH.agree_px) / SEARCH.agree_px)
    costs.sort()
    counted = max(1, math.ceil(SEARCH.share * len(costs)))
    seen = np.mean(costs[:counted]) if costs else SEARCH.unseen
    pull = SEARCH.pull * (SEARCH.least_pull + SEARCH.noise / (variance + SEARCH.noise))
    return seen + pull * min(abs(plane[0] - first) * np.mean(shifts), SEARCH.pull_px) / SEARCH.pull_px


def test_a_plane_costs_what_its_definition_says(scene: TracedScene) -> None:
    rng = np.random.default_rng(7)
    colours = scene.images.astype(np.float64)
    grey = colours.mean(axis=-1)
    inverse = 1 / scene.depth
    first = inverse[0] * 1.02
    A, b = np.zeros((4, 3, 3)), np.zeros((4, 3))
    one = scene.cameras[0]
    for s, camera in enumerate(scene.cameras[1:]):
        turn = camera.K @ camera.rotation
        A[s], b[s] = turn @ one.rotation.T @ np.linalg.inv(one.K), turn @ (one.centre - camera.centre)
    for w, right, below in rng.uniform((1 / FAR, -2e-3, -2e-3), (1 / NEAR, 2e-3, 2e-3), (4, 3)):
        across, down = np.meshgrid(np.arange(W), np.arange(H))
        planes = np.stack(
            [w + right * (across - W / 2) + below * (down - H / 2), *np.full((2, H, W), [[[right]], [[below]]])]
        )
        spent = np.zeros((H, W), np.float32)
        k.search(
            k.Compared(
                *(np.ascontiguousarray(maps.reshape(5, -1), np.float32) for maps in (grey, colours, inverse)),
                *(np.ascontiguousarray(maps, np.float32) for maps in (A, b)),
            ),
            *(np.ascontiguousarray(maps, np.float32) for maps in (planes, first)),
            np.zeros((0, H, W), np.float32), np.float32(0), np.float32(9), spent,
        )  # fmt: skip
        for x, y in rng.integers((0, 0), (W, H), (40, 2)):
            plane = planes[:, y, x]
            if plane[0] <= 0:
                continue
            want = reference_cost(grey, colours, inverse, A, b, plane, x, y, first[y, x])
            assert spent[y, x] == pytest.approx(want, abs=2e-3)
