"""What changes of Gaussians cost in a file: a smooth count of bits, on the planes that are coded, in their steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..codec.adaptive import class_step, shown_width
from ..codec.profiles import ADAPTIVE, AdaptiveSettings, Profile
from ..gaussian.gaussians import Gaussians
from ..gaussian.planes import PlaneClass
from ..render.gradient import Grid
from ..render.kernels_place import LOG_DEPTH, LOG_SIZE, LOGIT, SH_RED
from ..system import disk
from . import kernels

_DEPTH_FINER = 0.5
"""Depth's step where none is measured, as a share of the one that measuring starts from."""


@dataclass(frozen=True, eq=False)
class PlanePrice:
    """A view's planes in quantiser steps.

    Attributes:
        planes: (2, H, W) float32, at the start 1/z over depth's step, and the mean of ŝ over the scale's step.
        opacity, color: steps.
        bit, color_bit: |error| that a bit is worth, of all but colours and of these.
    """

    planes: NDArray
    opacity: float
    color: float
    bit: float
    color_bit: float

    def add_gradient(self, values: NDArray, gradient: NDArray) -> None:
        """Add the gradient of the bits' price; values and gradient are (6, H, W) float32."""
        opacity = (1 / (1 + np.exp(-values[LOGIT]))).astype(np.float32)
        inverse_depth, size = self.planes
        planes = {
            LOG_DEPTH: (inverse_depth * np.exp(-values[LOG_DEPTH]), -1.0),
            LOG_SIZE: (size * np.exp(values[LOG_SIZE]), 1.0),
            LOGIT: (opacity / np.float32(self.opacity), 1 - opacity),
        }
        slope = np.empty(values.shape[1:], np.float32)
        for kind, (plane, factor) in planes.items():
            slope[:] = 0
            kernels.add_bits(plane, self.bit, slope)
            gradient[kind] += slope * plane * factor
        for kind in range(SH_RED, len(values)):
            slope[:] = 0
            kernels.add_bits(values[kind] / np.float32(self.color), self.color_bit, slope)
            gradient[kind] += slope / np.float32(self.color)


@dataclass(frozen=True)
class Coded:
    """What Gaussians will be coded with."""

    profile: Profile
    qp: float


def plane_prices(
    gaussians: Gaussians, grids: tuple[Grid, ...], coded: Coded, bit: float, color_bit: float
) -> dict[Grid, PlanePrice]:
    """A `PlanePrice` for every grid."""
    settings = coded.profile.settings if isinstance(coded.profile.settings, AdaptiveSettings) else ADAPTIVE
    coarser, views = 2 ** (coded.qp / 6), len(gaussians.cameras)
    first = [[plane.mean() for plane in _planes(gaussians, view)] for view in range(views)]
    inverse, size = (float(np.mean(means)) for means in zip(*first, strict=True))
    depth = _DEPTH_FINER * settings.depth_step * inverse * coarser
    scale, opacity, color = (
        class_step(settings, c) * coarser for c in (PlaneClass.SCALE, PlaneClass.OPACITY, PlaneClass.COLOR)
    )
    steps = depth, scale / shown_width(size, settings)
    prices = dict[Grid, PlanePrice]()
    for layer in gaussians.layers:
        kept = disk.zeros((views, 2, *layer.opacities.shape[1:]))
        for view, planes in enumerate(kept):
            for plane, values, step in zip(planes, _planes(layer, view), steps, strict=True):
                plane[:] = values / step
            prices[grids[len(prices)]] = PlanePrice(planes, opacity, color, bit, color_bit)
    return prices


def _planes(layer: Gaussians, view: int) -> tuple[NDArray, NDArray]:
    """(H, W) float64 each: 1/z and the mean of ŝ."""
    camera = layer.cameras[view]
    z = (layer.means[view] - (camera.centre - layer.origin)) @ camera.rotation[2]
    inverse = np.divide(1.0, z, out=np.zeros_like(z), where=z > 0)  # nothing is coded of what has no depth
    size = layer.scales[view].mean(axis=-1) * camera.focal * inverse
    return inverse, size
