"""Two results side by side: pictures, sets of Gaussians, or folders of evaluations, with maps of their error.

Maps are the mean absolute difference over the colours of a pixel, all of one sheet on one scale.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import Renderer, between
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.images import read_image
from tinysplat_runtime.system.decibels import CEILING
from tinysplat_runtime.system.files import atomic_path, read_limited
from tinysplat_runtime.system.jsonfields import JsonObject

from ..metrics import psnr, ssim
from ..rows import PICTURES, RESULTS

MAX_ROWS = 8
"""Rows of a sheet; more go on a next one."""

_TILE_INCHES = 2.4
_SCALE_PERCENTILE = 99.5
_MAX_RESULTS_BYTES = 1 << 30


Result = JsonObject
"""An entry of `scenes` in results.json."""


@dataclass(frozen=True, eq=False)
class SheetPicture:
    """One picture of a sheet.

    Attributes:
        label: which view it is.
        a, b: (H, W, 3) in [0, 1], equal sizes.
        photo: what both are meant to show, or None: then b is held against a.
    """

    label: str
    a: NDArray
    b: NDArray
    photo: NDArray | None = None

    def scores(self) -> JsonObject:
        """PSNR and SSIM of b against a, and of both against the photo."""
        pairs = {"b_to_a": (self.b, self.a)}
        if self.photo is not None:
            pairs |= {"a_to_photo": (self.a, self.photo), "b_to_photo": (self.b, self.photo)}
        scores: JsonObject = {"view": self.label}
        for name, (image, reference) in pairs.items():
            scores[f"psnr_{name}"] = psnr(image, reference)
            scores[f"ssim_{name}"] = ssim(image, reference)
        return scores

    def tiles(self) -> tuple[dict[str, NDArray], dict[str, NDArray]]:
        """Pictures (H, W, 3) float and error maps (H, W) float64 by their captions."""
        pictures = {"A": self.a, "B": self.b}
        if self.photo is None:
            return pictures, {f"|B − A|  {_decibel(self.b, self.a)}": error_map(self.b, self.a)}
        maps = {
            f"|{letter} − photo|  {_decibel(image, self.photo)}": error_map(image, self.photo)
            for letter, image in pictures.items()
        }
        return {"photo": self.photo, **pictures}, maps


@dataclass(frozen=True, eq=False)
class Sheet:
    """Rows that belong together, under one name."""

    name: str
    title: str
    rows: tuple[SheetPicture, ...]


def error_map(image: NDArray, reference: NDArray) -> NDArray:
    """(H, W) float64 mean absolute difference over the colours of (H, W, 3)."""
    return np.abs(np.asarray(image, np.float64) - reference).mean(axis=-1)


def picture_sheet(a: Path, b: Path) -> Sheet:
    """Two image files of one size."""
    images = [_read(path) for path in (a, b)]
    if images[0].shape != images[1].shape:
        (h0, w0, _), (h1, w1, _) = (image.shape for image in images)
        raise InputError(f"{w1}x{h1} pixels, but {a} has {w0}x{h0}", where=str(b))
    return Sheet("comparison", f"A: {a.name}   B: {b.name}", (SheetPicture(a.stem, images[0], images[1]),))


def gaussian_sheet(
    pair: tuple[Gaussians, Gaussians], names: tuple[str, str], cameras: Sequence[Camera], size: tuple[int, int] | None
) -> Sheet:
    """Two sets of Gaussians from the same cameras: each of them, and midway between neighbours."""
    views = len(cameras)
    path = between(cameras, 2 * views - 1)
    labels = [f"view {i // 2}" if i % 2 == 0 else f"between {i // 2} and {i // 2 + 1}" for i in range(len(path))]
    images = [[renderer.render(camera, size) for camera in path] for renderer in map(Renderer, pair)]
    rows = tuple(SheetPicture(*row) for row in zip(labels, *images, strict=True))
    return Sheet("comparison", f"A: {names[0]}   B: {names[1]}", rows)


def result_sheets(a: Path, b: Path) -> list[Sheet]:
    """Windows that two folders of `tinysplat eval --pictures` share, photos with them.

    Raises:
        InputError: a folder holds no results, or no window is in both with pictures.
    """
    records = [[r for r in read_results(folder) if r["pictures"]] for folder in (a, b)]
    for folder, own in zip((a, b), records, strict=True):
        if not own:
            raise InputError("results without pictures; make them with `tinysplat eval --pictures`", where=str(folder))
    sheets = []
    for first, second in matching(*records):
        context = "_".join(map(str, first["context"]))
        name = f"{first['scene']}-{first['kind']}-{context}-{first['profile']}-{first['qp']:g}"
        sheets.append(Sheet(name, _pair_title(first, second), tuple(_result_rows(a, b, first, second))))
    if not sheets:
        raise InputError(f"no window in common with {a}", where=str(b))
    return sheets


def read_results(folder: Path) -> list[Result]:
    """What the last evaluation into a folder has under `scenes`."""
    path = folder / RESULTS
    try:
        document = json.loads(read_limited(path, _MAX_RESULTS_BYTES))
        return [entry for entry in document["scenes"] if entry["bytes"] and (_window(entry), _coding(entry))]
    except (ValueError, TypeError, KeyError) as error:
        raise InputError(f"not results of an evaluation ({error})", where=str(path)) from None


def matching(a: Iterable[Result], b: Iterable[Result]) -> Iterator[tuple[Result, Result]]:
    """Pairs over the same window: of equal model, profile and Q_g, else the only one that each side has."""
    groups: list[dict[Any, list[Result]]] = [{}, {}]
    for group, records in zip(groups, (a, b), strict=True):
        for record in records:
            group.setdefault(_window(record), []).append(record)
    for window, first in groups[0].items():
        second = groups[1].get(window, [])
        if len(first) == 1 and len(second) == 1:
            yield first[0], second[0]
        else:
            codings = {_coding(record): record for record in second}
            yield from ((record, codings[_coding(record)]) for record in first if _coding(record) in codings)


def write_sheet(folder: Path, sheet: Sheet) -> list[Path]:
    """Write a sheet as PNG, in parts of MAX_ROWS rows; the files' paths."""
    safe = "".join(c if c.isalnum() or c in "-_." else "_" for c in sheet.name)
    parts = [sheet.rows[i : i + MAX_ROWS] for i in range(0, len(sheet.rows), MAX_ROWS)]
    paths = [folder / f"{safe}{f'-{n + 1}' if len(parts) > 1 else ''}.png" for n in range(len(parts))]
    for path, rows in zip(paths, parts, strict=True):
        _draw(path, sheet.title, rows)
    return paths


def _draw(path: Path, title: str, rows: Sequence[SheetPicture]) -> None:
    from matplotlib.figure import Figure

    tiles = [row.tiles() for row in rows]
    limit = max(float(np.percentile([[*maps.values()] for _, maps in tiles], _SCALE_PERCENTILE)), 1 / 255)
    columns = sum(map(len, tiles[0]))
    height, width = rows[0].a.shape[:2]
    inches = (columns * _TILE_INCHES + 0.6, len(rows) * (_TILE_INCHES * height / width + 0.3) + 0.5)
    figure = Figure(figsize=inches, dpi=max(72, round(width / _TILE_INCHES)), layout="constrained")
    figure.suptitle(title, fontsize=8)
    axes = figure.subplots(len(rows), columns, squeeze=False)
    for line, row, (pictures, maps) in zip(axes, rows, tiles, strict=True):
        for axis, (caption, image) in zip(line, [*pictures.items(), *maps.items()], strict=True):
            pixels = np.clip(image, 0, 1) if image.ndim == 3 else image
            drawn = axis.imshow(pixels, cmap="magma", vmin=0, vmax=limit, interpolation="nearest")
            axis.set_title(caption, fontsize=7)
            axis.set_xticks([])
            axis.set_yticks([])
        line[0].set_ylabel(row.label, fontsize=7)
    # the last picture of a row is a map, and all have one scale
    figure.colorbar(drawn, ax=axes, shrink=0.6, fraction=0.02, pad=0.01).ax.tick_params(labelsize=6)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png")


def _result_rows(a: Path, b: Path, first: Result, second: Result) -> Iterator[SheetPicture]:
    folders = [folder / PICTURES / record["pictures"] for folder, record in ((a, first), (b, second))]
    for n, target in enumerate(first["targets"]):
        images = [_read(folder / f"{n}_decoded.png") for folder in folders]
        path = folders[0] / f"{n}_photo.png"
        yield SheetPicture(f"frame {target}", images[0], images[1], _read(path) if path.is_file() else None)


def _read(path: Path) -> NDArray:
    """A picture's (H, W, 3) float32 in [0, 1]."""
    return read_image(path).astype(np.float32) / np.float32(255)


def _pair_title(a: Result, b: Result) -> str:
    sides = (f"{r['model']}, {r['profile']} at Q_g {r['qp']:g}, {r['bytes'] / 1000:.0f} KB" for r in (a, b))
    context = ",".join(map(str, a["context"]))
    return f"{a['scene']}, {a['kind']}, {a['views']} views ({context})\n" + "   ".join(
        f"{letter}: {side}" for letter, side in zip("AB", sides, strict=True)
    )


def _window(record: Result) -> tuple[object, ...]:
    names = ("scene", "kind", "context", "targets", "height", "width")
    return tuple(str(record[name]) for name in names)


def _coding(record: Result) -> tuple[str, str, float]:
    return record["model"], record["profile"], record["qp"]


def _decibel(image: NDArray, reference: NDArray) -> str:
    value = psnr(image, reference)
    return f"{value:.2f} dB" if value < CEILING else "identical"
