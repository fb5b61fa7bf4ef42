"""Large photos: a network finds surfaces on small copies, and the graph `enlarge` brings them to every pixel.

A network's time and memory grow with the pixels, and a photo of several megapixels shows no more surfaces than one of
a quarter. So the network's cost is bounded here, and what grows is one cheap graph, run on strips of rows so that its
memory does not. Between a small and a far larger size lie others, each at most twice the one before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, log2, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ModelError
from ..gaussian.gaussians import FIELDS, Gaussians
from ..gaussian.sh import C0
from ..scene.cameras import Camera
from ..scene.images import scaled
from .inference import Graph, as_input
from .predict import Limits, checked_inputs, predict

LARGE_PIXELS = 640 * 480
"""Photos of more are large: networks learned from photos of a third as many, and find fewer of the same places in
larger ones."""

STRIP_PIXELS = 1 << 17
"""About as many pixels has a strip, for each of which 1.4 KB are taken while it is at work."""

STRIP_HALOS = 4
"""A strip has at least as many times the rows that it needs beside it: more would be done twice."""

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
        halo: rows beside a strip on which its own depend.
    """

    graph: Graph
    networks: tuple[str, ...]
    pixels: int
    halo: int

    @classmethod
    def of(cls, graph: Graph) -> Enlarger:
        """Read its metadata; ModelError if that is damaged."""
        found: Any = graph.metadata
        try:
            pixels, halo = int(found["pixels"]), int(found["halo"])
            networks = tuple(str(name) for name in found["networks"])
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
    images = checked_inputs(images, cameras, near, far, Limits.of(network))
    photos = [images]
    for height, width in reversed(_sizes(images.shape[1:3], Limits.of(network), enlarger.pixels)):
        photos.append(np.stack([scaled(image, height, width) for image in photos[-1]]))
    small = photos.pop()
    found = predict(small, _sized(cameras, small), near, far, network)
    if found.sh.shape[3] != 1:
        raise ModelError("view-dependent colours, which cannot be enlarged", where=network.name)
    while photos:
        large = photos.pop()
        found = _enlarged(found, small, large, _sized(cameras, large), near, enlarger)
        small = large
    return replace(found, cameras=tuple(cameras))


def _sizes(large: tuple[int, ...], limits: Limits, pixels: int) -> list[tuple[int, int]]:
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


def _enlarged(
    found: Gaussians, small: NDArray, large: NDArray, cameras: Sequence[Camera], near: float, enlarger: Enlarger
) -> Gaussians:
    """Gaussians (V, H, W, …) of large photos from those (V, h, w, …) of small ones; further layers stay."""
    views, height, width = large.shape[:3]
    gain, offset = np.stack([_exposure(image, g) for image, g in zip(small, _colours(found), strict=True)], axis=1)
    photos = np.ascontiguousarray(large.transpose(0, 3, 1, 2))
    for photo, a, b in zip(photos, gain, offset, strict=True):
        photo *= a[:, None, None]
        photo += b[:, None, None]
        photo.clip(0, 1, out=photo)
    arrays = {name: np.empty((views, height, width, *tail), np.float32) for name, tail in _SHAPES.items()}
    middle = np.stack([camera.centre for camera in cameras]).mean(axis=0)
    for view in range(views):
        maps = _maps(found, small[view] * gain[view] + offset[view], view)
        fixed = _fixed_inputs(photos, maps.shape[2], cameras, view, middle, near)
        for first in range(0, height, rows := max(STRIP_PIXELS // width, STRIP_HALOS * enlarger.halo)):
            last = min(first + rows, height)
            above, below = max(first - enlarger.halo, 0), min(last + enlarger.halo, height)
            strip = _strip_inputs(photos[view], maps, cameras[view], above, below)
            is_last = view == views - 1 and last == height
            values = replace(enlarger.graph, lets_go=is_last).run({**fixed, **strip}, tuple(arrays))
            for name, array in arrays.items():
                array[view, first:last] = values[name][0, first - above : last - above]
    arrays["means"] += (middle - found.origin).astype(np.float32)
    return Gaussians(
        arrays["means"], arrays["quats"], arrays["scales"], arrays["opacities"], arrays["sh"],
        cameras=tuple(cameras), origin=found.origin, extra_layers=found.extra_layers,
    )  # fmt: skip


_SHAPES = {name: tuple(abs(n) for n in trailing) for name, trailing in FIELDS.items()}
"""Trailing shapes of the arrays at SH degree 0, which has one basis function."""


def _fixed_inputs(
    photos: NDArray, small_width: int, cameras: Sequence[Camera], view: int, middle: NDArray, near: float
) -> dict[str, NDArray]:
    """What all strips of a view are given: its columns, its pose, and the nearest other photos, four at most."""
    own, count = cameras[view], len(cameras)
    distance = np.array([np.linalg.norm(camera.centre - own.centre) for camera in cameras])
    distance[view] = np.inf
    nearest = np.argsort(distance, kind="stable")[: count - 1 - count // 6]  # as tinysplat.networks.pairs has it
    baseline = max(float(distance[nearest].mean()), LEAST_BASELINE * near)
    c2w = np.eye(4)
    c2w[:3, :3], c2w[:3, 3] = own.rotation.T, own.centre - middle
    width, others = photos.shape[3], [cameras[i] for i in nearest]
    return {
        "columns": _positions(width, small_width, 0, width),
        "c2w": as_input(c2w[None]),
        "sources": photos[nearest],
        "source_K": as_input([other.K_unit for other in others]),
        "rotation": as_input([other.rotation @ own.rotation.T for other in others]),
        "translation": as_input([other.rotation @ (own.centre - other.centre) for other in others]),
        "unit": as_input(1 / (own.focal * baseline)),
    }


def _strip_inputs(photo: NDArray, maps: NDArray, camera: Camera, above: int, below: int) -> dict[str, NDArray]:
    """What the rows `above` to `below` of a view are given: they, their camera, and the small rows about them."""
    K = camera.K.copy()
    K[1, 2] -= above
    rows = _positions(camera.height, maps.shape[1], above, below)
    first = max(int(rows[0]) - 2, 0)
    return {
        "photo": np.ascontiguousarray(photo[None, :, above:below]),
        "small": np.ascontiguousarray(maps[None, :, first : int(rows[-1]) + 3]),
        "rows": rows - np.float32(first),
        "K": as_input(K[None]),
    }


def _positions(large: int, small: int, first: int, last: int) -> NDArray:
    """Where centres `first` to `last` of `large` pixels lie among `small` ones, whose first is centred at 0."""
    return as_input((np.arange(first, last) + 0.5) * (small / large) - 0.5)


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
