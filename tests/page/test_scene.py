"""What the page makes of decoded Gaussians, beside the same in numpy."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from page.scripts import close
from page.scripts import run as run_with
from scipy.spatial.transform import Rotation

START = """
import { sceneOf, viewOf } from "./scene.js";
const plain = (_, value) => (ArrayBuffer.isView(value) ? [...value] : value);
function decodedOf({ means, scales, quats, opacities, sh, ...rest }) {
  const floats = { means, scales, quats, opacities, sh };
  for (const name of Object.keys(floats)) floats[name] = Float32Array.from(floats[name], (x) => x ?? NaN);
  return { ...floats, ...rest };
}
"""
ORIGIN = np.array([100.0, -50, 20])


def run(code: str, **given: Any) -> Any:
    return json.loads(run_with(f"return JSON.stringify(await (async () => {{ {code} }})(), plain);", START, **given))


def camera(n: int) -> dict[str, Any]:
    c2w = np.eye(4)
    c2w[:3, :3] = Rotation.from_rotvec([0.1 * n, 0.3 - 0.2 * n, 0.05]).as_matrix()
    c2w[:3, 3] = np.add(ORIGIN, [0.5 * n, -0.2, 0.1 * n * n])
    return {
        "width": 64,
        "height": 48,
        "fx": 50 + n,
        "fy": 52,
        "cx": 31,
        "cy": 25,
        "skew": 0.5,
        "c2w": c2w.ravel().tolist(),
    }


def decoded(count: int, cameras: int, degree: int = 1, layers: int = 1, seed: int = 0) -> dict[str, Any]:
    rng = np.random.default_rng(seed)
    own = count // layers
    return {
        "count": count,
        "degree": degree,
        "origin": ORIGIN.tolist(),
        "cameras": [camera(n) for n in range(cameras)],
        "means": np.float32(rng.normal([0, 0, 3], 0.8, (count, 3))).ravel().tolist(),
        "scales": np.float32(rng.uniform(0.01, 0.1, 3 * count)).tolist(),
        "quats": np.float32(rng.normal(size=4 * count)).tolist(),
        "opacities": np.float32(rng.uniform(0, 1, count)).tolist(),
        "sh": np.float32(rng.normal(size=3 * (degree + 1) ** 2 * count)).tolist(),
        "layers": [{"views": cameras, "count": own, "offset": n * own} for n in range(layers)],
    }


def frame(made: dict[str, Any]) -> tuple[NDArray, float]:
    """Centre and scale: the mean camera centre, and 4 over the median depth in the first camera."""
    poses = [np.reshape(one["c2w"], (4, 4)) for one in made["cameras"]]
    some = slice(None, None, -(-made["count"] // 20000))
    ray = np.reshape(made["means"], (-1, 3))[some] + ORIGIN - poses[0][:3, 3]
    z = (ray @ poses[0][:3, 2])[np.array(made["opacities"])[some] > 0.1]
    z = np.sort(z[z > 0])
    return np.mean([pose[:3, 3] for pose in poses], axis=0), 4 / z[len(z) // 2]


def test_cameras_become_views_with_rows_of_unit_length() -> None:
    one = camera(2)
    c2w = np.reshape(one["c2w"], (4, 4))
    c2w[:3, :3] = c2w[:3, :3].round(2)
    view = run("return viewOf(one)", one=dict(one, c2w=c2w.ravel().tolist()))
    assert (view["width"], view["height"], view["K"]) == (64, 48, [52, 0.5, 52, 31, 25])
    close(view["position"], c2w[:3, 3])
    forward = c2w[:3, 2] / np.linalg.norm(c2w[:3, 2])
    right = c2w[:3, 0] - (c2w[:3, 0] @ forward) * forward
    right /= np.linalg.norm(right)
    close(view["rotation"], [right, np.cross(forward, right), forward])


@pytest.mark.parametrize(("count", "layers"), [(24, 1), (48, 2)])
def test_scenes_are_centred_and_as_deep_as_the_page_is_made_for(count: int, layers: int) -> None:
    made = decoded(count, 2, degree=0 if count > 100 else 1, layers=layers)
    scene = run(
        "const { means, opacities, ...rest } = sceneOf(decodedOf(made)); return { ...rest, means, opacities };",
        made=made,
    )
    centre, scale = frame(made)
    close(scene["frame"]["centre"], centre)
    assert scene["frame"]["scale"] == pytest.approx(scale, rel=1e-6) and scene["nearPlane"] == pytest.approx(
        0.01 * scale, rel=1e-6
    )
    assert (scene["reach"], scene["hasCameras"]) == (4, True)
    for n, view in enumerate(scene["views"]):
        close(view["position"], scale * (np.reshape(camera(n)["c2w"], (4, 4))[:3, 3] - centre), 1e-5)
    down = sum(np.array(view["rotation"][1]) for view in scene["views"])
    close(scene["up"], -down / np.linalg.norm(down))
    kept = np.array(made["opacities"]) >= 1 / 255
    assert 0 < kept.sum() < count or count < 100
    for name, width, times, offset in (
        ("means", 3, scale, ORIGIN - centre),
        ("scales", 3, scale, 0),
        ("quats", 4, 1, 0),
        ("opacities", 1, 1, 0),
        ("sh", 3 * (made["degree"] + 1) ** 2, 1, 0),
    ):
        wanted = times * (np.reshape(made[name], (count, width)) + offset)
        np.testing.assert_allclose(np.reshape(scene[name], (-1, width)), wanted[kept], rtol=1e-5, atol=1e-5)
    own, sizes = count // layers // 2, []
    for layer in range(layers):
        for view in range(2):
            at = layer * 2 * own + view * own
            sizes.append((view, layer == 0, int(kept[:at].sum()), int(kept[: at + own].sum())))
    assert [(part["view"], part["isFront"], part["from"], part["to"]) for part in scene["parts"]] == sizes
    assert (scene["count"], scene["functions"]) == (kept.sum(), (made["degree"] + 1) ** 2)


def test_what_cannot_show_is_left_out_and_whole_parts_with_it() -> None:
    made = decoded(12, 2)
    made["opacities"] = [0.5, 1 / 255, 0.0039, 0.5, 0.5, 0.5] + [0.001] * 6
    made["means"][3 * 3], made["means"][3 * 4 + 1], made["means"][3 * 5 + 2] = None, None, None  # not a number
    scene = run("return sceneOf(decodedOf(made))", made=made)
    assert scene["count"] == 2 and scene["parts"] == [{"view": 0, "isFront": True, "from": 0, "to": 2, "coarse": []}]
    np.testing.assert_allclose(scene["quats"], made["quats"][:8], rtol=1e-6)


def test_a_coarse_surface_is_one_pixel_of_sixteen_that_can_show() -> None:
    pixels = np.arange(48 * 64).reshape(48, 64)
    made = decoded(4 * pixels.size, 2, degree=0, layers=2)
    surface, further = run("return sceneOf(decodedOf(made)).parts", made=made)[::2]
    kept = np.flatnonzero(np.array(made["opacities"][: pixels.size]) >= 1 / 255)
    np.testing.assert_array_equal(kept[surface["coarse"]], np.intersect1d(pixels[2::4, 2::4], kept))
    assert further["coarse"] == []


@pytest.mark.parametrize("count", [1, 101])
def test_files_without_cameras_are_seen_from_in_front_of_their_bulk(count: int) -> None:
    made = decoded(count, 0, degree=0)
    made["layers"][0]["views"] = 0
    made["opacities"] = [1.0] * count
    scene = run(
        "const { views, frame, hasCameras, up } = sceneOf(decodedOf(made)); return { views, frame, hasCameras, up };",
        made=made,
    )
    some = np.sort(np.reshape(made["means"], (-1, 3))[:: -(-count // 20000)], axis=0) + ORIGIN
    low, high = (some[int(np.floor(share * (len(some) - 1)))] for share in (0.05, 0.95))
    far = 1.5 * np.linalg.norm(high - low) or 1
    place = (low + high) / 2 - [0, 0, far]
    close(scene["frame"]["centre"], place, 1e-6)
    z = np.sort((np.reshape(made["means"], (-1, 3))[:: -(-count // 20000)] + ORIGIN - place)[:, 2])
    z = z[z > 0]
    assert scene["frame"]["scale"] == pytest.approx(4 / z[len(z) // 2], rel=1e-6)
    (view,) = scene["views"]
    close(view.pop("position"), [0, 0, 0])
    assert view == {"width": 800, "height": 600, "K": [600, 0, 600, 400, 300], "rotation": np.eye(3).tolist()}
    assert (scene["hasCameras"], scene["up"]) == (False, [0, -1, 0])
