"""Which pixels of a photo count: masks, what they mean, and what stands where they leave something out.

A mask is a picture beside its photo, or the photo's own opacity. Black is left out and white is kept, as COLMAP and
nerfstudio have it. What is left out means one of two things: something *moves* there, such as a person or the
photographer's shadow, and what lies behind it is for other photos to show; or it is *background*, and nothing is there
at all.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .images import doubled, read_image, read_opacity
from .resampling import scaled

_HALF = 128
"""Levels from which on a pixel is kept, of masks that have such; of those with small numbers, such as 0 and 1, all but
0 are."""


@dataclass(frozen=True)
class Mask:
    """What says which pixels of a photo count.

    Attributes:
        path: a picture of the photo's shape.
        is_background: whether nothing is where they do not; otherwise something moves there.
        is_opacity: whether it is the photo itself, whose opacities say so.
        is_inverted: whether white is left out and black is kept, as instant-ngp has it.
    """

    path: Path
    is_background: bool
    is_opacity: bool = False
    is_inverted: bool = False

    def kept(self, height: int, width: int) -> NDArray:
        """(height, width) uint8 of a photo of that size: 255 where pixels count, else 0.

        Raises:
            InputError: names the mask, which cannot be read or is of another shape.
        """
        levels = self._levels()
        if levels.shape == (width, height) != (height, width):
            levels = self._levels(upright=False)  # as the photo is then taken, too
        is_white = levels >= (_HALF if levels.max() >= _HALF else 1)
        kept = np.where(is_white != self.is_inverted, np.uint8(255), np.uint8(0))
        rows, columns = kept.shape
        if (rows, columns) == (height, width):
            return kept
        if abs(columns * height / width - rows) > 1:
            wanted = f"expected {width}x{height} as its photo has, or the same shape in another size"
            raise InputError(f"a mask of {columns}x{rows} pixels, {wanted}", where=str(self.path))
        share = scaled(kept[..., None], height, width)[..., 0]
        return np.where(share >= 0.5, np.uint8(255), np.uint8(0))

    def _levels(self, *, upright: bool = True) -> NDArray:
        if self.is_opacity:
            return read_opacity(self.path, upright=upright)
        levels: NDArray = read_image(self.path, upright=upright).max(axis=2)
        return levels


def filled(values: NDArray, known: NDArray) -> NDArray:
    """Values (H, W, C) floating point, where they are not known a smooth continuation of those that are.

    Means of what is known over ever larger blocks, interpolated ("push-pull", Gortler et al. 1996, "The Lumigraph").

    Args:
        values: anything where it is not known.
        known: (H, W) bool; of none at all, the values stay.
    """
    if known.all() or not known.any():
        return values
    height, width, channels = values.shape
    even = [(0, height % 2), (0, width % 2)]
    weights = np.pad(known, even).reshape(-(-height // 2), 2, -(-width // 2), 2).astype(values.dtype)
    blocks = np.pad(np.where(known[..., None], values, 0), [*even, (0, 0)]).reshape(*weights.shape, channels)
    counts = weights.sum(axis=(1, 3))
    means = blocks.sum(axis=(1, 3)) / np.maximum(counts, 1)[..., None]
    coarse = filled(means, counts > 0)
    smooth = (doubled(doubled(coarse, 0), 1) / 16)[:height, :width]
    return np.where(known[..., None], values, smooth)
