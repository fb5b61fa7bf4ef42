"""`enlarge`: what a network found on small photos, on the pixels of large ones. Nothing here is learned.

Where a surface lies need not be sought again on every pixel of a large photo: its depth, opacity and footprint are
brought there from the small one, led by the large one's colours (joint bilateral upsampling, Kopf et al. 2007), and
moved until the photos agree. Nothing reaches farther than `HALO` pixels, so that a strip of rows with so many more on
each side gives what the whole photo would.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional

from .aggregation import box_mean
from .geometry import inside_frame, pixel_rays, project_sweep, sample_bilinear, sweep_coefficients
from .surfels import pixel_layer, sharpened, splat_weights
from .sweep import DAMPING, LARGEST_STEP, OUTLIER, REACH, SHARPENING, AlignmentSettings

OUTPUT_NAMES = ("means", "quats", "scales", "opacities", "sh")

HALO = 16
"""Rows beside a strip on which its own depend: two boxes of 11 pixels, one of 9 for slopes, and a difference."""

EDGE = 24.0
"""Fall of a small pixel's weight with the summed difference of its colour to the large one's."""

ALIGNMENT = AlignmentSettings(steps=2)
"""Of depth to the photos; a candidate is a step that moves a pixel by one in the sources."""


class Enlarge(nn.Module):
    """A strip of a large photo, and what is known of the small one, to the strip's Gaussians."""

    def forward(
        self, photo: Tensor, small: Tensor, rows: Tensor, columns: Tensor, K: Tensor, c2w: Tensor, sources: Tensor,
        source_K: Tensor, rotation: Tensor, translation: Tensor, unit: Tensor,
    ) -> tuple[Tensor, ...]:  # fmt: skip
        """Gaussians of a strip.

        Args:
            photo: (1, 3, h, W) RGB in [0, 1], in the exposure that the network gave it.
            small: (1, 9, h', W'), rows of the small photo about the strip's: its colours, inverse depth, opacity,
                footprint in pixels of the grid at hand, and what its Gaussians' colours have more than the photo.
            rows: (h,) where the strip's pixel centres lie among them, of which the first is centred at 0.
            columns: (W,) the same for columns.
            K: (1, 3, 3) intrinsics in pixels of the strip.
            c2w: (1, 4, 4).
            sources: (S, 3, H, W) whole photos that the depth is aligned to.
            source_K: (S, 3, 3) intrinsics divided by image width and height.
            rotation, translation: (S, 3, 3), (S, 3) from the strip's camera to the sources'.
            unit: () inverse depth that moves a pixel by one in the sources.

        Returns:
            The tensors named by `OUTPUT_NAMES`, (1, h, W, …).
        """
        inverse_depth, opacity, footprint, change = self._brought(photo, small, rows, columns)
        terms = sweep_coefficients(
            pixel_rays(K, *photo.shape[2:]).expand(sources.shape[0], -1, -1, -1), source_K, rotation, translation
        )
        aligned = self._aligned(inverse_depth, photo, sources, terms, unit)
        inverse_depth = torch.maximum(torch.minimum(aligned, 2 * inverse_depth), 0.5 * inverse_depth)
        weights = splat_weights(inverse_depth, opacity, footprint)
        colours = sharpened(photo, weights, *SHARPENING) + change
        size = torch.tensor([[photo.shape[3]], [photo.shape[2]], [1]], dtype=K.dtype)
        return pixel_layer(colours, K / size, c2w, inverse_depth, opacity, footprint).arrays()

    def _brought(self, photo: Tensor, small: Tensor, rows: Tensor, columns: Tensor) -> tuple[Tensor, ...]:
        """Inverse depth, opacity, footprint (1, 1, h, W) and change of colour (1, 3, h, W) of the strip's pixels.

        Of the 3 × 3 small pixels about each, by a quadratic spline of the distance and by likeness of colour.
        """
        row, column = torch.round(rows).long(), torch.round(columns).long()
        height, width = small.shape[2:]
        beside, below = (columns - column)[None, :], (rows - row)[:, None]
        total, mass = torch.zeros_like(photo[:, :1]), torch.full_like(photo[:, :1], 1e-20)
        for j in (-1, 0, 1):  # columns first: there are fewer small rows, and whole rows are quicker to take
            line = small.index_select(3, (column + j).clamp(0, width - 1))
            for i in (-1, 0, 1):
                there = line.index_select(2, (row + i).clamp(0, height - 1))
                unlike = _summed((there[:, :3] - photo).abs())
                weight = _spline(below, i) * _spline(beside, j) * torch.exp(-EDGE * unlike)
                total, mass = total + weight * there[:, 3:], mass + weight
        return (total / mass).split([1, 1, 1, 3], dim=1)

    def _aligned(
        self, inverse_depth: Tensor, photo: Tensor, sources: Tensor, terms: tuple[Tensor, Tensor], unit: Tensor
    ) -> Tensor:
        """As `sweep.align_photos` with any exposure, of a strip: inverse depth (1, 1, h, W) in steps of `unit`."""
        s = ALIGNMENT
        for _ in range(s.steps):
            reach = REACH * unit
            samples = torch.cat([inverse_depth - reach, inverse_depth, inverse_depth + reach], dim=1)
            x, y, ratio = project_sweep(*terms, samples)
            read = sample_bilinear(sources, x, y)  # (S, 3, 3 samples, h, W)
            seen = inside_frame(x[:, 1:2], y[:, 1:2], ratio[:, 1:2])
            slope = (read[:, :, 2] - read[:, :, 0]) / (2 * REACH)
            rest = read[:, :, 1] - photo
            weight = seen / (1 + rest.square().mean(dim=1, keepdim=True) / OUTLIER**2)
            parts = [_summed(slope * rest), _summed(slope * slope), slope, rest, torch.ones_like(weight)]
            products, mean_slope, mean_rest, mass = box_mean(torch.cat(parts, dim=1) * weight, s.window).split(
                [2, 3, 3, 1], dim=1
            )
            shared = torch.cat([_summed(mean_slope * mean_rest), _summed(mean_slope * mean_slope)], dim=1)
            sums = (products - shared / mass.clamp_min(1e-6)).sum(dim=0, keepdim=True)
            step = -sums[:, :1] / (sums[:, 1:] + DAMPING)
            inverse_depth = inverse_depth + step.clamp(-LARGEST_STEP, LARGEST_STEP) * unit
        return inverse_depth


def _summed(maps: Tensor) -> Tensor:
    """Sum (N, 1, h, w) of maps (N, C, h, w): a product, as onnxruntime's sums over the first axes are slow."""
    return functional.conv2d(maps, torch.ones(1, maps.shape[1], 1, 1))


def _spline(offset: Tensor, k: int) -> Tensor:
    """Weight of the k-th neighbour, −1 to 1, of a place `offset` from the nearest: the quadratic B-spline."""
    return 0.75 - offset * offset if k == 0 else 0.5 * (0.5 + k * offset).square()
