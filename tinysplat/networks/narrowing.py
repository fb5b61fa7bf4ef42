"""Leave out depths that a scene does not have: the range that a plane sweep is worth making over.

Candidates spread over the whole range from near to far are spent on depths where nothing is, and each of them is one
more chance of a wrong match. A look at a coarse grid tells between which depths the scene lies.
"""

from dataclasses import replace

import torch
from torch import Tensor
from torch.nn import functional

from .geometry import project_sweep
from .pairs import ViewPairs
from .sweep import Comparison, InverseDepths, SweepSettings, matched, settled

CELL = 8
"""Side of a cell of the coarse grid, pixels of the photo."""

CANDIDATES = 36
"""Swept there, over the whole range."""

DILATIONS = (1, 2, 4)
"""Of `fill_uncertain`, cells."""

LEAST_WEIGHT = 0.3
"""Weight of a cell whose depth no other view agrees with; one that agrees counts 1."""

TAIL, MARGIN = 0.02, 1.5
"""Share of the cells' weight that may lie beyond either end, and what is added there, candidates of the coarse grid."""

FINEST = 2.0
"""The least that neighbouring candidates lie apart in the other view, pixels of the photo; a range is not made narrower
than that."""


def narrowed(
    images: Tensor, K_unit: Tensor, pairs: ViewPairs, whole: InverseDepths, matching: SweepSettings
) -> InverseDepths:
    """The part of each view's range that its scene takes up, with as many candidates as the whole.

    Args:
        images: (V, 3, H, W) RGB in [0, 1], H and W multiples of the cell.
        K_unit: (V, 3, 3) intrinsics divided by image width and height.
        pairs: views to compare.
        whole: the range to look at.
        matching: of the coarse grid's costs and paths.
    """
    cells = functional.avg_pool2d(images, CELL)
    views = Comparison.on(cells, K_unit, pairs, whole)
    look = views.at(CANDIDATES)
    matching = replace(matching, fill_dilations=DILATIONS)
    _, paths = matched(cells, look, matching)
    level, agreement = settled(paths, cells, look, matching)
    return taken_up(level, agreement, views)


def taken_up(level: Tensor, agreement: Tensor, views: Comparison) -> InverseDepths:
    """The part of the range of views whose depth is sought that their filled levels (V, 1, h, w) on cells take up.

    Args:
        level, agreement: (V, 1, h, w) of cells, as `settled` has them.
        views: that were compared on cells, with their whole ranges.
    """
    last, pairs, whole = CANDIDATES - 1, views.pairs, views.depths
    weight = agreement.clamp_min(LEAST_WEIGHT)
    first = quantile(level, weight, TAIL, CANDIDATES) - MARGIN / last
    final = quantile(level, weight, 1 - TAIL, CANDIDATES) + MARGIN / last
    first, final = first.clamp(0, 1), final.clamp(0, 1)

    ends = torch.stack([whole.offset, whole.offset + whole.span], dim=1)[pairs.reference][:, :, None, None]
    x, y, _ = project_sweep(*views.terms, ends)
    height, width = CELL * level.shape[2], CELL * level.shape[3]
    moved = torch.sqrt((width * (x[:, 1] - x[:, 0])).square() + (height * (y[:, 1] - y[:, 0])).square())
    pixels = pairs.by_view(moved.clamp(1e-3, 2.0 * width)).mean(dim=(1, 2, 3))  # (V,) of the whole range
    least = (FINEST * (whole.count - 1) / pixels).clamp_max(1)
    half = torch.maximum(final - first, least) / 2
    middle = torch.minimum(torch.maximum((first + final) / 2, half), 1 - half)
    own = whole.of(pairs)
    return replace(own, offset=own.offset + own.span * (middle - half), span=own.span * (2 * half))


def quantile(level: Tensor, weight: Tensor, share: float, steps: int) -> Tensor:
    """The level (V,) below which a share of the weight lies, of levels (V, 1, h, w) in [0, 1] and weights alike.

    The distribution is read at `steps` even levels and taken as linear between them.
    """
    marks = torch.linspace(0, 1, steps)[:, None, None]
    below = ((level < marks) * weight).sum(dim=(2, 3)) / weight.sum(dim=(2, 3))  # (V, steps), rising from 0
    rise = (below[:, 1:] - below[:, :-1]).clamp_min(1e-4)
    return ((share - below[:, :-1]) / rise).clamp(0, 1).sum(dim=1) / (steps - 1)
