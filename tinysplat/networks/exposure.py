"""One exposure for all photos: a gain and an offset per photo and channel, so that what matches has one colour.

Photos are matched on a coarse grid by local contrast, which does not see exposure. Every pair of photos tells the
ratio of gains and the difference of offsets where it matches; a small system over the photos, to which the first photo
is nailed, takes them together. Where the evidence is weak nothing is changed.

Photos to match with are brought together as far as can be told. Those that Gaussians take their colours from keep what
is small, as who looks from there has an exposure of his own, and of more than two photos what near ones share: only the
odd one is brought to the others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn import functional

from .pairs import ViewPairs
from .sweep import Comparison, InverseDepths, SweepSettings, error_in_sources, matched, settled


@dataclass(frozen=True)
class ExposureSettings:
    """`one_exposure`.

    Attributes:
        cell: side of a cell of the coarse grid, pixels of the photo.
        candidates: swept there.
        contrast_weight: of the grid's costs, which see nothing else.
        consistency: standard deviation of the cross-view error that still counts as a match, candidates.
        clipped: colours nearer than this to black or white tell nothing.
        outlier: colour difference, after correction, from which a cell's weight falls.
        rounds: of estimating with those weights.
        level_weight: weight of the squared mean beside the variance in a gain: how far a gain is trusted before an
            offset where there is little contrast.
        still: weight of no change, as a share of matching cells.
        least: logarithm of a gain, and offset, of which half stays in the colours: more of less, less of more.
        least_matched: the same of photos to match with, where it is noise alone.
        largest: bound on the logarithm of a gain.
    """

    cell: int = 8
    candidates: int = 36
    contrast_weight: float = 0.5
    consistency: float = 1.0
    clipped: float = 0.03
    outlier: float = 0.06
    rounds: int = 3
    level_weight: float = 0.3
    still: float = 0.005
    least: float = 0.18
    least_matched: float = 0.02
    largest: float = 1.2


def one_exposure(
    images: Tensor,
    K_unit: Tensor,
    pairs: ViewPairs,
    whole: InverseDepths,
    settings: ExposureSettings,
    matching: SweepSettings,
) -> tuple[Tensor, Tensor]:
    """Photos as if all were taken with the first one's exposure, (V, 3, H, W) in [0, 1]: to match with, and to show.

    Args:
        images: (V, 3, H, W) RGB in [0, 1], H and W multiples of the cell.
        K_unit: (V, 3, 3) intrinsics divided by image width and height.
        pairs: views to compare.
        whole: the range of depths.
        settings: of this function.
        matching: of the coarse grid's costs and paths.
    """
    s = settings
    cells = functional.avg_pool2d(images, s.cell)
    views = Comparison.on(cells, K_unit, pairs, whole).at(s.candidates)
    blind = blindly(matching, s)
    _, paths = matched(cells, views, blind)
    level, agreement = settled(paths, cells, views, blind)
    (gain, offset), (shown_gain, shown_offset) = _exposures(cells, level, agreement, views, s)
    return (images * gain + offset).clamp(0, 1), (images * shown_gain + shown_offset).clamp(0, 1)


def blindly(matching: SweepSettings, settings: ExposureSettings) -> SweepSettings:
    """Matching by contrast alone."""
    return replace(
        matching, colour_weight=0.0, contrast_weight=settings.contrast_weight, consistency=settings.consistency
    )


def _exposures(
    cells: Tensor, level: Tensor, agreement: Tensor, views: Comparison, s: ExposureSettings
) -> tuple[tuple[Tensor, Tensor], tuple[Tensor, Tensor]]:
    """Gains and offsets (V, 3, 1, 1), to match with and to show, from cells (V, 3, h, w) and where they match."""
    here, there, sound = compared(cells, level, agreement, views, s)
    weight, pairs, count = sound, views.pairs, cells.shape[0]
    for _ in range(s.rounds):
        gain, offset = _solved(here, there, weight, pairs, count, s)
        rest = gain[pairs.reference] * here + offset[pairs.reference]
        rest = rest - gain[pairs.source] * there - offset[pairs.source]
        weight = sound / (1 + rest.square().mean(dim=1, keepdim=True) / s.outlier**2)
    return _solved(here, there, weight, pairs, count, s), _solved(here, there, weight, pairs, count, s, shown=True)


def compared(
    cells: Tensor, levels: Tensor, agreement: Tensor, views: Comparison, settings: ExposureSettings
) -> tuple[Tensor, Tensor, Tensor]:
    """Colours of cells and of their sources at the same places, (P, 3, h, w), and how sure that is, (P, 1, h, w).

    Args:
        cells, levels: (…, 3, h, w) and (…, 1, h, w) of all views.
        agreement: (V, 1, h, w) of those whose depth is sought.
        views: on the cells.
        settings: of `one_exposure`.
    """
    s, reference = settings, views.pairs.reference
    error, inside, there = error_in_sources(levels, views, cells)
    here = cells[reference]
    darkest = torch.minimum(here, there).amin(dim=1, keepdim=True)
    brightest = torch.maximum(here, there).amax(dim=1, keepdim=True)
    sound = ((darkest > s.clipped) & (brightest < 1 - s.clipped)).to(cells.dtype) * inside
    sound = sound * agreement[reference] * torch.exp(-0.5 * (error / s.consistency).square())
    return here, there, sound


def _solved(
    here: Tensor, there: Tensor, weight: Tensor, pairs: ViewPairs, views: int, s: ExposureSettings, shown: bool = False
) -> tuple[Tensor, Tensor]:
    """Gains and offsets (V, 3, 1, 1) from colours (P, 3, h, w) that belong together with weights (P, 1, h, w).

    The gain of a pair is the ratio of standard deviations, which noise in either photo does not pull to one side.
    """
    mass = weight.sum(dim=(2, 3), keepdim=True).clamp_min(1e-6)
    mean_here, mean_there = ((c * weight).sum(dim=(2, 3), keepdim=True) / mass for c in (here, there))
    spread = [
        ((c - m).square() * weight).sum(dim=(2, 3), keepdim=True) / mass + s.level_weight * m.square() + 1e-4
        for c, m in ((here, mean_here), (there, mean_there))
    ]
    evidence = weight.mean(dim=(2, 3), keepdim=True)  # (P, 1, 1, 1)

    def settled_on(difference: Tensor) -> Tensor:
        values = _agreed(evidence, difference, pairs, views, s.still)
        return _above_noise(_odd(values, pairs, views), s.least) if shown else _above_noise(values, s.least_matched)

    gain = torch.exp(settled_on(0.5 * torch.log(spread[1] / spread[0])).clamp(-s.largest, s.largest))
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


def _agreed(evidence: Tensor, difference: Tensor, pairs: ViewPairs, views: int, still: float) -> Tensor:
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
    diagonal = beside.sum(dim=1, keepdim=True) + still
    power, terms = nailed * beside / diagonal, nailed * right / diagonal
    for _ in range(6):
        terms, power = terms + power @ terms, power @ power
    return terms[:, :, None, None]
