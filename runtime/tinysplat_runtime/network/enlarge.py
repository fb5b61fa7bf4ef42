"""Large photos: a network finds surfaces on small copies, and the graph `enlarge` brings them to every pixel.

A network's time and memory grow with the pixels, and a photo of several megapixels shows no more surfaces than one of
a quarter. So the network's cost is bounded here, and what grows is one cheap graph, run on tiles so that its memory
does not. Between a small and a far larger size lie others, each at most twice the one before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, log2, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ModelError
from ..gaussian.gaussians import FIELDS, Gaussians
from ..gaussian.sh import C0
from ..graphs.inference import Graph, as_input
from ..scene.cameras import Camera
from ..scene.resampling import scaled
from .predict import NetworkLimits, checked_inputs, mean_centre, predict

LARGE_PIXELS = 640 * 480
"""Photos of more are large: networks learned from photos of a third as many, and find fewer of the same places in
larger ones."""

TILE_SIDE = 448
"""Most rows and columns of a tile. What lies beside it is worked on twice, 15 % at this size, and 1.4 KB are taken for
each pixel while it is at work."""

BLUR = 9
"""Side of the box, small pixels, over which a network's change of colour is a tint and no longer detail."""

LEAST_CONTRAST = 1e-4
"""Variance that is added to a photo's where its exposure is sought: a photo without contrast has none."""

LEAST_BASELINE = 1e-3
"""Distance of cameras, in near planes, below which they are taken to be as far apart as that."""


@dataclass(frozen=True)
class Enlarger:
    """The graph `enlarge`, and what its file says about itself.

    Attributes:
        graph: the opened artifact.
        networks: names of those whose Gaussians it can make anew.
        pixels: of the photos that they are given in place of large ones, about.
        halo: rows and columns about a tile on which its own depend.
        tile: most rows and columns of a tile.
    """

    graph: Graph
    networks: tuple[str, ...]
    pixels: int
    halo: int
    tile: int = TILE_SIDE

    @classmethod
    def of(cls, graph: Graph) -> Enlarger:
        """Read its metadata; ModelError if that is damaged."""
        metadata: Any = graph.metadata
        try:
            pixels, halo = int(metadata["pixels"]), int(metadata["halo"])
            networks = tuple(str(name) for name in metadata["networks"])
        except (KeyError, TypeError, ValueError) as error:
            raise ModelError(f"metadata lacks {error}", where=graph.name) from None
        if not (0 < pixels <= LARGE_PIXELS and halo > 0):
            accepted = f"expected 1 to {LARGE_PIXELS} pixels and a halo"
            raise ModelError(f"metadata says {pixels} pixels and a halo of {halo}, {accepted}", where=graph.name)
        return cls(graph, networks, pixels, halo)


def predict_large(
    images: NDArray, cameras: Sequence[Camera], near: float, far: float, network: Graph, enlarger: Enlarger
) -> Gaussians:
    """As `predict.predict`, of photos on which the network does not run itself; arguments and errors are its.

    The first layer has the photos' size, further ones that of a network on small photos.
    """
    limits = NetworkLimits.of(network)
    photos = [checked_inputs(images, cameras, near, far, limits)]
    del images  # where the caller keeps none, photos go as soon as they have served
    for height, width in reversed(_sizes(photos[0].shape[1:3], limits, enlarger.pixels)):
        photos.append(np.stack([scaled(image, height, width) for image in photos[-1]]))
    gaussians = predict(photos[-1], _sized(cameras, photos[-1]), near, far, network)
    if gaussians.sh.shape[3] != 1:
        raise ModelError("view-dependent colours, which cannot be enlarged", where=network.name)
    origin, behind = gaussians.origin, gaussians.extra_layers
    while len(photos) > 1:
        maps, exposure = _looked_up(gaussians, photos.pop())
        del gaussians
        sized, exposed = _sized(cameras, photos[-1]), _exposed(photos[-1], exposure)
        if len(photos) == 1:
            photos.clear()
        gaussians = _enlarged(origin, maps, exposed, sized, near, enlarger)
    return replace(gaussians, cameras=tuple(cameras), extra_layers=behind)


def _looked_up(predicted: Gaussians, small: NDArray) -> tuple[list[NDArray], list[tuple[NDArray, NDArray]]]:
    """Of small photos (V, h, w, 3), a view each: what its `_maps` are, and `_exposure`."""
    exposure = [_exposure(image, seen) for image, seen in zip(small, _colours(predicted), strict=True)]
    pairs = enumerate(zip(small, exposure, strict=True))
    return [_maps(predicted, image * gain + offset, view) for view, (image, (gain, offset)) in pairs], exposure


def _sizes(large: tuple[int, ...], limits: NetworkLimits, pixels: int) -> list[tuple[int, int]]:
    """(height, width) that a network runs on, in whole strides, and those between it and `large`."""
    share = sqrt(pixels / (large[0] * large[1]))
    least = -(-limits.min_side // limits.stride)
    small = [max(round(side * share / limits.stride), least) * limits.stride for side in large]
    steps = max(ceil(log2(1 / share) - 0.1), 1)
    ladder = [[round(a * (b / a) ** (i / steps)) for a, b in zip(small, large, strict=True)] for i in range(steps)]
    return [(height, width) for height, width in ladder]


def _sized(cameras: Sequence[Camera], images: NDArray) -> list[Camera]:
    """The cameras of photos that were stretched to those sizes."""
    height, width = images.shape[1:3]
    return [Camera(camera.K_unit * [[width], [height], [1]], camera.c2w, width, height) for camera in cameras]


def _exposed(photos: NDArray, exposure: Sequence[tuple[NDArray, NDArray]]) -> NDArray:
    """Photos (V, H, W, 3) in the exposure that a network gave small ones, as (V, 3, H, W)."""
    planar = np.ascontiguousarray(photos.transpose(0, 3, 1, 2))
    for photo, (gain, offset) in zip(planar, exposure, strict=True):
        photo *= gain[:, None, None]
        photo += offset[:, None, None]
        photo.clip(0, 1, out=photo)
    return planar


def _enlarged(
    origin: NDArray,
    maps: Sequence[NDArray],
    photos: NDArray,
    cameras: Sequence[Camera],
    near: float,
    enlarger: Enlarger,
) -> Gaussians:
    """Gaussians (V, H, W, …) about `origin` of exposed large photos (V, 3, H, W), from `_maps` of small ones."""
    views, _, height, width = photos.shape
    arrays: dict[str, Any] = {
        name: np.empty((views, height, width, *tail), np.float32) for name, tail in _SHAPES.items()
    }
    middle = mean_centre(cameras)
    down, across = (_spans(side, enlarger.halo, enlarger.tile) for side in (height, width))
    tiles = [(rows, columns) for rows in down for columns in across]
    for view in range(views):
        fixed = _fixed_inputs(photos, cameras, view, middle, near)
        for rows, columns in tiles:
            tile = _tile_inputs(photos[view], maps[view], cameras[view], rows.worked_on, columns.worked_on)
            is_last = view == views - 1 and (rows, columns) == tiles[-1]
            values = replace(enlarger.graph, lets_go=is_last).run({**fixed, **tile}, tuple(arrays))
            for name, array in arrays.items():
                array[view, rows.kept, columns.kept] = values[name][0, rows.within, columns.within]
    arrays["means"] += (middle - origin).astype(np.float32)
    return Gaussians(**arrays, cameras=tuple(cameras), origin=origin)


@dataclass(frozen=True)
class _Span:
    """Rows or columns of a tile: those that are kept, those beside them with which they are worked on, and the former
    among the latter.
    """

    kept: slice
    worked_on: slice
    within: slice


def _spans(length: int, halo: int, most: int) -> list[_Span]:
    """Tiles of about equal sides along an axis."""
    count = -(-length // most)
    ends = [round(length * i / count) for i in range(count + 1)]
    spans = []
    for first, last in pairwise(ends):
        worked_on = slice(max(first - halo, 0), min(last + halo, length))
        within = slice(first - worked_on.start, last - worked_on.start)
        spans.append(_Span(slice(first, last), worked_on, within))
    return spans


_SHAPES = {name: tuple(abs(n) for n in trailing) for name, trailing in FIELDS.items()}
"""Trailing shapes of the arrays at SH degree 0, which has one basis function."""


def _fixed_inputs(
    photos: NDArray, cameras: Sequence[Camera], view: int, middle: NDArray, near: float
) -> dict[str, NDArray]:
    """What all tiles of a view are given: its pose, and the nearest other photos, four at most."""
    own, count = cameras[view], len(cameras)
    distance = np.array([np.linalg.norm(camera.centre - own.centre) for camera in cameras])
    distance[view] = np.inf
    nearest = np.argsort(distance, kind="stable")[: count - 1 - count // 6]  # as tinysplat.networks.pairs has it
    baseline = max(float(distance[nearest].mean()), LEAST_BASELINE * near)
    c2w = np.eye(4)
    c2w[:3, :3], c2w[:3, 3] = own.rotation.T, own.centre - middle
    others = [cameras[i] for i in nearest]
    return {
        "c2w": as_input(c2w[None]),
        "sources": photos[nearest] if len(nearest) > 1 else photos[nearest[0]][None],  # the latter is no copy
        "source_K": as_input([other.K_unit for other in others]),
        "rotation": as_input([other.rotation @ own.rotation.T for other in others]),
        "translation": as_input([other.rotation @ (own.centre - other.centre) for other in others]),
        "unit": as_input(1 / (own.focal * baseline)),
    }


def _tile_inputs(photo: NDArray, maps: NDArray, camera: Camera, rows: slice, columns: slice) -> dict[str, NDArray]:
    """What a tile of a view is given: its pixels, their camera, and the small pixels about them."""
    K = camera.K.copy()
    K[0, 2] -= columns.start
    K[1, 2] -= rows.start
    small_rows, near_rows = _among_small(camera.height, maps.shape[1], rows)
    small_columns, near_columns = _among_small(camera.width, maps.shape[2], columns)
    return {
        "photo": np.ascontiguousarray(photo[None, :, rows, columns]),
        "small": np.ascontiguousarray(maps[None, :, near_rows, near_columns]),
        "rows": small_rows,
        "columns": small_columns,
        "K": as_input(K[None]),
    }


def _among_small(large: int, small: int, span: slice) -> tuple[NDArray, slice]:
    """Where centres of a span of `large` pixels lie among the small ones about them, and which of `small` these are."""
    places = (np.arange(span.start, span.stop) + 0.5) * (small / large) - 0.5
    near = slice(max(int(places[0]) - 2, 0), int(places[-1]) + 3)
    return as_input(places - near.start), near


def _colours(gaussians: Gaussians) -> NDArray:
    """(V, h, w, 3) colours of SH degree 0."""
    return np.float32(0.5) + np.float32(C0) * gaussians.sh[:, :, :, 0]


def _exposure(photo: NDArray, colours: NDArray) -> tuple[NDArray, NDArray]:
    """Gain and offset (3,) per channel that make a small photo look like what a network made of it, both (h, w, 3).

    A line through blurred colours, so that sharpening is no gain.
    """
    x, y = _blurred(photo), _blurred(colours)
    mean_x, mean_y = x.mean(axis=(0, 1)), y.mean(axis=(0, 1))
    covariance = ((x - mean_x) * (y - mean_y)).mean(axis=(0, 1))
    gain = (covariance + LEAST_CONTRAST) / (((x - mean_x) ** 2).mean(axis=(0, 1)) + LEAST_CONTRAST)
    gain = gain.clip(0.25, 4)
    return gain.astype(np.float32), (mean_y - gain * mean_x).astype(np.float32)


def _maps(gaussians: Gaussians, photo: NDArray, view: int) -> NDArray:
    """(9, h, w) of a view: colours of its photo (h, w, 3) in the network's exposure, and what it is to be given."""
    camera = gaussians.cameras[view]
    shift = gaussians.origin - camera.centre
    depth = (gaussians.means[view] + shift) @ camera.rotation[2]
    footprint = gaussians.scales[view, :, :, 2] * (camera.focal / depth)
    photo = photo.clip(0, 1)
    change = _blurred(_colours(gaussians)[view] - photo)
    maps = [photo, 1 / depth[..., None], gaussians.opacities[view, :, :, None], footprint[..., None], change]
    return as_input(np.concatenate(maps, axis=2).transpose(2, 0, 1))


def _blurred(image: NDArray) -> NDArray:
    """Mean over `BLUR` × `BLUR` pixels of (h, w, 3), borders repeated; float64."""
    for axis in (0, 1):
        grow = [(0, 0)] * 3
        grow[axis] = (BLUR // 2 + 1, BLUR // 2)
        sums = np.cumsum(np.pad(image, grow, mode="edge"), axis=axis, dtype=np.float64)
        length = image.shape[axis]
        later, before = (np.take(sums, range(at, at + length), axis=axis) for at in (BLUR, 0))
        image = (later - before) / BLUR
    return image
