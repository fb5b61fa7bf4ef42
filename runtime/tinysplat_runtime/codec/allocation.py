"""Quantiser steps of equal slope: where the next bit buys the same improvement of the picture in every plane class.

For each class of each layer there is a guess at its bits (`blocks`) and a measured price of its errors (`probe`), both
as functions of the step. The steps minimise bits + damage / exchange, and the exchange rate is the one at which the
damage adds up to what is wanted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .blocks import BlockSpectrum
from .planes import PlaneClass
from .probe import PlaneSet, Probe

DAMAGE_EXPONENT = 1.65
"""Growth of a class's squared picture error with its step: below 2, as coarse steps leave smooth planes alone."""

DEPTH_EXPONENT = 1.0
"""The same for depth, whose errors show as neighbours that change places."""

_SHAPE = (PlaneClass.SCALE, PlaneClass.ROTATION, PlaneClass.OFFSET)
"""Classes measured together, as they matter little and by the same things: the size and opacity of Gaussians."""

_OCTAVES = np.arange(-16, 9) / 4  # steps tried, relative to the default
_LEAST_DAMAGE = 1e-12
_HALVINGS = 40

Steps = dict[PlaneClass, float]


@dataclass(frozen=True, eq=False)
class _Item:
    """A class of a layer at the steps (s,) that may be chosen."""

    layer: int
    plane_class: PlaneClass
    steps: NDArray
    bits: NDArray
    damage: NDArray


def equal_slope_steps(
    layers: Sequence[PlaneSet],
    probe: Probe,
    defaults: Sequence[Steps],
    sensitivity: Mapping[PlaneClass, float],
    target: float,
) -> list[Steps]:
    """Steps for every class of every layer.

    Args:
        layers: planes.
        probe: of the same layers.
        defaults: steps to start from; the ones chosen lie within 2^−4 to 2^2 of them: windows are
            a sample, and what does not show in them may show elsewhere.
        sensitivity: picture error per squared error, by class; divides what classes do that are measured together.
        target: mean squared picture error wanted of all classes together.

    Returns:
        A step per class for each layer.
    """
    items = [
        item
        for index, (planes, steps) in enumerate(zip(layers, defaults, strict=True))
        for group in ((PlaneClass.DEPTH,), (PlaneClass.COLOR,), (PlaneClass.OPACITY,), _SHAPE)
        for item in _measure(index, group, planes, probe, steps, sensitivity)
    ]
    low, high = -60.0, 20.0  # log2 of damage per bit
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        total = sum(item.damage[_choice(item, middle)] for item in items)
        low, high = (middle, high) if total < target else (low, middle)
    chosen = [dict(steps) for steps in defaults]
    for item in items:
        chosen[item.layer][item.plane_class] = float(item.steps[_choice(item, low)])
    return chosen


def _choice(item: _Item, exchange: float) -> int:
    return int(np.argmin(item.bits + item.damage / 2.0**exchange))


def _measure(
    layer: int,
    group: Sequence[PlaneClass],
    planes: PlaneSet,
    probe: Probe,
    defaults: Steps,
    sensitivity: Mapping[PlaneClass, float],
) -> list[_Item]:
    """Items of classes whose errors are tried together; of classes that have no variation, none."""
    spectra, errors = {}, {}
    for plane_class in group:
        values = planes.values[plane_class]
        spectrum = BlockSpectrum.of(values.reshape(-1, *values.shape[2:]))
        error = spectrum.coding_error(defaults[plane_class]).reshape(values.shape)
        if error.any():
            spectra[plane_class], errors[plane_class] = spectrum, error
    if not errors:
        return []
    damage = probe.damage(layer, errors)
    shares = {c: sensitivity.get(c, 1.0) * float(np.square(e).sum(dtype=np.float64)) for c, e in errors.items()}
    total = sum(shares.values())
    items = []
    for plane_class, spectrum in spectra.items():
        steps = defaults[plane_class] * 2**_OCTAVES
        exponent = DEPTH_EXPONENT if plane_class == PlaneClass.DEPTH else DAMAGE_EXPONENT
        share = shares[plane_class] / total if 0 < total < math.inf else 1 / len(shares)
        own = max(_LEAST_DAMAGE, damage * share)
        items.append(_Item(layer, plane_class, steps, spectrum.bits(steps), own * 2 ** (_OCTAVES * exponent)))
    return items
