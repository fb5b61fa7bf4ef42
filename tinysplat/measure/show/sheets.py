"""Two pictures, or two sets of Gaussians, side by side, with maps of their error.

Maps are the mean absolute difference over the colours of a pixel, all of one sheet on one scale.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import Renderer, between
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.images import read_image
from tinysplat_runtime.scene.pictures import to_uint8
from tinysplat_runtime.system.decibels import CEILING
from tinysplat_runtime.system.evenly import evenly
from tinysplat_runtime.system.files import atomic_path
from tinysplat_runtime.system.jsonfields import JsonObject
from tinysplat_runtime.system.told import NOBODY, Told

from ..metrics import psnr, ssim

MAX_ROWS = 8
"""Rows of a sheet; more go on a next one."""

MOST_VIEWS = 12
"""Cameras that two sets of Gaussians are drawn from."""

MOST_PIXELS = 800
"""Across the pictures that they are drawn in, unless told a size: what photos have more of, no sheet needs."""

_GAP = 4
_SCALE_PERCENTILE = 99.5


@dataclass(frozen=True, eq=False)
class SheetPicture:
    """One picture of a sheet.

    Attributes:
        label: which view it is.
        a, b: (H, W, 3) in [0, 1], equal sizes.
    """

    label: str
    a: NDArray
    b: NDArray

    def scores(self) -> JsonObject:
        """PSNR and SSIM of b against a."""
        return {"view": self.label, "psnr_b_to_a": psnr(self.b, self.a), "ssim_b_to_a": ssim(self.b, self.a)}

    def error(self) -> NDArray:
        """(H, W) float64 mean absolute difference over the colours."""
        return np.abs(np.asarray(self.b, np.float64) - self.a).mean(axis=-1)


@dataclass(frozen=True, eq=False)
class Sheet:
    """Rows that belong together."""

    title: str
    rows: tuple[SheetPicture, ...]


def picture_sheet(a: Path, b: Path) -> Sheet:
    """Two image files of one size."""
    images = [_read(path) for path in (a, b)]
    if images[0].shape != images[1].shape:
        (h0, w0, _), (h1, w1, _) = (image.shape for image in images)
        raise InputError(f"{w1}x{h1} pixels, but {a} has {w0}x{h0}", where=str(b))
    return Sheet(f"A: {a.name}   B: {b.name}", (SheetPicture(a.stem, images[0], images[1]),))


def gaussian_sheet(
    pair: tuple[Gaussians, Gaussians],
    names: tuple[str, str],
    cameras: Sequence[Camera],
    size: tuple[int, int] | None,
    told: Told = NOBODY,
) -> Sheet:
    """Two sets of Gaussians from the same cameras, some evenly of many, and midway between; `told` counts them.

    Pictures are of `size`, (H, W), or as large as the first camera's, but no larger than `MOST_PIXELS` across.
    """
    numbers = evenly(len(cameras), MOST_VIEWS)
    path = between([cameras[number] for number in numbers], 2 * len(numbers) - 1)
    size = size or _size(cameras[0])
    labels = [f"view {numbers[0]}"]
    for first, second in pairwise(numbers):
        labels += [f"between {first} and {second}", f"view {second}"]
    renderers = [Renderer(one) for one in pair]
    images = [[of.render(camera, size) for of in renderers] for camera in told.progress("drawing", path)]
    rows = tuple(SheetPicture(label, *both) for label, both in zip(labels, images, strict=True))
    return Sheet(f"A: {names[0]}   B: {names[1]}", rows)


def _size(camera: Camera) -> tuple[int, int]:
    scale = min(1, MOST_PIXELS / max(camera.height, camera.width))
    return round(scale * camera.height), round(scale * camera.width)


def write_sheet(folder: Path, sheet: Sheet, told: Told = NOBODY) -> list[Path]:
    """Write a sheet as PNG, in parts of MAX_ROWS rows, which `told` counts; the files' paths."""
    parts = [sheet.rows[i : i + MAX_ROWS] for i in range(0, len(sheet.rows), MAX_ROWS)]
    paths = [folder / f"comparison{f'-{n + 1}' if len(parts) > 1 else ''}.png" for n in range(len(parts))]
    for path, rows in told.progress("writing sheets", list(zip(paths, parts, strict=True))):
        _draw(path, sheet.title, rows)
    return paths


def _draw(path: Path, title: str, rows: Sequence[SheetPicture]) -> None:
    """All pixels as they are: a figure of so many axes would take matplotlib far longer than they took to draw."""
    from matplotlib import colormaps
    from PIL import Image, ImageDraw, ImageFont

    errors = [row.error() for row in rows]
    limit = max(float(np.percentile(errors, _SCALE_PERCENTILE)), 1 / 255)
    height, width = rows[0].a.shape[:2]
    text = min(max(width // 20, 9), 40)
    line = text + text // 2
    size = 3 * (width + _GAP), 2 * line + len(rows) * (height + 2 * line)
    sheet, colours, font = Image.new("RGB", size, "white"), colormaps["magma"], ImageFont.load_default(text)
    pen = ImageDraw.Draw(sheet)
    pen.text((0, 0), f"{title}   errors from 0 (black) to {limit:.3f} (white)", "black", font)
    for number, (row, error) in enumerate(zip(rows, errors, strict=True)):
        top = 2 * line + number * (height + 2 * line)
        captions = f"{row.label}   A", "B", f"|B - A|  {_decibel(row.b, row.a)}"
        shown = row.a, row.b, colours(np.clip(error / limit, 0, 1))[..., :3]
        for column, (caption, image) in enumerate(zip(captions, shown, strict=True)):
            left = column * (width + _GAP)
            pen.text((left, top), caption, "black", font)
            sheet.paste(Image.fromarray(to_uint8(image)), (left, top + line))
    with atomic_path(path) as temporary:
        sheet.save(temporary, format="png", compress_level=4)  # 6, the default, takes twice as long for 1/4 fewer bytes


def _read(path: Path) -> NDArray:
    """A picture's (H, W, 3) float32 in [0, 1]."""
    return read_image(path).astype(np.float32) / np.float32(255)


def _decibel(image: NDArray, reference: NDArray) -> str:
    value = psnr(image, reference)
    return f"{value:.2f} dB" if value < CEILING else "identical"
