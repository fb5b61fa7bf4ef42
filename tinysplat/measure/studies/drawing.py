"""What does a picture cost? Seconds and errors against float64 by picture size, number of Gaussians and threads; what a
user can choose beside it.

The error is taken at a random 1 % of the pixels. The exact rasteriser draws what 3DGS defines; beside it stand dilation
in own pixels and near views first, which are on unless turned off, and what less work would give.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from numpy.typing import NDArray

from tinysplat.reference.pixels import choose_pixels, render_pixels
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import DEFINITION, Renderer
from tinysplat_runtime.scene.cameras import Camera

from ..clock import Baseline, Figures, Variant, measure, plural
from ..metrics import pixel_errors, psnr
from ..pictures import rescaled
from ..rows import Row
from ..show.tables import Column, View, decibels, percent, small
from ..study import Run, Study
from ..subjects.cases import truncated
from ..subjects.made import made_gaussians

SIZES, QUICK_SIZES = (64, 128, 256, 512, 1024), (64, 256)
COUNTS, QUICK_COUNTS = (8_192, 32_768, 131_072, 524_288, 1_048_576), (8_192, 131_072)
COUNT, QUICK_COUNT = 131_072, 32_768
DEFAULT = "both, the default"
BY_DEFAULT: dict[str, Any] = {"dilation": "own", "order": "near"}
DEGREE = 3
PIXEL_SHARE, LEAST_PIXELS = 0.01, 500


def count_side(count: int) -> int:
    """Side of two square views that hold about `count` per-pixel Gaussians."""
    return max(8, round(math.sqrt(count / 2)))


def drawing_rows(run: Run) -> Iterator[Row]:
    """Pictures of several sizes, of several numbers of Gaussians, and with less work."""
    count = QUICK_COUNT if run.quick else COUNT
    sizes, counts = (QUICK_SIZES, QUICK_COUNTS) if run.quick else (SIZES, COUNTS)
    for size, n in dict.fromkeys([*((size, count) for size in sizes), *((256, n) for n in counts)]):
        gaussians = made_gaussians(2, count_side(n), count_side(n), DEGREE)
        subject = f"{gaussians.count:,} Gaussians at {size}×{size}"
        yield from measure("rasteriser", subject, exact_variants(gaussians, size, run.thread_counts), run.effort)
    gaussians = made_gaussians(2, run.side, run.side, 4)
    subject = f"{gaussians.count:,} Gaussians at {run.side}×{run.side}, SH degree 4"
    variants = approximations(gaussians, run.side, run.threads)
    yield from measure("rasteriser approximations", subject, variants, run.effort)


def exact_variants(gaussians: Gaussians, size: int, threads: Sequence[int]) -> list[Variant]:
    """The exact rasteriser, in numpy and compiled where numba is, by threads: one prepared renderer each."""
    camera = gaussians.cameras[0].resized(size, size)  # an input view: Gaussians as small as a pixel, and many of them
    figures = _against_float64(gaussians, camera)
    ways = {"numpy": False, "compiled": True} if Renderer(gaussians).is_compiled else {"numpy": False}
    return [
        Variant(f"{way}, {plural(count)}", _frame(gaussians, camera, count, compiled), figures,
                {"size": size, "gaussians": gaussians.count, "way": way}, count)
        for way, compiled in ways.items()
        for count in threads
    ]  # fmt: skip


def approximations(gaussians: Gaussians, size: int, threads: int) -> list[Variant]:
    """The exact rasteriser, and what can be had for less work; `psnr_exact` is against the exact picture."""
    camera = gaussians.cameras[0].resized(size, size)
    exact = Renderer(gaussians, threads, compiled=False, **DEFINITION).render(camera)
    against_float64 = _against_float64(gaussians, camera)

    def figures(image: NDArray) -> Figures:
        return {"psnr_exact": psnr(image, exact), **against_float64(image)}

    halved = _frame(gaussians, camera.resized(size // 2, size // 2), threads)
    runs: dict[str, Callable[[], NDArray]] = {
        "exact": _frame(gaussians, camera, threads),
        "own pixels": _frame(gaussians, camera, threads, dilation="own"),
        "near views first": _frame(gaussians, camera, threads, order="near"),
        DEFAULT: _frame(gaussians, camera, threads, **BY_DEFAULT),
        "half size, scaled up": lambda: rescaled(halved(), size, size),
        **{f"SH degree {n}": _frame(truncated(gaussians, n), camera, threads) for n in range(gaussians.degree)},
    }
    exactly = Baseline("exact", runs["exact"])
    variants = [
        Variant(name, run, figures, threads=threads, baseline=exactly if name == DEFAULT else None)
        for name, run in runs.items()
    ]
    if Renderer(gaussians).is_compiled:
        drawn = [_frame(gaussians, camera, threads, True, **options) for options in (DEFINITION, BY_DEFAULT)]
        compiled = Baseline("exact, compiled", drawn[0])
        variants.append(Variant(f"{DEFAULT}, compiled", drawn[1], figures, threads=threads, baseline=compiled))
    return variants


def _frame(
    gaussians: Gaussians, camera: Camera, threads: int, compiled: bool = False, **drawing: str
) -> Callable[[], NDArray]:
    renderer = Renderer(gaussians, threads, compiled=compiled, **{**DEFINITION, **drawing})
    return lambda: renderer.render(camera)


def _against_float64(gaussians: Gaussians, camera: Camera) -> Callable[[NDArray], Figures]:
    pixels = choose_pixels(camera.height, camera.width, PIXEL_SHARE, LEAST_PIXELS)
    truth = render_pixels(gaussians, camera, pixels).clip(0, 1)
    return lambda image: pixel_errors(image.reshape(-1, 3)[pixels], truth)


_FLOAT64 = (
    Column("median_error", "median error", small),
    Column("error_999", "99.9 %", small),
    Column("max_error", "largest", small),
    Column("share_above_1e-4", "above 1e-4", percent),
)

DRAWING = Study.of(
    "Drawing",
    drawing_rows,
    View(
        "rasteriser",
        "Rasteriser",
        "A frame of a prepared renderer, SH degree 3; errors of pixel values in [0, 1] against float64 at a random 1 %"
        " of the pixels. Where rounding decides a threshold (1/255) or the order of two depths, a pixel may be off by"
        " more.",
        _FLOAT64,
        costs=("median_error",),
    ),
    View(
        "rasteriser approximations",
        "Rasteriser: less work",
        "The renderer's own choices (dilation in own pixels, near views first), and what can be had for less: a picture"
        " of half the size scaled up (bicubic), fewer SH bands; dB against the exact picture.",
        (Column("psnr_exact", "dB to exact", decibels), Column("max_error", "largest error", small)),
        gains=("psnr_exact",), y="max_error", y_label="largest error of a pixel", is_log=True,
    ),
)  # fmt: skip
