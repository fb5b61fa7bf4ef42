"""What the page makes of decoded Gaussians, beside the same in numpy."""

import json
from typing import Any

import numpy as np
import pytest
from page.scripts import close
from page.scripts import run as run_with
from scipy.spatial.transform import Rotation

START = """
import { makeCloud } from "./cloud.js";
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
    lens = {"fx": 50 + n, "fy": 52, "cx": 31, "cy": 25, "skew": 0.5}
    return {"width": 64, "height": 48, **lens, "c2w": c2w.ravel().tolist()}


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


@pytest.mark.parametrize("layers", [1, 2])
def test_scenes_keep_their_shape_near_the_page_s_origin(layers: int) -> None:
    """Moved and scaled as a whole: Gaussians, cameras and the near plane alike."""
    made = decoded(24 * layers, 2, layers=layers)
    scene = run("return sceneOf(decodedOf(made))", made=made)
    centre, scale = np.array(scene["frame"]["centre"]), scene["frame"]["scale"]
    places = np.array([np.reshape(one["c2w"], (4, 4))[:3, 3] for one in made["cameras"]])
    assert places.min() - 1 < centre.min() and centre.max() < places.max() + 1  # not at the world's, which may be far
    close([view["position"] for view in scene["views"]], scale * (places - centre), 1e-5)
    down = sum(np.array(view["rotation"][1]) for view in scene["views"])
    is_level = max(abs(view["rotation"][0][1]) for view in scene["views"]) < 0.1
    close(scene["up"], (0, -1, 0) if is_level else -down / np.linalg.norm(down))
    kept = np.array(made["opacities"]) >= 1 / 255
    for name, width, times, offset in (
        ("means", 3, scale, ORIGIN - centre),
        ("scales", 3, scale, 0),
        ("quats", 4, 1, 0),
        ("opacities", 1, 1, 0),
        ("sh", 12, 1, 0),
    ):
        wanted = times * (np.reshape(made[name], (-1, width)) + offset)
        np.testing.assert_allclose(np.reshape(scene[name], (-1, width)), wanted[kept], rtol=1e-5, atol=1e-5)
    ends = np.cumsum([kept[at : at + 12].sum() for at in range(0, len(kept), 12)])
    assert [part["to"] for part in scene["parts"]] == ends.tolist()
    assert [part["from"] for part in scene["parts"]] == [0, *ends[:-1]]
    assert [(part["view"], part["isFront"]) for part in scene["parts"]] == [
        (0, True),
        (1, True),
        (0, False),
        (1, False),
    ][: 2 * layers]
    twice = {**made, "means": [2 * x for x in made["means"]]}
    assert run("return sceneOf(decodedOf(made)).frame.scale", made=twice) < scale  # what is deeper is made smaller


def test_a_list_made_from_photos_has_their_places() -> None:
    made, views = decoded(90, 9, degree=0), decoded(9, 9, degree=0)["cameras"]
    made["layers"][0]["views"], made["cameras"], made["viewpoints"] = 0, [], views
    made["opacities"] = [1.0] * 90
    made["means"] = [float(x) for x in np.random.default_rng(0).uniform([-1, -1, 3], [1, 1, 5], (90, 3)).ravel()]
    found = run(
        "const { views, hasCameras } = sceneOf(decodedOf(made)), cloud = makeCloud(sceneOf(decodedOf(made)));"
        "return { views, hasCameras, viewCount: cloud.viewCount };",
        made=made,
    )
    assert len(found["views"]) == 9 and found["hasCameras"] and found["viewCount"] == 0


@pytest.mark.parametrize("count", [1, 101])
def test_files_without_cameras_are_seen_from_in_front_of_their_bulk(count: int) -> None:
    made = decoded(count, 0, degree=0)
    made["layers"][0]["views"] = 0
    made["opacities"] = [1.0] * count
    scene = run(
        "const { views, frame, hasCameras, up } = sceneOf(decodedOf(made)); return { views, frame, hasCameras, up };",
        made=made,
    )
    (view,) = scene["views"]
    means = np.reshape(made["means"], (-1, 3)) + ORIGIN
    place = np.array(view["position"]) / scene["frame"]["scale"] + scene["frame"]["centre"]
    x, y, z = (np.median(means, axis=0) - place) @ np.transpose(view["rotation"])
    fx, _, fy, cx, cy = view["K"]
    assert z > 0 and 0 < fx * x / z + cx < view["width"] and 0 < fy * y / z + cy < view["height"]
    assert not scene["hasCameras"] and scene["up"] == [0, -1, 0]
