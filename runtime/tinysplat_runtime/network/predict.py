"""Photos and cameras in, Gaussians out: the host side of every network artifact.

What a graph cannot do well stands here: checks that name the view at fault, the origin in float64, padding to the
network's stride, and the way back to layers with cameras. Contract: docs/MODELS.md, role `network`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, ModelError, NumericError
from ..gaussian.gaussians import FIELDS, Gaussians
from ..graphs.inference import Graph, as_input
from ..scene.cameras import Camera, check_depth

FAR_FROM_ORIGIN = 128.0
"""Camera centres beyond this many near planes from the world's origin keep an origin of their own: one float32 ulp of
a mean at that distance is 1.5e-5 of the near depth, a hundredth of a pixel for a focal length of 600 pixels."""

SAME_POSE = 1e-6
"""Two views closer than this, in near planes and as |R₁ − R₂|, are one view given twice."""

MAX_SIDE = 4096
"""Largest stride and least side that a network may ask for: photos are grown to them before it runs."""


@dataclass(frozen=True)
class NetworkLimits:
    """What a network takes, from its metadata; a graph that says nothing takes 2 to 6 views of any size.

    Attributes:
        min_views, max_views: accepted numbers of views.
        stride: H and W of its input are multiples of it.
        min_side: smallest H and W of its input.
    """

    min_views: int = 2
    max_views: int = 6
    stride: int = 1
    min_side: int = 1

    @classmethod
    def of(cls, graph: Graph) -> NetworkLimits:
        """Read them from an opened graph; ModelError if one is not a whole number from 1 to MAX_SIDE."""
        values = {name: graph.metadata.get(name, default) for name, default in vars(cls()).items()}
        for name, value in values.items():
            if not isinstance(value, int) or isinstance(value, bool) or not 1 <= value <= MAX_SIDE:
                fault, accepted = str(value)[:40], f"whole numbers from 1 to {MAX_SIDE}"
                raise ModelError(f"metadata '{name}' is {fault}, accepted are {accepted}", where=graph.name)
        if values["min_views"] > values["max_views"]:
            fault = f"{values['min_views']} to {values['max_views']} views"
            raise ModelError(f"metadata says {fault}, expected min_views <= max_views", where=graph.name)
        return cls(**values)


def predict(images: NDArray, cameras: Sequence[Camera], near: float, far: float, graph: Graph) -> Gaussians:
    """Run a network on posed photos.

    Args:
        images: (V, H, W, 3) float32 RGB in [0, 1].
        cameras: one per image, of its size.
        near, far: z of the nearest and the farthest surface, scene units, 0 < near < far.
        graph: an opened network (`inference.GraphStore.network`).

    Returns:
        Per-pixel Gaussians of the photos' size with their cameras; further layers in `extra_layers`, each with the
        same poses and its own K. `origin` is zero unless a camera stands farther than `FAR_FROM_ORIGIN` near planes
        from the world's origin; then it is the mean camera centre.

    Raises:
        InputError: sizes, values, near and far, or the number or poses of views are not acceptable.
        NumericError: the network returned values that are not finite.
        ModelError: the graph failed, or its outputs have shapes outside the contract.
    """
    outputs = graph.run(network_inputs(images, cameras, near, far, NetworkLimits.of(graph)))
    return assembled(outputs, cameras, near, graph.name)


def network_inputs(
    images: NDArray, cameras: Sequence[Camera], near: float, far: float, limits: NetworkLimits
) -> dict[str, NDArray]:
    """What a network's graph is fed with: checked, padded to its stride, and about the mean camera centre.

    Arguments and errors are those of `predict`; names and shapes of the result those of docs/MODELS.md.
    """
    images = checked_inputs(images, cameras, near, far, limits)
    grown, K_unit = padded(images, cameras, limits)
    c2w = np.stack([camera.c2w for camera in cameras])
    c2w[:, :3, :3] = np.stack([camera.rotation.T for camera in cameras])
    c2w[:, :3, 3] -= mean_centre(cameras)
    return {
        "images": as_input(grown.transpose(0, 3, 1, 2)),
        "K": as_input(K_unit),
        "c2w": as_input(c2w),
        "near": np.full(len(cameras), near, np.float32),
        "far": np.full(len(cameras), far, np.float32),
    }


def checked_inputs(
    images: NDArray, cameras: Sequence[Camera], near: float, far: float, limits: NetworkLimits
) -> NDArray:
    """The photos, (V, H, W, 3) float32, once they and their cameras are what a network takes; errors of `predict`."""
    images = _checked_images(images, cameras, limits)
    _check_range(near, far)
    _check_poses(cameras, near)
    return images


def mean_centre(cameras: Sequence[Camera]) -> NDArray:
    """(3,) float64: where a network's own origin lies in the world."""
    return np.stack([camera.centre for camera in cameras]).mean(axis=0)


def origin_of(cameras: Sequence[Camera], near: float) -> NDArray:
    """(3,) float64: the world's own, or the mean centre of cameras of which one stands far from it; see `predict`."""
    is_far = max(float(np.linalg.norm(camera.centre)) for camera in cameras) > FAR_FROM_ORIGIN * near
    return mean_centre(cameras) if is_far else np.zeros(3)


def _checked_images(images: NDArray, cameras: Sequence[Camera], limits: NetworkLimits) -> NDArray:
    try:
        images = as_input(images)
    except (TypeError, ValueError):
        raise InputError("not one array of numbers; all photos must have one size", where="images") from None
    if images.ndim != 4 or images.shape[3] != 3 or 0 in images.shape:
        raise InputError(f"shape {images.shape}, expected (V, H, W, 3)", where="images")
    views = len(images)
    if views == 1 and limits.min_views == 2:
        raise InputError("one view where two are needed", where="images")
    if not limits.min_views <= views <= limits.max_views:
        raise InputError(f"{views} views, expected {limits.min_views} to {limits.max_views}", where="images")
    if len(cameras) != views:
        raise InputError(f"{len(cameras)} cameras for {views} images, expected one each", where="cameras")
    for v, camera in enumerate(cameras):
        if (camera.height, camera.width) != images.shape[1:3]:
            raise InputError(
                f"{camera.width}x{camera.height}, expected {images.shape[2]}x{images.shape[1]} as its image has",
                where=f"cameras[{v}]",
            )
        if not np.isfinite(images[v]).all():
            raise InputError("holds NaN or infinity, expected RGB in [0, 1]", where=f"images[{v}]")
        low, high = float(images[v].min()), float(images[v].max())
        if low < 0 or high > 1:
            raise InputError(f"values from {low:g} to {high:g}, expected RGB in [0, 1]", where=f"images[{v}]")
    return images


def _check_range(near: float, far: float) -> None:
    for name, value in (("near", near), ("far", far)):
        check_depth(value, name)
    if not near < far or not np.float32(1 / near) > np.float32(1 / far):
        raise InputError(f"near {near:g} and far {far:g}, expected near < far", where="near")


def _check_poses(cameras: Sequence[Camera], near: float) -> None:
    for b, second in enumerate(cameras):
        for a, first in enumerate(cameras[:b]):
            apart = float(np.linalg.norm(first.centre - second.centre))
            turned = float(np.abs(first.rotation - second.rotation).max())
            if apart <= SAME_POSE * near and turned <= SAME_POSE:
                raise InputError(
                    f"views {a} and {b} have the same pose, expected views from different places", where="cameras"
                )


def padded(images: NDArray, cameras: Sequence[Camera], limits: NetworkLimits) -> tuple[NDArray, NDArray]:
    """Images (V, H, W, 3) float32 grown right and down to the stride by repeating their edge, and K (V, 3, 3) divided
    by the new size.

    The top-left corner stays where it is, so K in pixels does not change.
    """
    sides = [
        max(-(-side // limits.stride), -(-limits.min_side // limits.stride)) * limits.stride
        for side in images.shape[1:3]
    ]
    grow = [(0, new - old) for new, old in zip(sides, images.shape[1:3], strict=True)]
    if any(after for _, after in grow):
        images = np.pad(images, ((0, 0), *grow, (0, 0)), mode="edge")
    size = np.array([[sides[1]], [sides[0]], [1.0]])
    return images, np.stack([camera.K for camera in cameras]) / size


def assembled(outputs: Mapping[str, NDArray], cameras: Sequence[Camera], near: float, name: str) -> Gaussians:
    """What a network returned by name, its means about `mean_centre`, cropped, placed in the world, and each layer with
    its cameras; see `predict`.
    """
    height, width = cameras[0].height, cameras[0].width
    origin = origin_of(cameras, near)
    shift = mean_centre(cameras) - origin
    layers: list[Gaussians] = []
    prefixes = ["", *(f"layer{n}_" for n in range(1, len(outputs)) if f"layer{n}_means" in outputs)]
    for prefix in prefixes:
        arrays = _layer_arrays(outputs, prefix, name)
        if not prefix:
            arrays = {field: array[:, :height, :width] for field, array in arrays.items()}
        views, *grid = arrays["opacities"].shape
        if views != len(cameras) or (not prefix and grid != [height, width]):
            found = outputs[f"{prefix}means"].shape[:3]
            raise ModelError(f"a grid {found} for {len(cameras)} photos of {width}x{height}", where=name)
        arrays["means"] = (arrays["means"].astype(np.float64) + shift).astype(np.float32)
        arrays["opacities"] = arrays["opacities"].clip(0, 1)
        if (arrays["scales"] < 0).any():
            raise NumericError("the network returned negative numbers", where=f"{prefix}scales")
        try:
            of_grid = cameras
            if prefix:
                K = _finite(outputs, f"{prefix}K", name)
                if K.shape != (views, 3, 3):
                    raise ModelError(f"output '{prefix}K' has shape {K.shape}, expected (V, 3, 3)", where=name)
                of_grid = [Camera(K[v], camera.c2w, grid[1], grid[0]) for v, camera in enumerate(cameras)]
            layers.append(Gaussians(**arrays, cameras=tuple(of_grid), origin=origin))
        except InputError as error:  # of the checks that scenes and cameras share, and here the network's fault
            raise ModelError(f"returned {error}", where=name) from None
    return replace(layers[0], extra_layers=tuple(layers[1:]))


def _layer_arrays(outputs: Mapping[str, NDArray], prefix: str, name: str) -> dict[str, Any]:
    arrays = {}
    lead = outputs[f"{prefix}means"].shape[:3]
    for field, trailing in FIELDS.items():
        array = arrays[field] = _finite(outputs, f"{prefix}{field}", name)
        if array.shape[:3] != lead or array.ndim != 3 + len(trailing):
            raise ModelError(f"output '{prefix}{field}' has shape {array.shape} beside means {lead}", where=name)
    return arrays


def _finite(outputs: Mapping[str, NDArray], name: str, network: str) -> NDArray:
    if name not in outputs:
        raise ModelError(f"output '{name}' is missing", where=network)
    array = outputs[name]
    bad = ~np.isfinite(array)
    if bad.any():
        index = [int(i) for i in np.argwhere(bad)[0]]
        raise NumericError(
            f"the network returned {array[tuple(index)]} ({int(bad.sum())} values are not finite)",
            where=f"{name}{index}",
        )
    return array
