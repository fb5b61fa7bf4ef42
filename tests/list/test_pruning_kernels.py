"""What one removal changes, and what colours lack, against pictures drawn without and with them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_list

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.sh import C0
from tinysplat_runtime.render import DEFINITION, Renderer
from tinysplat_runtime.render.paths import ring
from tinysplat_runtime.system.threads import Crew

pytest.importorskip("numba")

from tinysplat_runtime.list.pruning import kernels
from tinysplat_runtime.list.pruning.pictures import Pictures


@pytest.fixture(scope="module")
def cloud() -> Gaussians:
    return make_list(400, 1, np.random.default_rng(5))


def drawn(gaussians: Gaussians, camera) -> np.ndarray:
    """(H, W, 4) float64 by the numpy rasteriser: colours unclipped above, and opacity as `kernels` weighs it."""
    image = Renderer(gaussians, threads=1, compiled=False, **DEFINITION).render(camera, outputs=("rgb", "alpha"))
    return np.concatenate([image["rgb"], kernels.OPACITY_COLOUR * image["alpha"][..., None]], -1).astype(np.float64)


def test_a_removal_costs_what_pictures_without_it_show(cloud):
    dim = replace(cloud, sh=0.3 * cloud.sh)  # below white, where the renderer would cut
    camera = ring(dim, 2)[1].resized(96, 140)
    sums, whole = next(Pictures([camera], Crew(2).map).measure(dim, [0])), drawn(dim, camera)
    costliest = np.argsort(-sums[:, kernels.COST])[[0, 5, 40, 120]]
    for row in costliest:
        without = drawn(dim.taken(np.delete(np.arange(400), row)), camera)
        assert sums[row, kernels.COST] == pytest.approx(np.square(without - whole).sum(), rel=2e-3)


def test_a_lack_of_colour_is_the_gradient_of_the_error(cloud):
    """Σ w·(wanted − C) is half of what the error falls by with a Gaussian's colour."""
    dim, step = replace(cloud, sh=0.3 * cloud.sh), 2e-2
    camera = ring(dim, 1)[0].resized(80, 80)
    pictures = Pictures([camera], Crew(1).map)
    pictures.keep(dim.taken(np.arange(300)))
    sums = next(pictures.measure(dim, [0])).astype(np.float64)
    for channel in range(3):
        row = int(np.argmax(np.abs(sums[:, kernels.LACK + channel])))
        errors = []
        for sign in (-1, 1):
            sh = dim.sh.copy()
            sh[row, 0, channel] += sign * step / C0
            errors.append(next(pictures.errors(replace(dim, sh=sh))))
        assert sums[row, kernels.LACK + channel] == pytest.approx(-(errors[1] - errors[0]) / (4 * step), rel=2e-3)
    opacity = drawn(dim, camera)[..., 3] / kernels.OPACITY_COLOUR
    assert sums[:, kernels.BOUND].sum() == pytest.approx(np.square(opacity).sum(), rel=1e-4)
