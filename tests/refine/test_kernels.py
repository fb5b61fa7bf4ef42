"""Slopes of what refinement adds to a photo's error, against finite differences and torch's Adam; its order of work."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from scenes import make_smooth_gaussians

from tinysplat_runtime.codec.adaptive import known_steps
from tinysplat_runtime.codec.profiles import ADAPTIVE, find_profile
from tinysplat_runtime.gaussian.planes import PlaneClass
from tinysplat_runtime.refine import kernels
from tinysplat_runtime.refine.price import Coded, plane_prices
from tinysplat_runtime.render.gradient import MovableGaussians
from tinysplat_runtime.render.kernels_place import LOG_DEPTH, LOG_SIZE, LOGIT, SH_RED
from tinysplat_runtime.system.threads import Crew


def test_steps_are_those_of_torchs_adam_and_end_at_the_limits() -> None:
    rng = np.random.default_rng(3)
    values, first, second = rng.normal(size=40).astype(np.float32), *np.zeros((2, 40), np.float32)
    leaf = torch.tensor(values, requires_grad=True)
    optimiser = torch.optim.Adam([leaf], lr=0.05, betas=(0.9, 0.99), eps=2e-3)
    for count in range(1, 6):
        gradient = rng.normal(size=40).astype(np.float32)
        kernels.adam(values, gradient, first, second, (0.05, 0.9, 0.99, 2e-3, float(count), -9.0, 9.0))
        leaf.grad = torch.tensor(gradient)
        optimiser.step()
    np.testing.assert_allclose(values, leaf.detach().numpy(), atol=1e-6)
    outside = np.array([-3.0, 0.0, 3.0], np.float32)
    for slope, wanted in ((1, [-3.0, -0.5, 2.5]), (-1, [-2.5, 0.5, 3.0])):
        state = outside.copy()
        kernels.adam(
            state, np.full(3, slope, np.float32), *np.zeros((2, 3), np.float32), (0.5, 0.9, 0.99, 0.0, 1.0, -1.0, 1.0)
        )
        np.testing.assert_allclose(state, wanted, atol=1e-6)


def assert_is_slope(found: np.ndarray, cost: Callable[[np.ndarray], float], values: np.ndarray) -> None:
    """`found` is the gradient of a cost at values, of the same shape."""
    wanted = np.zeros(values.shape)
    for place in np.ndindex(values.shape):
        shift = np.zeros(values.shape)
        shift[place] = 1e-5
        wanted[place] = (cost(values + shift) - cost(values - shift)) / 2e-5
    np.testing.assert_allclose(found, wanted, rtol=1e-3, atol=1e-4 * np.abs(wanted).max())


def bits(plane: np.ndarray) -> float:
    """What a plane takes in a file, about."""
    return float(sum(0.5 * np.log2(1 + np.diff(plane, axis=axis) ** 2).sum() for axis in (0, 1)))


def test_changes_of_depth_cost_their_variation_by_the_weight_of_every_edge() -> None:
    """Of changes so far apart that the softness about none of them plays no part."""
    rng = np.random.default_rng(0)
    across, down, before = rng.uniform(0, 1, (3, 4, 5)).astype(np.float32)
    change = rng.permutation(20).reshape(4, 5).astype(np.float32)

    def cost(change: np.ndarray) -> float:
        return float(
            (np.abs(np.diff(change)) * across[:, :-1]).sum() + (np.abs(np.diff(change, axis=0)) * down[:-1]).sum()
        )

    found = before.copy()
    kernels.add_variation(change, across, down, 3.0, found)
    assert_is_slope((found - before) / 3, cost, change.astype(np.float64))


def test_changes_cost_bits_of_the_planes_that_are_coded() -> None:
    gaussians, rng = make_smooth_gaussians(2, 5, 6, degree=0), np.random.default_rng(1)
    grids = MovableGaussians(gaussians, Crew(1).map).grids
    coded = [Coded(find_profile("balanced"), qp) for qp in (0, 6)]
    price, coarse = (plane_prices(gaussians, grids, one, 0.3, 0.1)[grids[1]] for one in coded)
    camera = gaussians.cameras[1]
    z = (gaussians.means[1] - camera.centre) @ camera.rotation[2]
    sizes = gaussians.scales[1].mean(axis=-1) * camera.focal / z
    for plane, half, values in zip(price.planes, coarse.planes, (1 / z, sizes), strict=True):
        np.testing.assert_allclose(plane / plane[0, 0], values / values[0, 0], rtol=1e-4)  # in steps of any length
        np.testing.assert_allclose(half, plane / 2, rtol=1e-5)  # which double over six of Q
    assert (coarse.opacity, coarse.color) == pytest.approx((2 * price.opacity, 2 * price.color))
    coded = known_steps((np.zeros((3, 3)), np.full(3, sizes.mean())), 0, ADAPTIVE)  # the coder's own
    np.testing.assert_allclose(price.planes[1], sizes / coded[PlaneClass.SCALE], rtol=0.01)
    assert price.color == pytest.approx(coded[PlaneClass.COLOR])

    def cost(values: np.ndarray) -> float:
        opacities = 1 / (1 + np.exp(-values[LOGIT]))
        planes = [price.planes[0] * np.exp(-values[LOG_DEPTH]), price.planes[1] * np.exp(values[LOG_SIZE])]
        planes.append(opacities / price.opacity)
        return 0.3 * sum(map(bits, planes)) + 0.1 * sum(map(bits, values[SH_RED:] / price.color))

    values, before = rng.normal(0, 0.3, (2, 6, 5, 6)).astype(np.float32)
    gradient = before.copy()
    price.add_gradient(values, gradient)
    assert_is_slope(gradient - before, cost, values.astype(np.float64))
