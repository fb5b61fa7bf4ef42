"""`edge` a photo at a time: what a photo is worth to its neighbours is computed once.

A stage is given a photo, the first of N views, and up to four neighbours beside it, with what the stages before made
of each of them. So a capture of any number of photos goes through them photo by photo, and each photo has neighbours
of its own. On all views of a window, each beside all others, they compute what `Edge` does; but for exposure and depth
range, which are found with one look at cells and not with two.

K is divided by width and height, c2w relative to the first view's centre; a range is the inverse depth of its far
plane, and how much larger that of its near plane is.
"""

from dataclasses import replace
from typing import ClassVar

import torch
from torch import Tensor, nn

from .edge import Dressed, Edge, Estimate, MatchedViews
from .edge_analysis import ANALYSIS, Matches, match
from .exposure import CANDIDATES, blindly, compared
from .narrowing import DILATIONS, taken_up
from .pairs import ViewPairs
from .surfels import CoarseChanges
from .sweep import OUTPUT_NAMES, Comparison, InverseDepths, agreed, cross_view_agreement, matched, soft_argmin

OF_ALL = frozenset({"cells", "half", "images", "K", "c2w", "ranges", "levels", "agreements", "alphas"})
"""Inputs of the photo and its neighbours; others are of the photo alone."""


class Stage(nn.Module):
    """A stage of a network. `forward` takes tensors in the order of `inputs`, and returns those of `outputs`.

    Attributes:
        inputs: their names, and of how many of the photo's pixels a cell of theirs is a side; None where sizes are
            fixed.
        outputs: names.
    """

    inputs: ClassVar[dict[str, int | None]]
    outputs: ClassVar[tuple[str, ...]]

    def __init__(self, network: Edge) -> None:
        super().__init__()
        self.network = network

    def depths(self, ranges: Tensor) -> InverseDepths:
        """Ranges (N, 2) as such."""
        return InverseDepths(ranges[:, 0], ranges[:, 1], ANALYSIS.candidates)

    def views(self, maps: Tensor, K: Tensor, c2w: Tensor, ranges: Tensor) -> Comparison:
        """The photo and its neighbours on the grid of maps."""
        return Comparison.on(maps, K, ViewPairs.first(c2w), self.depths(ranges))


class Glance(Stage):
    """Levels of a photo's cells, by contrast, which does not see exposure."""

    inputs: ClassVar = {"cells": 8, "K": None, "c2w": None, "ranges": None}
    outputs = ("level",)

    def forward(self, cells: Tensor, K: Tensor, c2w: Tensor, ranges: Tensor) -> Tensor:
        """(1, 1, h, w) of cells (N, 3, h, w), means of 8 × 8 pixels, and ranges (N, 2)."""
        look = self.views(cells, K, c2w, ranges).at(CANDIDATES)
        blind = blindly(ANALYSIS)
        _, paths = matched(cells, look, blind)
        return soft_argmin(paths)


class Settle(Stage):
    """Where cells match those of neighbours, with what colours, and what range their depths take up."""

    inputs: ClassVar = {"cells": 8, "levels": 8, "K": None, "c2w": None, "ranges": None}
    outputs = ("there", "sound", "range")

    def forward(
        self, cells: Tensor, levels: Tensor, K: Tensor, c2w: Tensor, ranges: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Of each neighbour colours (N − 1, 3, h, w) and certainty (N − 1, 1, h, w), and the range (1, 2).

        Levels (N, 1, h, w) are those of `Glance`.
        """
        views = self.views(cells, K, c2w, ranges)
        look = views.at(CANDIDATES)
        agreement = cross_view_agreement(levels, look, blindly(ANALYSIS))
        _, there, sound = compared(cells, levels, agreement, look)
        matching = replace(ANALYSIS, fill_dilations=DILATIONS)
        filled, agreement = agreed(levels, cells, look, matching)
        found = taken_up(filled, agreement, views)
        return there, sound, torch.stack([found.offset, found.span], dim=1)


class Match(Stage):
    """A photo's costs of candidates in its range, and their aggregation."""

    inputs: ClassVar = {"half": 2, "K": None, "c2w": None, "ranges": None}
    outputs = ("costs", "paths", "coarse_paths", "level")

    def forward(self, half: Tensor, K: Tensor, c2w: Tensor, ranges: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """`Matches` of photos (N, 3, h, w) of one exposure at half resolution."""
        found = match(half, self.views(half, K, c2w, ranges))
        return found.costs, found.paths, found.coarse_paths, found.level


class Estimating(Stage):
    """Depth at half resolution by the refiner and the U-Net."""

    inputs: ClassVar = {
        "half": 2, "K": None, "c2w": None, "ranges": None, "costs": 2, "paths": 2, "coarse_paths": 4, "levels": 2,
    }  # fmt: skip
    outputs = ("level", "agreement", "features", "coarse_features", "full", "clues")

    def forward(
        self, half: Tensor, K: Tensor, c2w: Tensor, ranges: Tensor, costs: Tensor, paths: Tensor, coarse_paths: Tensor,
        levels: Tensor,
    ) -> tuple[Tensor, ...]:  # fmt: skip
        """`Estimate` but for its logits, of what `Match` found; levels (N, 1, h, w)."""
        views = self.views(half, K, c2w, ranges)
        matches = Matches(costs, paths, coarse_paths, views.pairs.own(levels))
        found = self.network.estimate(half, views, matches, levels)
        return found.level, found.agreement, found.features, found.coarse_features, found.full, found.clues


class Dress(Stage):
    """What the heads make of a photo's surface beside those of its neighbours."""

    inputs: ClassVar = {
        "images": 1, "shown": 1, "K": None, "c2w": None, "ranges": None, "levels": 2, "agreements": 2, "features": 2,
        "coarse_features": 4, "full": 1, "clues": 2,
    }  # fmt: skip
    outputs = ("level", "opacity", "footprint", "colours", "changes")

    def forward(
        self, images: Tensor, shown: Tensor, K: Tensor, c2w: Tensor, ranges: Tensor, levels: Tensor, agreements: Tensor,
        features: Tensor, coarse_features: Tensor, full: Tensor, clues: Tensor,
    ) -> tuple[Tensor, ...]:  # fmt: skip
        """`Dressed` of photos (N, 3, H, W) of one exposure, and (1, 3, H, W) in that to show."""
        pairs, depths = ViewPairs.first(c2w), self.depths(ranges)
        none = torch.zeros(())
        views = MatchedViews(images, shown, K, c2w, none, depths)
        level, agreement = pairs.own(levels), pairs.own(agreements)
        estimate = Estimate(none, level, agreement, features, coarse_features, full, clues)
        seen = self.network.seen(views, pairs, pairs, estimate, levels, agreements)
        found = self.network.dress(seen, depths.of(pairs))
        c = found.changes
        changes = torch.cat([c.inverse_depth, c.width, c.opacity, c.colour], dim=1)
        return found.level, found.opacity, found.footprint, found.colours, changes


class Finish(Stage):
    """A photo's Gaussians, once its neighbours have had their say."""

    inputs: ClassVar = {
        "shown": 1, "K": None, "c2w": None, "far": None, "ranges": None, "levels": 1, "alphas": 1, "footprint": 1,
        "colours": 1, "changes": 4,
    }  # fmt: skip
    outputs = OUTPUT_NAMES

    def forward(
        self, shown: Tensor, K: Tensor, c2w: Tensor, far: Tensor, ranges: Tensor, levels: Tensor, alphas: Tensor,
        footprint: Tensor, colours: Tensor, changes: Tensor,
    ) -> tuple[Tensor, ...]:  # fmt: skip
        """The tensors of `OUTPUT_NAMES` of what `Dress` found; levels and opacities (N, 1, H, W), far (1,)."""
        pairs = ViewPairs.first(c2w)
        coarse = CoarseChanges(*changes.split([1, 1, 1, 3], dim=1))
        dressed = Dressed(pairs.own(levels), pairs.own(alphas), footprint, colours, coarse)
        views = MatchedViews(shown, shown, K, c2w, far, self.depths(ranges))
        return self.network.finish(dressed, views, pairs, levels, alphas)[0]


STAGES: dict[str, type[Stage]] = {
    "glance": Glance,
    "settle": Settle,
    "match": Match,
    "estimate": Estimating,
    "dress": Dress,
    "finish": Finish,
}
"""In the order in which they follow one another."""
