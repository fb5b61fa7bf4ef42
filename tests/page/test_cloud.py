"""What the page keeps of Gaussians, in node, beside the same in numpy: depths, halves of floats, codes of lengths."""

from __future__ import annotations

from typing import Any

import numpy as np
from page.scripts import run
from page.test_arithmetic import as_view
from scenes import make_gaussians, make_smooth_gaussians

from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.render.near import NearViews

START = 'import { half, lengthCode, makeCloud } from "./cloud.js";'

MADE = """
for (const name of ["means", "quats", "scales", "opacities", "sh"]) scene[name] = Float32Array.from(scene[name]);
const { depth, spread, nearest, farthest } = makeCloud(scene);
return [depth, spread, nearest, farthest];
"""


def depths_of(gaussians: Gaussians) -> list[float]:
    """The depth, its spread and its range, as the page finds them."""
    flat, parts, at = gaussians.flat(), [], 0
    for n, layer in enumerate(gaussians.layers):
        for view in range(len(gaussians.cameras)):
            parts.append({"view": view, "isFront": n == 0, "from": at, "to": at + layer.opacities[view].size})
            at = parts[-1]["to"]
    scene: dict[str, Any] = {name: getattr(flat, name).ravel().tolist() for name in FIELDS}
    scene |= {"count": flat.count, "functions": (flat.degree + 1) ** 2}
    scene["parts"] = parts or [{"view": -1, "isFront": False, "from": 0, "to": flat.count}]
    own = {"K": [1, 0, 1, 0, 0], "width": 1, "height": 1, "rotation": np.eye(3).tolist(), "position": [0, 0, 0]}
    scene["views"] = [as_view(camera, flat.origin) for camera in gaussians.cameras] or [own]
    return run(MADE, START, scene=scene)


def test_depths_are_of_surfaces_in_their_own_views_and_those_of_deep_scenes_spread() -> None:
    gaussians = make_gaussians(2, 24, 40, degree=1, layers=2)
    depth, spread, nearest, farthest = depths_of(gaussians)
    near = NearViews.of(gaussians)
    assert near is not None
    np.testing.assert_allclose(depth, near.depth, rtol=1e-5)
    z = np.concatenate(
        [
            ((means - camera.centre) @ camera.rotation[2]).ravel()
            for means, camera in zip(gaussians.means, gaussians.cameras, strict=True)
        ]
    )
    assert spread > depths_of(make_smooth_gaussians(2, 24, 40))[1] > 0
    assert z.min() <= nearest < np.median(z) < farthest <= z.max()


def test_half_floats_are_the_nearest_within_what_they_hold() -> None:
    values = [0.0, 1.0, -2.5, 65504.0, 1e9, -1e9, 6.1e-5, 3e-6, -3e-6, 6e-8, 1e-9, 0.1, 1 / 3]
    found = run("return values.map(half)", START, values=values)
    wanted = np.clip(np.float32(values), -65504, 65504).astype(np.float16).view(np.uint16)
    np.testing.assert_array_equal(found, wanted)


def test_codes_of_lengths_are_16_bits_that_keep_their_order_and_ratios() -> None:
    lengths = np.geomspace(1e-6, 1e6, 50)
    *codes, zero, least, most = run("return values.map(lengthCode)", START, values=[*lengths, 0, 1e-30, 1e30])
    assert zero == 0 < least <= min(codes) and max(codes) <= most < 1 << 16
    steps = np.diff(codes)
    assert (steps > 0).all() and np.ptp(steps) <= 1  # even in the logarithm, up to rounding
