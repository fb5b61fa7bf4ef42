"""What stands still in photos that were taken from many places: titles, logos, bars of a screen, dirt on the lens.

It says that the camera did not move, and so moves places and focal lengths. Masks leave it out.
"""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import warn
from tinysplat_runtime.scene.images import image_size, read_image
from tinysplat_runtime.scene.masks import Mask
from tinysplat_runtime.scene.matches import corners, matched, place_in_picture, staying
from tinysplat_runtime.scene.pictures import write_png
from tinysplat_runtime.scene.resampling import scaled
from tinysplat_runtime.system.evenly import evenly

from .placing import MASKS

FEWEST, MOST = 5, 24
"""Photos by which that is told, and of which it is sought."""

LOOK_WIDTH = 384
"""Pixels of the longer side of photos in which corners are sought."""

ROUND = 0.04
"""Of that side, about a corner that stands still, that is left out with it."""


def masked_still(source: Path, names: Sequence[str], photos: Path) -> dict[str, Mask]:
    """Masks of what stands still in all photos, for COLMAP beside their folder, too; says where that is."""
    masks, where = still_masks(photos, names, photos.with_name(MASKS))
    if masks:
        said = f"something stands still at one place of the picture ({where}) while all else moves"
        warn(f"{source}: {said}: a title, a logo or dirt; it is left out of matching, and masked in the scene")
    return masks


def still_masks(photos: Path, names: Sequence[str], folder: Path) -> tuple[dict[str, Mask], str]:
    """Write masks of what stands still, one for each photo.

    Args:
        photos: their folder.
        names: of the photos, in the order in which they were taken.
        folder: of the masks, which is made where there are any; `NAME.png` of a photo NAME.

    Returns:
        Masks by the names of photos, and in words where they leave something out; none where nothing stands still, or
        photos are few or of several sizes.
    """
    sizes = {image_size(photos / name) for name in names}
    if len(names) < FEWEST or len(sizes) > 1:
        return {}, ""
    ((height, width),) = sizes
    scale = LOOK_WIDTH / max(height, width)
    small = round(height * scale), round(width * scale)
    found = [corners(scaled(read_image(photos / names[i]), *small)) for i in evenly(len(names), MOST)]
    apart = [*pairwise(found), *zip(found, found[2:], strict=False)]
    places = staying([matched(one, other) for one, other in apart])
    if not len(places):
        return {}, ""
    counts = np.where(_within(places / scale, (height, width), ROUND * max(height, width)), 0, 255).astype(np.uint8)
    folder.mkdir(exist_ok=True)
    for name in names:
        write_png(folder / f"{name}.png", counts)
    where = place_in_picture(places, small[1], small[0])
    return {name: Mask(folder / f"{name}.png", is_background=False) for name in names}, where


def _within(places: NDArray, size: tuple[int, int], radius: float) -> NDArray:
    """(H, W) bool of pixels that lie within a radius of one of places (N, 2), x first."""
    height, width = size
    near = np.zeros(size, bool)
    for x, y in np.unique(np.rint(places), axis=0):
        rows = slice(max(int(y - radius), 0), int(y + radius) + 1)
        columns = slice(max(int(x - radius), 0), int(x + radius) + 1)
        v, u = np.ogrid[rows.start : min(rows.stop, height), columns.start : min(columns.stop, width)]
        near[rows, columns] |= (u - x) ** 2 + (v - y) ** 2 <= radius**2
    return near
