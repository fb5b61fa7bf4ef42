"""Textures for procedural scenes: crops of photos with an open licence, and patterns."""

from collections.abc import Sequence
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.images import PHOTO_SUFFIXES, read_image
from tinysplat_runtime.scene.resampling import resize_cover

SIZE = 192
"""Side of a texture, pixels."""

PHOTOS = (
    *("astronaut", "coffee", "chelsea", "rocket", "hubble_deep_field", "immunohistochemistry", "retina", "camera"),
    *("brick", "grass", "gravel", "page", "text", "coins", "moon", "cat", "cell", "clock"),
)
"""Pictures of scikit-image, all CC0 or in the public domain; those that would have to be fetched are left out."""

CROPS = 8
"""Crops of a picture that is no scene's photo; of those there are many alike, and one crop of each is taken."""

LARGEST_SIDE = 800
"""Shorter side, pixels, that pictures are scaled to at most before they are cut up."""


def texture_bank(
    folders: Sequence[Path], count: int, rng: np.random.Generator, pictures: Path | None = None
) -> NDArray:
    """Textures (count, SIZE, SIZE, 3) uint8: at most two thirds of them crops of photos, the others patterns.

    Args:
        folders: scene folders whose photos may be cut up; photos that cannot be read are passed over.
        count: how many textures.
        rng: of the crops and patterns.
        pictures: folder searched to the bottom for further photos, or None.

    Raises:
        InputError: there is no picture in that folder.
    """
    photos = [path for folder in folders for path in sorted(folder.glob("images/*"))]
    found = sorted(pictures.rglob("*")) if pictures else []
    further = [path for path in found if path.suffix.lower() in PHOTO_SUFFIXES]
    if pictures and not further:
        raise InputError("no picture, expected a folder with some", where=str(pictures))
    sources: list[str | Path] = [*PHOTOS * CROPS, *photos, *further * CROPS]
    chosen = (_picture(sources[i]) for i in rng.permutation(len(sources)))
    readable = (picture for picture in chosen if picture is not None)
    crops = [_crop(picture, rng) for picture in islice(readable, (2 * count) // 3)]
    patterns = [_PATTERNS[rng.integers(len(_PATTERNS))](rng) for _ in range(count - len(crops))]
    return np.stack([*crops, *(np.clip(pattern, 0, 255).astype(np.uint8) for pattern in patterns)])


def _picture(source: str | Path) -> NDArray | None:
    """(H, W, 3) uint8 of a file, or of one of `PHOTOS`; None where it cannot be read."""
    try:
        if isinstance(source, Path):
            return read_image(source)
        import skimage.data

        picture = np.asarray(getattr(skimage.data, source)())
    except Exception:  # broken; or scikit-image is not installed, or wants pooch and a network, in many ways
        return None
    return picture[..., :3] if picture.ndim == 3 else np.repeat(picture[..., None], 3, axis=2)


def _crop(picture: NDArray, rng: np.random.Generator) -> NDArray:
    """(SIZE, SIZE, 3) uint8 of a picture, at some scale."""
    shorter = min(picture.shape[:2])
    scale = rng.integers(SIZE, max(SIZE, min(shorter, LARGEST_SIDE)) + 1) / shorter
    height, width = (max(SIZE, round(scale * size)) for size in picture.shape[:2])
    top, left = rng.integers(0, (height - SIZE + 1, width - SIZE + 1))
    scaled = resize_cover(picture, height, width)[top : top + SIZE, left : left + SIZE]
    return (255 * scaled).round().astype(np.uint8)


def _colour(rng: np.random.Generator) -> NDArray:
    return rng.random(3) * 255


def _octaves(rng: np.random.Generator) -> NDArray:
    """Smooth noise of several scales."""
    total = np.zeros((SIZE, SIZE, 3))
    for cells in (3, 6, 12, 24, 48):
        corners = rng.random((cells + 1, cells + 1, 3))
        at = np.linspace(0, cells - 1e-6, SIZE)
        i, f = at.astype(int), (at % 1)[:, None]
        rows = corners[i] * (1 - f[:, :, None]) + corners[i + 1] * f[:, :, None]
        total += rng.random() * (rows[:, i] * (1 - f[None]) + rows[:, i + 1] * f[None])
    return total / total.max() * 255


def _stripes(rng: np.random.Generator) -> NDArray:
    """Two colours in parallel stripes, the repeated structure that matching gets lost in."""
    y, x = np.mgrid[:SIZE, :SIZE]
    angle = rng.random() * np.pi
    wave = np.sin((x * np.cos(angle) + y * np.sin(angle)) * rng.uniform(0.15, 1.0))[..., None]
    return np.where(wave > rng.uniform(-0.7, 0.7), _colour(rng), _colour(rng))


def _checks(rng: np.random.Generator) -> NDArray:
    """Tiles with joints."""
    y, x = np.mgrid[:SIZE, :SIZE]
    side, joint = rng.integers(6, 40), rng.integers(1, 3)
    is_joint = ((x % side < joint) | (y % side < joint))[..., None]
    shade = rng.normal(0, rng.uniform(0, 12), (SIZE // side + 1, SIZE // side + 1))[y // side, x // side][..., None]
    return np.where(is_joint, _colour(rng), _colour(rng) + shade)


def _blank(rng: np.random.Generator) -> NDArray:
    """One colour with hardly any grain, and a slow gradient: walls and skies."""
    gradient = np.linspace(-1, 1, SIZE)[:, None, None] * rng.uniform(0, 25)
    return _colour(rng) + gradient + rng.normal(0, rng.uniform(0, 5), (SIZE, SIZE, 1))


def _patches(rng: np.random.Generator) -> NDArray:
    """Rectangles of plain colour on one another."""
    picture = np.tile(_colour(rng), (SIZE, SIZE, 1))
    for _ in range(rng.integers(5, 60)):
        (x, y), (w, h) = rng.integers(0, SIZE, 2), rng.integers(3, 50, 2)
        picture[y : y + h, x : x + w] = _colour(rng)
    return picture


_PATTERNS = (_octaves, _stripes, _checks, _blank, _patches)
