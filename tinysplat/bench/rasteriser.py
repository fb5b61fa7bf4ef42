"""The rasteriser: seconds and errors against float64 by picture size, number of Gaussians and threads.

The error is taken at a random 1 % of the pixels. Beside the exact rasteriser, which draws what 3DGS defines, stands
what a user can choose: dilation in own pixels and near views first, which are on unless turned off, a picture of half
the size scaled up, and Gaussians without their higher SH bands.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import DEFINITION, Renderer
from tinysplat_runtime.scene.cameras import Camera

from ..measure.metrics import psnr
from ..reference.pixels import choose_pixels, render_pixels
from .inputs import made_gaussians, truncated
from .judge import pixel_errors
from .timing import Figures, Stage, Variant

PIXEL_SHARE, LEAST_PIXELS = 0.01, 500
DEGREE = 3


def count_side(count: int) -> int:
    """Side of two square views that hold about `count` per-pixel Gaussians."""
    return max(8, round(math.sqrt(count / 2)))


def size_and_count_stages(
    sizes: Sequence[int], counts: Sequence[int], at_size: int, at_count: int, threads: Sequence[int]
) -> list[Stage]:
    """Pictures of several sizes of `at_count` Gaussians, and pictures of `at_size` of several numbers of Gaussians."""
    stages: list[Stage] = []
    for size, count in [*((size, at_count) for size in sizes), *((at_size, count) for count in counts)]:
        if any(stage.case == _case(size, count) for stage in stages):
            continue
        gaussians = made_gaussians(2, count_side(count), count_side(count), DEGREE)
        stages.append(exact_stage(gaussians, size, _case(size, count), threads))
    return stages


def exact_stage(gaussians: Gaussians, size: int, case: str, threads: Sequence[int]) -> Stage:
    """The exact rasteriser, in numpy and compiled where numba is, by threads: one prepared renderer each."""
    camera = _camera(gaussians).resized(size, size)
    figures = _against_float64(gaussians, camera)
    ways = {"numpy": False, "compiled": True} if Renderer(gaussians).is_compiled else {"numpy": False}
    variants = [
        Variant(
            f"{way}, {count} thread{'s' * (count > 1)}",
            _frame(gaussians, camera, count, compiled),
            figures,
            {"size": size, "gaussians": gaussians.count},
            count,
        )
        for way, compiled in ways.items()
        for count in threads
    ]
    return Stage("rasteriser", case, variants)


def approximation_stage(gaussians: Gaussians, size: int, case: str, threads: int) -> Stage:
    """The exact rasteriser, and what can be had for less work; `psnr_exact` is against the exact picture."""
    camera = _camera(gaussians).resized(size, size)
    exact = Renderer(gaussians, threads, compiled=False, **DEFINITION).render(camera)
    against_float64 = _against_float64(gaussians, camera)

    def figures(image: NDArray) -> Figures:
        return {"psnr_exact": psnr(image, exact), **against_float64(image)}

    half = camera.resized(size // 2, size // 2)
    halved = _frame(gaussians, half, threads)
    variants = [
        Variant("exact", _frame(gaussians, camera, threads), figures, {"approximation": "none"}, threads),
        Variant(
            "own pixels",
            _frame(gaussians, camera, threads, dilation="own"),
            figures,
            {"approximation": "dilation"},
            threads,
        ),
        Variant(
            "near views first",
            _frame(gaussians, camera, threads, order="near"),
            figures,
            {"approximation": "order"},
            threads,
        ),
        Variant("half size, scaled up", lambda: enlarged(halved()), figures, {"approximation": "size"}, threads),
    ]
    for degree in range(gaussians.degree):
        run = _frame(truncated(gaussians, degree), camera, threads)
        variants.append(Variant(f"SH degree {degree}", run, figures, {"approximation": "degree"}, threads))
    return Stage("rasteriser approximations", case, variants)


def enlarged(image: NDArray) -> NDArray:
    """(H, W, 3) to (2H, 2W, 3), bilinear between pixel centres."""
    for axis in (0, 1):
        first, last = image.take([0], axis), image.take([-1], axis)
        before = np.concatenate([first, image], axis).take(range(image.shape[axis]), axis)
        after = np.concatenate([image, last], axis).take(range(1, image.shape[axis] + 1), axis)
        pair = np.stack([0.75 * image + 0.25 * before, 0.75 * image + 0.25 * after], axis + 1)
        image = pair.reshape(*image.shape[:axis], -1, *image.shape[axis + 1 :])
    return image


def _camera(gaussians: Gaussians) -> Camera:
    # The first input view: Gaussians as small as a pixel, and as many of them in the picture as can be.
    return gaussians.cameras[0]


def _frame(
    gaussians: Gaussians, camera: Camera, threads: int, compiled: bool = False, **drawing: str
) -> Callable[[], NDArray]:
    renderer = Renderer(gaussians, threads, compiled=compiled, **{**DEFINITION, **drawing})
    return lambda: renderer.render(camera)


def _against_float64(gaussians: Gaussians, camera: Camera) -> Callable[[NDArray], Figures]:
    pixels = choose_pixels(camera.height, camera.width, PIXEL_SHARE, LEAST_PIXELS)
    truth = render_pixels(gaussians, camera, pixels).clip(0, 1)
    return lambda image: pixel_errors(image.reshape(-1, 3)[pixels], truth)


def _case(size: int, count: int) -> str:
    return f"{2 * count_side(count) ** 2:,} Gaussians at {size}×{size}"
