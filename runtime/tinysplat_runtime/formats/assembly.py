"""Arrays of a file to Gaussians, and Gaussians to the list that most formats hold.

float64 means may not fit float32. Where rounding would move any Gaussian by more than ORIGIN_TOLERANCE of its distance
to the nearest camera (without cameras: of the cloud's size), the mean camera centre (the mean of the means) becomes
the `origin` that they are stored relative to. float32 means are taken as they are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian.gaussians import FIELDS, Gaussians
from ..scene.cameras import Camera, check_is_in_pixels
from . import SH_BITS, SPZ_VERSION

ORIGIN_TOLERANCE = 1e-6
"""Largest rounding of means, relative to the distance from the nearest camera, that needs no origin."""

Contents: TypeAlias = tuple[dict[str, NDArray], Mapping[str, Any]]
"""What a reader gives: arrays by name, and fields of `Notes`."""


@dataclass(frozen=True)
class WriteOptions:
    """What a user may say about how a file is written.

    Attributes:
        sh_bits: for .spz, bits kept of SH coefficients of degree 1 and of higher ones, 1 to 8.
        spz_version: 3 or 4; 4 takes zstandard here and zstd in readers, and keeps SH degree 4.
    """

    sh_bits: tuple[int, int] = SH_BITS
    spz_version: int = SPZ_VERSION


@dataclass(frozen=True)
class PointCloud:
    """Gaussians as formats without pixels, layers and origins hold them.

    Attributes:
        gaussians: (N,), without layers.
        means: (N, 3) float64 world positions.
        is_far: whether float32 would lose digits of them that show.
    """

    gaussians: Gaussians
    means: NDArray
    is_far: bool

    @classmethod
    def of(cls, gaussians: Gaussians) -> PointCloud:
        """All layers of `gaussians` as one list."""
        flat = gaussians.flat()
        means = flat.means.astype(np.float64) + flat.origin
        return cls(flat, means, bool(flat.origin.any()) and _loses_digits(means, _centres(gaussians.cameras)))


def joined(parts: Sequence[Mapping[str, NDArray]]) -> dict[str, NDArray]:
    """Arrays (N, …) of several parts of a file as those of one list; lower SH degrees are padded with zeros."""
    functions = max(part["sh"].shape[1] for part in parts)

    def of(part: Mapping[str, NDArray], name: str) -> NDArray:
        array = part[name]
        return np.pad(array, ((0, 0), (0, functions - array.shape[1]), (0, 0))) if name == "sh" else array

    return {name: np.concatenate([of(part, name) for part in parts]) for name in parts[0]}


def cut_degree_note(gaussians: Gaussians, highest: int, suffix: str) -> list[str]:
    """What to say where a format knows SH up to `highest` alone."""
    degree = max(layer.degree for layer in gaussians.layers)
    if degree <= highest:
        return []
    return [f"SH of degree {degree} cut to {highest}, the highest that readers of {suffix} know"]


def far_note(points: PointCloud) -> list[str]:
    """What to say where a format has no more than float32 for positions."""
    text = "positions lose digits: too far from the world's origin for float; bring the scene nearer first"
    return [text] if points.is_far else []


def without_invalid(arrays: dict[str, NDArray]) -> tuple[dict[str, NDArray], int]:
    """A list of Gaussians, (N, …) each, without those that are none, and how many these were.

    They hold NaN, what float32 cannot, or a rotation of zero: training leaves some now and then, and of some trainers'
    files most. Gaussians that are pixels, or not all of one number, pass as they are.
    """
    lead = arrays["opacities"].shape if "opacities" in arrays else ()
    lists = [arrays[name] for name in FIELDS if name in arrays]
    if len(lead) != 1 or "layer1_means" in arrays or any(array.shape[:1] != lead for array in lists):
        return arrays, 0
    good = np.ones(lead, bool)
    for array in lists:
        good &= (np.abs(array.reshape(len(array), -1)) <= np.finfo(np.float32).max).all(axis=1)
    good &= (arrays["quats"].reshape(len(good), -1) != 0).any(axis=1)
    if good.all() or not good.any():
        return arrays, 0
    return {name: array[good] if name in FIELDS else array for name, array in arrays.items()}, int((~good).sum())


def assemble(
    arrays: Mapping[str, NDArray], grid: tuple[int, int, int] | None, cameras: Sequence[Camera] | None
) -> Gaussians:
    """Gaussians of a file's arrays.

    Args:
        arrays: by name, as `arrays` describes them; means of any real type.
        grid: (V, H, W) that a flat list is the pixels of, or None.
        cameras: one per view where the file holds none.

    Raises:
        InputError: names the array that is missing, of another shape, or out of range.
    """
    prefixes = [""]
    while f"layer{len(prefixes)}_means" in arrays:
        prefixes.append(f"layer{len(prefixes)}_")
    layers = [_layer_fields(arrays, prefix) for prefix in prefixes]
    if grid:
        layers[0] = _on_grid(layers[0], grid)
    views = [
        _layer_cameras(arrays, prefix, fields["opacities"].shape)
        for prefix, fields in zip(prefixes, layers, strict=True)
    ]
    views[0] = views[0] or tuple(cameras or ())
    origin = arrays.get("origin", np.zeros(3)).astype(np.float64)
    if origin.shape != (3,):
        raise InputError(f"shape {origin.shape}, expected (3,)", where="origin")
    means, origin = _place_means([fields["means"] for fields in layers], _centres(views[0]), origin)

    def build(n: int, extra_layers: tuple[Gaussians, ...] = ()) -> Gaussians:
        fields: dict[str, Any] = {**layers[n], "means": means[n]}
        try:
            viewpoints = () if n or views[n] else _viewpoints(arrays)
            return Gaussians(
                **fields, cameras=views[n], origin=origin, extra_layers=extra_layers, viewpoints=viewpoints
            )
        except InputError as error:
            where = f"{prefixes[n]}{error.where}" if error.where else prefixes[n].rstrip("_") or None
            raise InputError(error.message, where=where) from None

    return build(0, tuple(build(n) for n in range(1, len(layers))))


def _layer_fields(arrays: Mapping[str, NDArray], prefix: str) -> dict[str, NDArray]:
    missing = [prefix + name for name in FIELDS if prefix + name not in arrays]
    if missing:
        raise InputError(f"lacks {', '.join(missing)}; expected {', '.join(prefix + name for name in FIELDS)}")
    lead = arrays[f"{prefix}opacities"].shape
    if len(lead) not in (1, 3):
        raise InputError(f"shape {lead}, expected (V, H, W) or (N,)", where=f"{prefix}opacities")
    return {name: arrays[prefix + name] for name in FIELDS}


def _on_grid(fields: Mapping[str, NDArray], grid: tuple[int, int, int]) -> dict[str, NDArray]:
    """Arrays (N, …) as (V, H, W, …); those that already are pass as they are."""
    lead = fields["opacities"].shape
    if lead == tuple(grid):
        return dict(fields)
    if lead != (math.prod(grid),) or any(array.shape[:1] != lead for array in fields.values()):
        raise InputError(f"Gaussians of shape {lead} are not the pixels of a {'x'.join(map(str, grid))} grid")
    return {name: array.reshape(*grid, *array.shape[1:]) for name, array in fields.items()}


def _layer_cameras(arrays: Mapping[str, NDArray], prefix: str, lead: tuple[int, ...]) -> tuple[Camera, ...]:
    """The cameras of a layer of leading shape (V, H, W); () where the file holds none."""
    K, c2w = arrays.get(f"{prefix}K"), arrays.get(f"{prefix}c2w", arrays.get("c2w"))
    if K is None and (c2w is None or prefix):
        return ()
    if K is None or c2w is None:
        raise InputError("c2w without K, expected both or neither" if K is None else f"{prefix}K without c2w")
    if len(lead) != 3:
        raise InputError(f"{prefix}K and c2w, but Gaussians of shape {lead}; give their pixels with --grid V,H,W")
    for name, array, shape in ((f"{prefix}K", K, (lead[0], 3, 3)), (f"{prefix}c2w", c2w, (lead[0], 4, 4))):
        if array.shape != shape:
            raise InputError(f"shape {array.shape}, expected {shape}", where=name)
    cameras = _cameras(prefix, K, c2w, [(lead[2], lead[1])] * lead[0])
    for v, camera in enumerate(cameras):
        check_is_in_pixels(camera, f"{prefix}K[{v}]")
    return cameras


def _viewpoints(arrays: Mapping[str, NDArray]) -> tuple[Camera, ...]:
    """Cameras of a list's photos; () where the file holds none."""
    names = "viewpoint_K", "viewpoint_c2w", "viewpoint_size"
    stored = [arrays[name] for name in names if name in arrays]
    if not stored:
        return ()
    count = len(stored[0]) if stored[0].ndim else 0
    if [array.shape for array in stored] != [(count, 3, 3), (count, 4, 4), (count, 2)]:
        raise InputError(
            f"shapes {[array.shape for array in stored]}, expected (P, 3, 3), (P, 4, 4) and (P, 2)",
            where=", ".join(names),
        )
    K, c2w, sizes = stored
    whole = [[int(side) if float(side).is_integer() else -1 for side in size] for size in sizes]
    return _cameras("viewpoint_", K, c2w, whole)


def _cameras(prefix: str, K: NDArray, c2w: NDArray, sizes: Sequence[Sequence[int]]) -> tuple[Camera, ...]:
    """Cameras of K (V, 3, 3), c2w (V, 4, 4) and sizes, width and height; errors name the array and the view."""
    cameras = []
    for v, (width, height) in enumerate(sizes):
        try:
            cameras.append(Camera(K[v], c2w[v], width, height))
        except InputError as error:
            raise InputError(error.message, where=f"{prefix}{error.where}[{v}]") from None
    return tuple(cameras)


def _centres(cameras: Sequence[Camera]) -> NDArray:
    return np.array([camera.centre for camera in cameras]).reshape(-1, 3)


def _place_means(means: Sequence[NDArray], centres: NDArray, origin: NDArray) -> tuple[list[NDArray], NDArray]:
    """Means of all layers as float32 relative to the origin returned, which moves only where digits would be lost."""
    points = [array.reshape(-1, array.shape[-1] if array.ndim else 1) for array in means]
    shift = np.zeros(3)
    with np.errstate(over="ignore", invalid="ignore"):  # Gaussians will name what is not finite
        if all(p.shape[1] == 3 and p.size for p in points) and any(
            array.dtype == np.float64 and _loses_digits(p, centres - origin)
            for array, p in zip(means, points, strict=True)
        ):
            shift = np.mean(centres, axis=0) - origin if len(centres) else np.mean(points[0], axis=0, dtype=np.float64)
        if shift.any() and np.isfinite(shift).all():
            means, origin = [array - shift for array in means], origin + shift
        return [array.astype(np.float32) for array in means], origin


def _loses_digits(points: NDArray, centres: NDArray) -> bool:
    """Whether float32 moves one of (N, 3) float64 points too far to pass; centres (V, 3) in the same frame."""
    moved = np.abs(points - points.astype(np.float32)).max(axis=1)
    if len(centres):
        reach = np.min([np.linalg.norm(points - centre, axis=1) for centre in centres], axis=0)
    else:
        reach = np.linalg.norm(points - points.mean(axis=0), axis=1).max()
    return bool((moved > ORIGIN_TOLERANCE * reach).any())
