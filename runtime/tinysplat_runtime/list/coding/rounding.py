"""How coarsely a list is rounded: what its coder, who prunes it and who trains it all go by.

Nothing here makes a file. A list that is rounded is about what a decoder sees of its file: the codec quantises numbers
in blocks, and here each is rounded on its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...gaussian.gaussians import Gaussians
from ...scene.cameras import Camera
from ...system import disk
from ...system.decibels import decibels
from ...system.evenly import evenly
from ...system.threads import Crew
from ..blocks import blocks_of
from ..evenness import sizes_about
from ..views import Views, pictures_of, views_of_block
from ..visible import taken
from .attributes import LEAST_SCALE, to_columns
from .channels import ChannelCoder, PlacedTier, code_colours, code_shapes, decoded
from .grid import cells_in, grid_of
from .levels import WHOLE
from .steps import DENSE_PLACE, OBJECT, OBJECT_DB, PLACE_DB, SPARSE, Steps, of_pictures

ROUND, LONGEST, COARSEST_TURN = 1.5, 80, 16.0
"""How a round Gaussian is turned does not show: steps of rotation are as many times coarser as the logarithm of the
ratio of the largest to the smallest scale, in this percentile of Gaussians, goes into the first number; at most so
many times. Trained scenes have 3.7 and more, all pixels of a capture 0.2.
"""

UNSEEN = 0.9
"""Steps of what nobody knows how it is looked at, over those of Gaussians that cover several pixels."""

MOST_MEASURED, MOST_BLOCKS = 8, 4
"""Views that steps are measured in; and blocks of a large list."""


@dataclass(frozen=True)
class Rounding:
    """Steps of a list at any Q_g.

    Attributes:
        steps: at Q_g = 0.
        is_object: whether cells of positions are as large everywhere; else they follow the sizes of Gaussians.
        factor: what all steps are taken times.
    """

    steps: Steps
    is_object: bool
    factor: float = 1.0

    @classmethod
    def of(cls, gaussians: Gaussians, views: Views, threads: int, factor: float = 1.0) -> Rounding:
        """What pictures of a list ask for.

        Args:
            gaussians: (N,), each of opacity 1/255 or more.
            views: where they are looked at from.
            threads: to draw with; the result is the same on all.
            factor: such as a profile's `list_steps`.
        """
        return cls(_steps_of(gaussians, views, threads), views.is_object, factor)

    def times(self, factor: float) -> Rounding:
        """With steps so many times as large."""
        return replace(self, factor=self.factor * factor)

    def at(self, qp: float) -> Steps:
        """Steps at Q_g."""
        return self.steps.times(self.factor * 2 ** (qp / 6))

    def sizes(self, gaussians: Gaussians) -> NDArray | None:
        """(N,) what cells of positions follow, as `grid_of` takes it."""
        return None if self.is_object else sizes_about(gaussians)

    def rounded(self, gaussians: Gaussians, qp: float, threads: int = 1) -> Gaussians:
        """About what a decoder will see of (N,) Gaussians in a file of one tier at Q_g, in the order given.

        Without x265 and the octree's bytes, which take most of the time.
        """
        steps = self.at(qp)
        grid, space = grid_of(gaussians.means.astype(np.float64), self.sizes(gaussians), steps.cell)
        rows = np.arange(gaussians.count)
        tier = PlacedTier(WHOLE[0], rows, grid, cells_in(grid, space), to_columns(gaussians, rows))
        code = ChannelCoder(steps, None, Crew(threads).map)
        middle = code_shapes([tier], code).size_middle
        palette = code_colours([tier], code, gaussians.sh, [rows])
        return Gaussians.unchecked(**decoded([tier], middle, palette.mean, palette.basis), origin=gaussians.origin)


def _steps_of(gaussians: Gaussians, views: Views, threads: int) -> Steps:
    """Steps that views ask for; of what nobody knows how it is looked at, those that show from anywhere."""
    dense = (OBJECT if views.is_object else DENSE_PLACE).turned_by(_turn_step(gaussians))
    looked_at = list(_looked_at(gaussians, views))
    if not looked_at:
        return SPARSE.times(UNSEEN)

    def pictures(of: Callable[[Gaussians], Gaussians]) -> Iterator[NDArray]:
        for block, cameras in looked_at:
            yield from pictures_of(of(block), cameras, threads)
            disk.let_go()

    wanted = list(pictures(lambda block: block))

    def psnr(steps: Steps) -> float:
        found = pictures(lambda block: Rounding(steps, views.is_object).rounded(block, 0.0, threads))
        return decibels(float(np.mean([np.square(a - b).mean() for a, b in zip(found, wanted, strict=True)])))

    return of_pictures(dense, psnr, OBJECT_DB if views.is_object else PLACE_DB)


def _looked_at(gaussians: Gaussians, views: Views) -> Iterator[tuple[Gaussians, list[Camera]]]:
    """Some blocks, and cameras that see these."""
    if not views.deciding:
        return
    blocks = blocks_of(gaussians.means)
    if len(blocks) == 1:
        yield gaussians, views.some(MOST_MEASURED)
        return
    for number in evenly(len(blocks), MOST_BLOCKS):
        block = taken(gaussians, blocks[number])
        cameras = views_of_block(block, views).some(MOST_MEASURED // min(len(blocks), MOST_BLOCKS))
        if cameras:
            yield block, cameras
        disk.let_go()


def _turn_step(gaussians: Gaussians) -> float:
    """By how much steps of rotation are coarser, as Gaussians are round."""
    longest, smallest = gaussians.scales.max(axis=1), gaussians.scales.min(axis=1)
    ratios = np.log(np.maximum(longest, LEAST_SCALE) / np.maximum(smallest, LEAST_SCALE), dtype=np.float64)
    return float(np.clip(ROUND / max(np.percentile(ratios, LONGEST), 1e-9), 1, COARSEST_TURN))
