"""What planes are counted in: a profile's steps, of what Gaussians are at the start."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_gaussians

from tinysplat_runtime.codec.profiles import ADAPTIVE, find_profile
from tinysplat_runtime.gaussian.planes import PlaneClass
from tinysplat_runtime.refine.price import plane_prices
from tinysplat_runtime.render.gradient import MovableGaussians
from tinysplat_runtime.system.threads import Crew


@pytest.mark.parametrize("profile", ["balanced", "paper"])
@pytest.mark.parametrize(("size", "qp"), [(0.1, 0.0), (0.7, 6.0), (3.0, -6.0)], ids=["small", "usual", "large"])
def test_planes_are_in_steps_that_follow_the_scene(size: float, qp: float, profile: str) -> None:
    """Depth's is half of that which measuring starts from, on the mean 1/z of layer 0; scale's goes with the mean
    size of its splats in pixels, between 0.2 and 1.
    """
    scene = make_gaussians(2, 6, 8, degree=0, layers=2)
    origin = np.array([3.0, -1, 2])
    layers = []
    for layer in scene.layers:
        z = np.stack([((m - c.centre) @ c.rotation.T)[..., 2] for m, c in zip(layer.means, layer.cameras, strict=True)])
        pixel = z / np.array([c.focal for c in layer.cameras])[:, None, None]
        means = layer.means.copy()
        means[0, 0, 0] = 2 * layer.cameras[0].centre - means[0, 0, 0]  # behind its camera
        scales = size * pixel[..., None] * [0.5, 1, 1.5]
        layers.append(replace(layer, means=means - origin, scales=scales, origin=origin, extra_layers=()))
    scene = replace(layers[0], extra_layers=(layers[1],))
    prices = plane_prices(scene, MovableGaussians(scene, Crew(1).map).grids, find_profile(profile), qp, 0.25)
    assert set(prices) == {(layer, view) for layer in range(2) for view in range(2)}
    coarser, inverse, sizes = 2 ** (qp / 6), {}, {}
    for number, layer in enumerate(scene.layers):
        for view, camera in enumerate(layer.cameras):
            z = ((layer.means[view] + origin - camera.centre) @ camera.rotation.T)[..., 2]
            inverse[number, view] = np.where(z > 0, 1 / z, 0)
            sizes[number, view] = layer.scales[view].mean(axis=-1) * camera.focal * inverse[number, view]
    depth_step = 0.5 * ADAPTIVE.depth_step * np.mean([inverse[0, view] for view in range(2)]) * coarser
    usual = np.mean([sizes[0, view] for view in range(2)])
    assert {0.1: usual < 0.2, 0.7: 0.2 < usual < 1, 3.0: usual > 1}[size]
    mean_size = np.clip(usual, 0.2, 1.0)
    step = {c: ADAPTIVE.gain / np.sqrt(ADAPTIVE.sensitivity[c]) * coarser for c in PlaneClass if c}
    for key, price in prices.items():
        np.testing.assert_allclose(price.inverse_depth, inverse[key] / depth_step, rtol=1e-5)
        scale_step = step[PlaneClass.SCALE] / (mean_size / ADAPTIVE.width)
        np.testing.assert_allclose(price.size, sizes[key] / scale_step, rtol=1e-5)
        assert price.opacity == pytest.approx(step[PlaneClass.OPACITY]) and price.bit == 0.25
        assert price.color == pytest.approx(step[PlaneClass.COLOR])
        assert price.inverse_depth.dtype == price.size.dtype == np.float32
    assert prices[0, 0].inverse_depth[0, 0] == 0 == prices[0, 0].size[0, 0]
