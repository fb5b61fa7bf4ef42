"""What the page keeps of Gaussians, in node, beside the same in numpy: the words of its textures, depths, colours."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import make_gaussians
from web.node import node

import tinysplat_runtime as ts
from tinysplat_runtime.gaussian.gaussians import Gaussians

PAGE = Path(ts.__file__).parent / "page"

CODE = """
import { half, lengthCode, makeCloud, pixelIn } from "./cloud.js";
import { readFileSync } from "node:fs";
const scene = JSON.parse(readFileSync(0, "utf8"));
for (const name of ["means", "quats", "scales", "opacities", "sh"]) scene[name] = Float32Array.from(scene[name]);
const cloud = makeCloud(scene), floats = new Float32Array(cloud.geometry.buffer);
console.log(JSON.stringify({
  words: [...cloud.geometry], places: [...floats].filter((_, i) => i % 8 < 3), colours: [...cloud.colours],
  depth: cloud.depth, spread: cloud.spread, nearest: cloud.nearest,
  farthest: cloud.farthest, viewCount: cloud.viewCount, logSteps: cloud.logSteps,
  halves: (scene.halves ?? []).map(half), lengths: (scene.lengths ?? []).map(lengthCode),
}));
"""


def cloud_of(gaussians: Gaussians, **more: Any) -> dict[str, Any]:
    flat, parts, at = gaussians.flat(), [], 0
    for n, layer in enumerate(gaussians.layers):
        for view in range(len(gaussians.cameras)):
            parts.append({"view": view, "isFront": n == 0, "from": at, "to": at + layer.opacities[view].size})
            at = parts[-1]["to"]
    views = [
        {
            "width": c.width,
            "height": c.height,
            "K": [c.K[0, 0], c.K[0, 1], c.K[1, 1], c.K[0, 2], c.K[1, 2]],
            "rotation": c.rotation.tolist(),
            "position": c.centre.tolist(),
        }
        for c in gaussians.cameras
    ]
    parts = parts or [{"view": -1, "isFront": False, "from": 0, "to": flat.count}]
    arrays = {name: getattr(flat, name).ravel().tolist() for name in ("means", "quats", "scales", "opacities", "sh")}
    own = {"K": [1, 0, 1, 0, 0], "width": 1, "height": 1, "rotation": np.eye(3).tolist(), "position": [0, 0, 0]}
    scene = {"count": flat.count, "functions": (flat.degree + 1) ** 2, "parts": parts, "views": views, **arrays, **more}
    if not views:  # the page's own camera stands where there is none
        scene["views"] = [own]
    done = subprocess.run(
        [node(), "--input-type=module", "-e", CODE],
        cwd=PAGE,
        input=json.dumps(scene),
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def gaussians() -> Gaussians:
    return make_gaussians(2, 24, 40, degree=1, layers=2)


@pytest.fixture(scope="module")
def cloud(gaussians: Gaussians) -> dict[str, Any]:
    return cloud_of(gaussians)


def words_of(cloud: dict[str, Any]) -> NDArray:
    return np.array(cloud["words"], np.uint32).reshape(-1, 8)


def pixels(gaussians: Gaussians) -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """x, y in their own views, depth there and which view, of all Gaussians in their order."""
    found = []
    for layer in gaussians.layers:
        for view, camera in enumerate(gaussians.cameras):
            ray = (layer.means[view].reshape(-1, 3) - camera.centre) @ camera.rotation.T
            at = ray @ camera.K.T
            found.append((at[:, 0] / at[:, 2], at[:, 1] / at[:, 2], ray[:, 2], np.full(len(ray), view)))
    return tuple(map(np.concatenate, zip(*found, strict=True)))  # type: ignore[return-value]


def test_places_and_shapes_are_those_of_the_gaussians(gaussians: Gaussians, cloud: dict[str, Any]) -> None:
    flat, words = gaussians.flat(), words_of(cloud)
    np.testing.assert_array_equal(np.float32(cloud["places"]).reshape(-1, 3), flat.means)
    codes = np.stack([words[:, 4], words[:, 4] >> 16, words[:, 5], words[:, 5] >> 16], axis=1).astype(np.uint16)
    quats = flat.quats / np.linalg.norm(flat.quats, axis=1, keepdims=True)
    assert np.abs(codes.view(np.int16) / 32767 - quats).max() < 0.51 / 32767
    _, _, z, _ = pixels(gaussians)
    lengths = np.column_stack([flat.scales, z / gaussians.cameras[0].focal])
    codes = np.stack([words[:, 6], words[:, 6] >> 16, words[:, 7], words[:, 7] >> 16], axis=1).astype(np.uint16)
    steps, lowest = cloud["logSteps"]
    assert np.abs(codes / steps - lowest - np.log2(lengths)).max() < 0.51 / steps


def test_colours_are_half_floats_of_the_coefficients(gaussians: Gaussians, cloud: dict[str, Any]) -> None:
    words = np.array(cloud["colours"], np.uint32).reshape(-1, 2)
    codes = np.stack([words[:, 0], words[:, 0] >> 16, words[:, 1]], axis=1).astype(np.uint16)
    apart = codes.astype(int) - gaussians.flat().sh.reshape(-1, 3).astype(np.float16).view(np.uint16)
    assert np.abs(apart).max() <= 1 and (apart != 0).mean() < 1e-3  # halves of the last bit go up


def test_half_floats_and_lengths_at_their_ends(gaussians: Gaussians) -> None:
    values = [0.0, 1.0, -2.5, 65504.0, 1e9, -1e9, 6.1e-5, 3e-6, -3e-6, 6e-8, 1e-9, 0.1, 1 / 3]
    found = cloud_of(make_gaussians(1, 2, 2), halves=values, lengths=[0, 1e-30, 1e30, 1, 2, 0.5])
    wanted = np.clip(np.float32(values), -65504, 65504).astype(np.float16).view(np.uint16)
    np.testing.assert_array_equal(found["halves"], wanted)
    assert found["lengths"] == [0, 1, 65535, 32 * 1024, 33 * 1024, 31 * 1024]


def test_depths_are_of_surfaces_in_their_own_views(gaussians: Gaussians, cloud: dict[str, Any]) -> None:
    z = pixels(gaussians)[2][: gaussians.opacities.size]
    assert cloud["depth"] == pytest.approx(1 / np.mean(1 / z), rel=1e-5)
    assert cloud["spread"] == pytest.approx(np.std(1 / z) / np.mean(1 / z), rel=1e-4)
    some = np.sort(z[::16][gaussians.opacities.ravel()[::16] > 0.1])
    assert cloud["nearest"] == pytest.approx(some[int(0.02 * (len(some) - 1))], rel=1e-5)
    assert cloud["farthest"] == pytest.approx(some[int(0.98 * (len(some) - 1))], rel=1e-5)


def test_without_surfaces_depths_are_of_all_before_the_page_s_camera() -> None:
    flat = make_gaussians(1, 6, 8).flat()
    points = Gaussians(
        means=flat.means * np.float32(0.3), quats=flat.quats, scales=flat.scales, opacities=flat.opacities, sh=flat.sh
    )
    found, z = cloud_of(points), points.means[:, 2].astype(np.float64)
    assert found["depth"] == pytest.approx(1 / np.mean(1 / z[z > 0]), rel=1e-5)
    word = words_of(found)[:, 3]
    assert (word >> 24 == 255).all() and ((word >> 8) & 0xFFFF == 0).all() and (words_of(found)[:, 7] >> 16 == 0).all()
