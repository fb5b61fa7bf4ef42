"""How finely depth and opacity are coded: as finely as their errors show in the picture.

Errors of all other classes cost about the same in every scene, so that their steps are constants (`profiles`). Depth's
show where Gaussians change places, and the step at which they cost a given error differs by a factor of 20 from scene
to scene: it is measured (`probe`). So is opacity's, which is a constant but where surfaces that show through each other
make more of it: of 37 windows, a tenth of depth's damage in most and twice as much as depth's in three.

Depth's error at its best step is the same everywhere: on ten scenes of four kinds the best step, searched for, made one
of 2.5e-5 to 4.6e-5 in whole pictures midway between the views.
"""

import math
from collections.abc import Sequence

from numpy.typing import NDArray

from ...gaussian.planes import PlaneClass
from .blocks import BlockSpectrum
from .probe import Probe

DEPTH_EXPONENT = 1.0
"""Growth of the squared picture error with depth's step, about: errors show as neighbours that change places. On ten
scenes it was 0.5 to 1.2 about their best steps."""

FARTHEST = 3.5
"""Most that measurements move the step either way: a stripe is a sample of the scene."""

NEAR_ENOUGH = 1.41
"""A measurement that moves the step by less is the last: the next one would move it by little."""

OPACITY_EXPONENT = 1.7
"""Growth of the squared picture error with opacity's step: 1.5 to 1.9 on 37 windows."""

_LEAST_DAMAGE = 1e-12

_PER_OCTAVE = 64
"""Steps are rounded to so many an octave: finer, they would carry the last bits of a picture into the file."""

Steps = dict[PlaneClass, float]


def measured_depth_step(
    probe: Probe, inverse: Sequence[NDArray], offsets: Sequence[NDArray], start: float, target: float, rounds: int
) -> float:
    """The step of −1/z at which depth's errors cost `target`.

    Args:
        probe: of the same layers.
        inverse: (V, H, W) −1/z of each layer.
        offsets: of each layer, the QPs by which its blocks are coarser; see `Channel`.
        start: step to measure at first, and to stay within a factor of `FARTHEST` of.
        target: mean squared picture error wanted.
        rounds: measurements at most, each at the step that the one before led to.
    """
    spectra = [BlockSpectrum.of(planes, chosen) for planes, chosen in zip(inverse, probe.reached, strict=True)]
    step = start
    for _ in range(rounds):
        errors = [spectrum.coding_error(step, by_block) for spectrum, by_block in zip(spectra, offsets, strict=True)]
        before, damage = step, max(probe.damage(errors), _LEAST_DAMAGE)
        step *= (target / damage) ** (1 / DEPTH_EXPONENT)
        step = min(max(_rounded(step, start), start / FARTHEST), start * FARTHEST)
        if max(step, before) <= NEAR_ENOUGH * min(step, before):
            break
    return step


def measured_opacity_step(probe: Probe, opacities: Sequence[NDArray], start: float, most: float) -> float:
    """The step of opacity: `start`, or the finer one at which its errors cost `most`.

    Args:
        probe: of the same layers.
        opacities: (V, H, W) float32 of each layer.
        start: the step that is fine enough for most scenes, and at most `FARTHEST` times as fine as which is found.
        most: mean squared picture error allowed.
    """
    pairs = zip(opacities, probe.reached, strict=True)
    errors = [BlockSpectrum.of(planes, chosen).coding_error(start) for planes, chosen in pairs]
    wanted = (most / max(probe.opacity_damage(errors), _LEAST_DAMAGE)) ** (1 / OPACITY_EXPONENT)
    return min(max(_rounded(start * wanted, start), start / FARTHEST), start)


def _rounded(step: float, start: float) -> float:
    return start * 2 ** (round(_PER_OCTAVE * math.log2(step / start)) / _PER_OCTAVE)
