"""Steps down the gradient of pictures, a picture at a time, for Gaussians of a list."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...gaussian.footprints import nearest_pixels
from ...gaussian.gaussians import Gaussians
from ...render.gradient import PhotoError, Target
from ...scene.cameras import Camera
from . import kernels
from .free import FreeGaussians
from .kernels_free import LOG_SCALE, LOGIT, MOVE, TURN

LIMITS = ((-200.0, 200.0),) * 3 + ((-30.0, 30.0),) * 3 + ((-4.0, 4.0),) * 4 + ((-14.0, 7.0),)
"""Least and greatest value by kind, but for colours; opacities end short of 1, from where there is no way back."""

COLOURS = -4.0, 8.0
"""Least and greatest coefficient of SH."""


@dataclass(frozen=True)
class Pace:
    """How Gaussians are corrected; lengths in pixels of the view that shows a Gaussian largest.

    Attributes:
        move, log_scale, turn, logit, sh, sh_rest: largest change of a value in a step, roughly (Adam's step size), at
            the start; `sh` of degree 0, `sh_rest` of those above.
        fade: by how much every logit of opacity falls in a step, at the start: what no picture needs goes.
        last: what is left of all of them at the end; they fall evenly on a logarithmic scale.
        averaged: share of the way, at the end, whose values are averaged: steps down single pictures' gradients go to
            and fro about what suits all (Polyak and Juditsky, 1992).
        momentum, memory, noise: Adam's β₁, β₂ and ε.
        looks: how often what has faded goes.
    """

    move: float = 0.15
    log_scale: float = 0.02
    turn: float = 0.0
    logit: float = 0.08
    sh: float = 0.01
    sh_rest: float = 0.0
    fade: float = 0.0
    last: float = 0.1
    averaged: float = 0.0
    momentum: float = 0.9
    memory: float = 0.99
    noise: float = 1e-3
    looks: int = 10

    def step_sizes(self, way: float, functions: int) -> list[float]:
        """By kind of value, at a share of the way."""
        sizes = [self.move] * (LOG_SCALE - MOVE) + [self.log_scale] * (TURN - LOG_SCALE)
        sizes += [self.turn] * (LOGIT - TURN) + [self.logit] + [self.sh] * 3 + [self.sh_rest] * 3 * (functions - 1)
        return [size * self.left(way) for size in sizes]

    def left(self, way: float) -> float:
        """What is left of all changes, at a share of the way."""
        return self.last ** min(way, 1)

    def is_averaged(self, way: float) -> bool:
        """Whether values count at a share of the way."""
        return way > 1 - self.averaged


@dataclass
class RunningMean:
    """The mean of arrays of one shape that come one by one.

    Attributes:
        value: float64 or float32, of those that came; None before the first.
        count: how many came.
    """

    value: NDArray | None = None
    count: int = 0

    def take(self, array: NDArray) -> None:
        """One more."""
        self.count += 1
        if self.value is None:
            self.value = array.copy()
        else:
            self.value += (array - self.value) / self.value.dtype.type(self.count)


class Descent:
    """Gaussians on their way, with the running means of their gradients and of these squared that Adam takes.

    Attributes:
        field: as they stand.
        gradient: (kinds, rows) float32 of the last picture.
        means: (2, kinds, rows) float32, the running means of gradients and of their squares.
        count: steps taken.
    """

    def __init__(
        self, field: FreeGaussians, pace: Pace, run_jobs: Callable, limits: Sequence[tuple[float, float]] = LIMITS
    ) -> None:
        """`limits` are the least and greatest value by kind, but for colours; `run_jobs` maps a function over a list,
        on any threads.
        """
        self.count, self._pace, self._run, self._limits = 0, pace, run_jobs, limits
        self.field, self.means, self.gradient, self._mean = _begun(field)

    def step(
        self, target: Target, way: float, *, weight: float = 1.0, structure: float = 0.0, absent: NDArray | None = None
    ) -> PhotoError:
        """Towards one picture, at a share of the way; what it lacked before. The rest as `FreeGaussians.measure`.

        Gaussians of a mask `absent` (N,) bool are not drawn, and the others are more opaque for it.
        """
        self.gradient[:] = 0
        logits = self.field.values[LOGIT].copy()
        if absent is not None:
            self.field.values[LOGIT, : absent.size] = _without(logits[: absent.size], absent)
            self.field.place()
        error = self.field.measure(target, gradient=self.gradient, weight=weight, structure=structure)
        self.field.values[LOGIT] = logits
        self.count += 1
        pace, count, functions = self._pace, float(self.count), self.field.functions
        sizes, limits = pace.step_sizes(way, functions), [*self._limits, *[COLOURS] * 3 * functions]

        def move(kind: int) -> None:
            numbers = (sizes[kind], pace.momentum, pace.memory, pace.noise, count, *limits[kind])
            kernels.adam(self.field.values[kind], self.gradient[kind], *self.means[:, kind], numbers)

        self._run(move, [kind for kind, size in enumerate(sizes) if size])
        if pace.fade:
            self.field.values[LOGIT] -= np.float32(pace.fade * pace.left(way))
        self.field.place()
        if pace.is_averaged(way):
            self._mean.take(self.field.values[:, : self.field.count])
        return error

    def settle(self) -> None:
        """Go on from the mean of the values that were averaged, if any were since Gaussians were added."""
        if self._mean.value is not None:
            self.field.values[:, : self.field.count] = self._mean.value
            self.field.place()

    def keep(self, keep: NDArray) -> None:
        """Go on with those of a mask (N,) bool."""
        means, mean = self.means, self._mean
        self.field, self.means, self.gradient, self._mean = _begun(self.field.kept(keep))
        self.means[..., : self.field.count] = means[..., : keep.size][..., keep]
        if mean.value is not None:
            self._mean = RunningMean(mean.value[:, keep], mean.count)

    def add(self, field: FreeGaussians) -> None:
        """Go on with a field whose first Gaussians are these."""
        means, count = self.means, self.field.count
        self.field, self.means, self.gradient, self._mean = _begun(field)
        self.means[..., :count] = means[..., :count]


def _begun(field: FreeGaussians) -> tuple[FreeGaussians, NDArray, NDArray, RunningMean]:
    """Before the first step: the field, running means, a gradient, and the mean of values."""
    return field, np.zeros((2, *field.values.shape), np.float32), np.zeros_like(field.values), RunningMean()


def _without(logits: NDArray, absent: NDArray) -> NDArray:
    """(N,) logits of opacity with those of a mask gone, and the others' opacities as large on the mean."""
    least, most = LIMITS[LOGIT]
    opacities = 1 / (1 + np.exp(-logits)) / max(1 - absent.mean(), 1e-6)
    seen_through = np.maximum(1 - opacities, np.exp(-most))
    return np.where(absent, least, np.minimum(np.log(opacities / seen_through), most))


def units(gaussians: Gaussians, cameras: Sequence[Camera]) -> NDArray:
    """(N,) float32 width of a pixel of the view that shows each largest, scene units."""
    widths = nearest_pixels(gaussians.means, gaussians.origin, cameras)
    return np.where(widths > 0, widths, np.float32(1))
