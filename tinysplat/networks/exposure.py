"""One exposure for all photos: a gain and an offset per photo and channel, so that what matches has one colour.

Photos are matched on a coarse grid by local contrast, which does not see exposure. Every pair of photos tells the
ratio of gains and the difference of offsets where it matches; a small system over the photos, to which the first photo
is nailed, takes them together. Where the evidence is weak nothing is changed.

Photos to match with are brought together as far as can be told. Those that Gaussians take their colours from keep what
is small, as who looks from there has an exposure of his own, and of more than two photos what near ones share: only the
odd one is brought to the others.
"""

from dataclasses import replace

import torch
from torch import Tensor
from torch.nn import functional

from .pairs import ViewPairs
from .sweep import Comparison, InverseDepths, SweepSettings, error_in_sources, matched, settled

CELL, CANDIDATES = 8, 36
"""Side of a cell of the coarse grid, pixels of the photo, and what is swept there."""

CONTRAST_WEIGHT = 0.5
"""Of the grid's costs, which see nothing else."""

CONSISTENCY = 1.0
"""Standard deviation of the cross-view error that still counts as a match, candidates."""

CLIPPED = 0.03
"""Colours nearer than this to black or white tell nothing."""

OUTLIER, ROUNDS = 0.06, 3
"""Colour difference, after correction, from which a cell's weight falls, and rounds of estimating with weights."""

LEVEL_WEIGHT = 0.3
"""Weight of the squared mean beside the variance in a gain: how far a gain is trusted before an offset where there is
little contrast."""

STILL = 0.005
"""Weight of no change, as a share of matching cells."""

LEAST, LEAST_MATCHED = 0.18, 0.02
"""Logarithm of a gain, and offset, of which half stays in the colours, more of less and less of more; the same of
photos to match with, where it is noise alone."""

LARGEST = 1.2
"""Bound on the logarithm of a gain."""


def one_exposure(
    images: Tensor, K_unit: Tensor, pairs: ViewPairs, whole: InverseDepths, matching: SweepSettings
) -> tuple[Tensor, Tensor]:
    """Photos as if all were taken with the first one's exposure, (V, 3, H, W) in [0, 1]: to match with, and to show.

    Args:
        images: (V, 3, H, W) RGB in [0, 1], H and W multiples of the cell.
        K_unit: (V, 3, 3) intrinsics divided by image width and height.
        pairs: views to compare.
        whole: the range of depths.
        matching: of the coarse grid's costs and paths.
    """
    cells = functional.avg_pool2d(images, CELL)
    views = Comparison.on(cells, K_unit, pairs, whole).at(CANDIDATES)
    blind = blindly(matching)
    _, paths = matched(cells, views, blind)
    level, agreement = settled(paths, cells, views, blind)
    (gain, offset), (shown_gain, shown_offset) = _exposures(cells, level, agreement, views)
    return (images * gain + offset).clamp(0, 1), (images * shown_gain + shown_offset).clamp(0, 1)


def blindly(matching: SweepSettings) -> SweepSettings:
    """Matching by contrast alone."""
    return replace(matching, colour_weight=0.0, contrast_weight=CONTRAST_WEIGHT, consistency=CONSISTENCY)


def _exposures(
    cells: Tensor, level: Tensor, agreement: Tensor, views: Comparison
) -> tuple[tuple[Tensor, Tensor], tuple[Tensor, Tensor]]:
    """Gains and offsets (V, 3, 1, 1), to match with and to show, from cells (V, 3, h, w) and where they match."""
    here, there, sound = compared(cells, level, agreement, views)
    weight, pairs, count = sound, views.pairs, cells.shape[0]
    for _ in range(ROUNDS):
        gain, offset = _solved(here, there, weight, pairs, count)
        rest = gain[pairs.reference] * here + offset[pairs.reference]
        rest = rest - gain[pairs.source] * there - offset[pairs.source]
        weight = sound / (1 + rest.square().mean(dim=1, keepdim=True) / OUTLIER**2)
    return _solved(here, there, weight, pairs, count), _solved(here, there, weight, pairs, count, shown=True)


def compared(cells: Tensor, levels: Tensor, agreement: Tensor, views: Comparison) -> tuple[Tensor, Tensor, Tensor]:
    """Colours of cells and of their sources at the same places, (P, 3, h, w), and how sure that is, (P, 1, h, w).

    Args:
        cells, levels: (…, 3, h, w) and (…, 1, h, w) of all views.
        agreement: (V, 1, h, w) of those whose depth is sought.
        views: on the cells.
    """
    reference = views.pairs.reference
    error, inside, there = error_in_sources(levels, views, cells)
    here = cells[reference]
    darkest = torch.minimum(here, there).amin(dim=1, keepdim=True)
    brightest = torch.maximum(here, there).amax(dim=1, keepdim=True)
    sound = ((darkest > CLIPPED) & (brightest < 1 - CLIPPED)).to(cells.dtype) * inside
    sound = sound * agreement[reference] * torch.exp(-0.5 * (error / CONSISTENCY).square())
    return here, there, sound


def _solved(
    here: Tensor, there: Tensor, weight: Tensor, pairs: ViewPairs, views: int, shown: bool = False
) -> tuple[Tensor, Tensor]:
    """Gains and offsets (V, 3, 1, 1) from colours (P, 3, h, w) that belong together with weights (P, 1, h, w).

    The gain of a pair is the ratio of standard deviations, which noise in either photo does not pull to one side.
    """
    mass = weight.sum(dim=(2, 3), keepdim=True).clamp_min(1e-6)
    mean_here, mean_there = ((c * weight).sum(dim=(2, 3), keepdim=True) / mass for c in (here, there))
    spread = [
        ((c - m).square() * weight).sum(dim=(2, 3), keepdim=True) / mass + LEVEL_WEIGHT * m.square() + 1e-4
        for c, m in ((here, mean_here), (there, mean_there))
    ]
    evidence = weight.mean(dim=(2, 3), keepdim=True)  # (P, 1, 1, 1)

    def settled_on(difference: Tensor) -> Tensor:
        values = _agreed(evidence, difference, pairs, views)
        return _above_noise(_odd(values, pairs, views), LEAST) if shown else _above_noise(values, LEAST_MATCHED)

    gain = torch.exp(settled_on(0.5 * torch.log(spread[1] / spread[0])).clamp(-LARGEST, LARGEST))
    return gain, settled_on(gain[pairs.source] * mean_there - gain[pairs.reference] * mean_here)


def _odd(values: Tensor, pairs: ViewPairs, views: int) -> Tensor:
    """What is a photo's own in values (V, 3, 1, 1): less the median of it and its two nearest; of two photos, all.

    A camera that adapts as it moves gives near photos alike exposures, and who looks from there expects that one.
    """
    near = values[pairs.by_view(pairs.source)[:, :2]]  # (V, 1 or 2, 3, 1, 1)
    low, high = near.amin(dim=1), near.amax(dim=1)
    shared = torch.maximum(torch.minimum(values, high), low)
    return values - (1 - 2 // views) * shared


def _above_noise(values: Tensor, least: float) -> Tensor:
    """What is well above `least` as it is, what is well below as nothing, without a step between."""
    power = values.square().square()
    return values * power / (power + least**4)


def _agreed(evidence: Tensor, difference: Tensor, pairs: ViewPairs, views: int) -> Tensor:
    """Values a (V, 3, 1, 1) with a[reference] − a[source] = difference (P, 3, 1, 1), the first photo's zero.

    Weighted least squares with a pull to zero: (D − A) a = r, solved by a = Σ (D⁻¹ A)ᵏ D⁻¹ r, doubling k.
    """
    here = (pairs.reference[:, None] == torch.arange(views)).to(difference.dtype)  # (P, V)
    there = (pairs.source[:, None] == torch.arange(views)).to(difference.dtype)
    weight = evidence.flatten(1)  # (P, 1)
    beside = here.transpose(0, 1) @ (weight * there)
    beside = beside + beside.transpose(0, 1)
    right = (here - there).transpose(0, 1) @ (weight * difference.flatten(1))  # (V, 3)
    nailed = (torch.arange(views)[:, None] > 0).to(difference.dtype)
    diagonal = beside.sum(dim=1, keepdim=True) + STILL
    power, terms = nailed * beside / diagonal, nailed * right / diagonal
    for _ in range(6):
        terms, power = terms + power @ terms, power @ power
    return terms[:, :, None, None]
