"""Gaussians that are made, as many as are asked for: clouds for the rasteriser, and statues for lists.

All is made in float64 and rounded at the end: sines and exponentials differ in their last bits with a processor's
vector instructions, which the float32 that comes out does not show.
"""

import math

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.scene.cameras import Camera


def cloud(count: int) -> Gaussians:
    """Points of a room and beyond it, as many deep however many there are; a third of them lies beside `cloud_camera`'s
    picture. SH of degree 0, as the networks here have it."""
    rng = np.random.default_rng(0)
    z = rng.uniform(2, 12, count).astype(np.float32)
    means = np.stack([*(rng.uniform(-1.3, 1.3, (2, count)).astype(np.float32) * z), z], axis=-1)
    size = 0.016 * np.sqrt(1e6 / count) * np.exp(0.6 * np.float64(rng.standard_normal((count, 3), np.float32)))
    opacities = 1 / (1 + np.exp(-1 - 2 * np.float64(rng.standard_normal(count, np.float32))))
    quats, sh = rng.standard_normal((count, 4), np.float32), rng.standard_normal((count, 1, 3), np.float32)
    return Gaussians.unchecked(
        means=means, quats=quats, scales=size.astype(np.float32), opacities=opacities.astype(np.float32), sh=sh
    )


def cloud_camera(height: int, width: int) -> Camera:
    """At the origin of a `cloud`, a right angle wide."""
    K = np.array([[width / 2, 0, width / 2], [0, width / 2, height / 2], [0, 0, 1]])
    return Camera(K, np.eye(4), width, height)


STATUE = 25_000
"""Gaussians of a made statue."""


def statues(count: int) -> Gaussians:
    """Copies of a statue beside one another in a square, so many Gaussians of SH degree 3: an object seen from outside,
    larger the more there are.
    """
    copies = -(-count // STATUE)
    side = math.ceil(math.sqrt(copies))
    one = _statue()
    arrays = {name: np.tile(values, (copies, *[1] * (values.ndim - 1)))[:count] for name, values in one.items()}
    number = np.repeat(np.arange(copies), STATUE)[:count]
    arrays["means"] += np.float32(2.5) * np.stack([number % side, 0 * number, number // side], axis=-1)
    return Gaussians.unchecked(**arrays)


def _statue() -> dict[str, NDArray]:
    """A ball with bumps, of discs of one size that lie along it."""
    rng, n = np.random.default_rng(0), np.arange(STATUE)
    height, turn = 1 - (2 * n + 1) / STATUE, n * math.pi * (3 - math.sqrt(5))
    flat = np.sqrt(1 - height * height)
    towards = np.stack([flat * np.cos(turn), height, flat * np.sin(turn)], axis=-1)
    bumps = np.sin(5 * towards[:, 0]) * np.sin(7 * towards[:, 1]) + np.sin(9 * towards[:, 2] + 3 * towards[:, 0])
    stripes = np.sin(towards @ (20 * rng.standard_normal((3, 3))))
    size = math.sqrt(4 * math.pi / STATUE) * np.exp(0.3 * rng.standard_normal((STATUE, 3)))
    sh = 0.04 * rng.standard_normal((STATUE, 16, 3))
    sh[:, 0] = 0.8 * stripes + 0.3 * bumps[:, None]
    arrays = {
        "means": (1 + 0.1 * bumps[:, None]) * towards,
        "quats": np.concatenate([1 + towards[:, 2:], np.cross([0, 0, 1], towards)], axis=1),  # turns z outwards
        "scales": 0.8 * size * [1, 1, 0.15],
        "opacities": 1 / (1 + np.exp(-2 - 2 * rng.standard_normal(STATUE))),
        "sh": sh,
    }
    return {name: values.astype(np.float32) for name, values in arrays.items()}
