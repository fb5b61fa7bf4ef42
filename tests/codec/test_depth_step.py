"""Steps of depth and opacity: the stand-in for the video codec, what errors do to pictures, and what follows."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import make_smooth_gaussians

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.depth_step.contrast import contrast
from tinysplat_runtime.codec.depth_step.probe import Probe
from tinysplat_runtime.container.inspection import inspect_bytes
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import DEFINITION, Renderer, between


def _inverse(layer: Gaussians) -> NDArray:
    """−1/z of a layer's Gaussians in their own cameras, in float64."""
    pairs = zip(layer.means.astype(np.float64) + layer.origin, layer.cameras, strict=True)
    return np.stack([-1 / ((means - camera.centre) @ camera.rotation[2]) for means, camera in pairs])


def _probe(scene: Gaussians, stripes: int) -> Probe:
    inverse = [_inverse(layer).astype(np.float32) for layer in scene.layers]
    return Probe(scene.layers, inverse, [contrast(layer) for layer in scene.layers], stripes, 1)


def _changed(layer: Gaussians, errors: NDArray, kind: str) -> Gaussians:
    """What a decoder makes of errors in −1/z or in opacity."""
    if kind == "opacity":
        return replace(layer, opacities=np.clip(layer.opacities + errors, 0, 1), extra_layers=())
    inverse = _inverse(layer)
    ratio = (inverse / np.clip(inverse + errors, inverse.min(), inverse.max()))[..., None]
    centres = np.stack([camera.centre - layer.origin for camera in layer.cameras])[:, None, None]
    return replace(layer, means=centres + (layer.means - centres) * ratio, scales=layer.scales * ratio, extra_layers=())


def _difference(scene: Gaussians, errors: list[NDArray], kind: str) -> float:
    """Mean squared difference of a picture from midway between the first two cameras."""
    layers = [_changed(layer, error, kind) for layer, error in zip(scene.layers, errors, strict=True)]
    pictures = [
        Renderer(g, 1, compiled=False, **DEFINITION).render(between(scene.cameras[:2], 3)[1]).clip(0, 1)
        for g in (scene, Gaussians.stacked(layers))
    ]
    return float(np.square(pictures[0] - pictures[1]).mean(dtype=np.float64))


@pytest.mark.parametrize("kind", ["depth", "opacity"])
@pytest.mark.parametrize(("height", "layers", "slack"), [(24, 2, 0.03), (24, 1, 0.03), (96, 1, 0.5)])
def test_damage_is_what_errors_do_to_the_picture_between_the_cameras(height, layers, slack, kind):
    scene = make_smooth_gaussians(2, height, 40, degree=2, layers=layers, origin=np.array([30.0, -5, 100]))
    if height > 32 and kind == "depth":  # what the stripe shows is more than there is elsewhere
        scene.sh[:, : height // 3] = scene.sh[:, 2 * height // 3 :] = scene.sh.mean(axis=(0, 1, 2))
    rng = np.random.default_rng(0)
    errors = [rng.normal(0, 0.02, layer.opacities.shape).astype(np.float32) for layer in scene.layers]
    probe = _probe(scene, 1)  # a stripe is the whole picture, where that is low
    found = (probe.damage if kind == "depth" else probe.opacity_damage)(errors)
    assert found == pytest.approx(_difference(scene, errors, kind), rel=slack)
    assert (probe.damage if kind == "depth" else probe.opacity_damage)([0 * error for error in errors]) < 1e-12


def test_depth_is_coded_more_finely_where_gaussians_are_opaque():
    scene, runtime = make_smooth_gaussians(2, 40, 48, degree=0), Runtime(threads=1)
    files = [runtime.compress(replace(scene, opacities=np.full_like(scene.opacities, o))) for o in (0.9, 0.05)]
    solid, faint = (inspect_bytes(data)["bytes_by_class"]["depth"] for data in files)
    assert solid > faint > 0


def test_sh_bands_that_nobody_sees_are_left_out_and_listed():
    scene = make_smooth_gaussians(2, 24, 32, degree=2)
    weights = np.repeat([1, 8, 1e-5], [1, 3, 5]).astype(np.float32)  # the views disagree about band 1
    runtime = Runtime(threads=1)
    data = runtime.compress(replace(scene, sh=scene.sh * weights[:, None]))
    assert runtime.decompress(data).degree == 1
    (entry,) = (one for one in inspect_bytes(data)["left_out"] if one["what"] == "sh degree")
    assert (entry["kept"], entry["of"]) == (1, 2)
    assert runtime.decompress(runtime.compress(scene, qp=-6)).degree == 2
