"""How finely each channel of a list is rounded at Q_g = 0.

Where many small Gaussians meet in a pixel, their errors cancel. Where one covers many pixels, as in a scene that was
trained to few Gaussians, each error is seen as it is, and what counts is its share of the Gaussian's own size. Pictures
tell how far a list is from either: `of_pictures`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from ...gaussian.planes import PlaneClass


@dataclass(frozen=True)
class Steps:
    """Steps at Q_g = 0.

    Attributes:
        channels: of all channels but colours, such that a byte gains about as much in every one.
        colours: of the components of colour in their order; those behind have the first one's. The second and third
            mostly hold hue, which varies little: a step that rounds it away tints whole surfaces.
        cell: side of a cell, times √N in radii of an object; of a place in sizes of the Gaussians about it.
        sparse: 0 for those of many small Gaussians to 1 for those of few large ones.
        by_size: whether an error weighs by the size of its Gaussian, so that the step of a size is that of the middle
            one. In places, what is larger is farther away, or stands for more, and weighs no more than others.
    """

    channels: Mapping[tuple[PlaneClass, int], float]
    colours: tuple[float, float, float]
    cell: float
    sparse: float = 0.0
    by_size: bool = True

    def of(self, plane_class: PlaneClass, target: int) -> float:
        """A channel's step."""
        if plane_class == PlaneClass.COLOR:
            return self.colours[target] if target < len(self.colours) else self.colours[0]
        return self.channels[plane_class, target]

    def times(self, factor: float) -> Steps:
        """All of them larger."""
        channels = {name: factor * step for name, step in self.channels.items()}
        red, green, blue = self.colours
        return replace(
            self, channels=channels, colours=(factor * red, factor * green, factor * blue), cell=factor * self.cell
        )

    def turned_by(self, factor: float) -> Steps:
        """With larger ones of rotation."""
        is_turn = PlaneClass.ROTATION
        channels = {name: step * (factor if name[0] == is_turn else 1) for name, step in self.channels.items()}
        return replace(self, channels=channels)

    def towards(self, other: Steps, share: float) -> Steps:
        """Steps between these and others, 0 to 1 of the way in octaves."""

        def between(one: float, to: float) -> float:
            return one ** (1 - share) * to**share

        (red, green, blue), to = self.colours, other.colours
        return Steps(
            {name: between(step, other.channels[name]) for name, step in self.channels.items()},
            (between(red, to[0]), between(green, to[1]), between(blue, to[2])),
            between(self.cell, other.cell),
            share,
            self.by_size,
        )


def _steps(
    opacity: float, sizes: tuple[float, float, float], turn: float, colours: tuple[float, float, float], cell: float
) -> Steps:
    channels = {(PlaneClass.SCALE, target): step for target, step in enumerate(sizes)}
    channels |= {(PlaneClass.ROTATION, target): turn for target in range(3)}
    return Steps({(PlaneClass.OPACITY, 0): opacity, **channels}, colours, cell)


OBJECT = _steps(0.08, (0.28, 0.68, 1.5), 0.12, (0.33, 0.165, 0.165), 0.5)
"""Of many small Gaussians seen from outside: the thickness of discs hardly shows, that of needles does."""

DENSE_PLACE = replace(_steps(0.04, (0.196, 0.75, 1.65), 0.12, (0.14, 0.07, 0.07), 0.48), by_size=False)
"""Of all pixels of a capture, seen from within: as large as these, Gaussians have errors of colour that add up."""

SPARSE = replace(_steps(0.05, (0.085, 0.24, 0.2), 0.055, (0.15, 0.1, 0.1), 0.2), sparse=1.0, by_size=False)
"""Of Gaussians that cover several pixels."""

OBJECT_DB, PLACE_DB = 36.0, 42.0
"""Pictures of a list that is rounded at Q_g = 0 have so much, or steps are nearer to `SPARSE`. Of a place, from which
photos left out differ by some 25 dB, such pictures lose 0.1 dB."""

SPAN_DB, MOST_FINER = 8.0, 0.2
"""`SPARSE` is reached where pictures have so much less; then all are finer, down to this share of them."""

_PARTS = 8


def of_pictures(dense: Steps, psnr: Callable[[Steps], float], target: float) -> Steps:
    """Steps with which pictures are about as good in every list.

    Args:
        dense: those of many small Gaussians, which remain where pictures are good enough with them.
        psnr: dB of pictures of the list that is rounded to some.
        target: dB that are enough.

    Returns:
        Steps that no last bit of a picture changes, but in one case of a thousand.
    """
    lacking = (target - psnr(dense)) / SPAN_DB
    if lacking <= 0:
        return dense
    share = min(math.ceil(_PARTS * lacking) / _PARTS, 1)
    steps = dense.towards(replace(SPARSE, by_size=dense.by_size), share)
    octaves = (psnr(steps) - target) / 6.02
    return steps.times(2 ** max(min(math.floor(_PARTS * octaves) / _PARTS, 0), math.log2(MOST_FINER)))
