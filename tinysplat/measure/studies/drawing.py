"""What does a picture cost? Seconds and errors against float64 by picture size, number of Gaussians and threads; what a
user can choose beside it; and gsplat's definition as a second opinion.

The error is taken at a random 1 % of the pixels. The exact rasteriser draws what 3DGS defines; beside it stand dilation
in own pixels and near views first, which are on unless turned off, and what less work would give. gsplat's own blending
exists as a CUDA kernel alone, so its alphas are blended by plain torch here: every Gaussian at every pixel, sorted by
depth, with 3DGS's thresholds.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tinysplat.reference.pixels import ALPHA_MAX, ALPHA_MIN, TRANSMITTANCE_MIN, choose_pixels, render_pixels
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
GSPLAT = "gsplat's projection and SH, dense blending"
_CHUNK = 512


def count_side(count: int) -> int:
    """Side of two square views that hold about `count` per-pixel Gaussians."""
    return max(8, round(math.sqrt(count / 2)))


def drawing_rows(run: Run) -> Iterator[Row]:
    """Pictures of several sizes, of several numbers of Gaussians, with less work, and by gsplat."""
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
    yield from gsplat_rows(made_gaussians(2, 64, 64, DEGREE), 64, run)


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


def gsplat_rows(gaussians: Gaussians, size: int, run: Run) -> list[Row]:
    """Ours and gsplat's at one size, both against float64; a row that says so where gsplat is missing."""
    camera = gaussians.cameras[0].resized(size, size)
    subject, figures = f"{gaussians.count:,} Gaussians at {size}×{size}", _against_float64(gaussians, camera)
    variants = [Variant("ours, exact", _frame(gaussians, camera, run.threads), figures, threads=run.threads)]
    missing = []
    try:
        theirs = gsplat_frame(gaussians, camera, run.threads)
        variants.append(Variant(GSPLAT, theirs, figures, threads=run.threads))
    except ImportError as error:
        missing = [Row("torch rasteriser", subject, GSPLAT, note=f"no {error.name}: pip install gsplat")]
    return [*measure("torch rasteriser", subject, variants, run.effort), *missing]


def gsplat_frame(gaussians: Gaussians, camera: Camera, threads: int) -> Callable[[], NDArray]:
    """A call that renders a frame (H, W, 3) float32 with gsplat's torch functions; ImportError if not installed."""
    import torch

    impl: Any = importlib.import_module("gsplat.cuda._torch_impl")
    flat = gaussians.flat()
    means, quats, scales, opacities, sh = (
        torch.from_numpy(np.ascontiguousarray(array))
        for array in (flat.means + np.float32(flat.origin), flat.quats, flat.scales, flat.opacities, flat.sh)
    )
    view = torch.from_numpy(camera.w2c.astype(np.float32))[None]
    K = torch.from_numpy(camera.K.astype(np.float32))[None]
    centre = torch.from_numpy(camera.centre.astype(np.float32))

    def frame() -> NDArray:
        torch.set_num_threads(threads)
        with torch.inference_mode():
            covariances, _ = impl._quat_scale_to_covar_preci(quats, scales, True, False)
            radii, centres, depths, conics, _ = impl._fully_fused_projection(
                means, covariances, view, K, camera.width, camera.height
            )
            colours = (impl._spherical_harmonics(flat.degree, means - centre, sh) + 0.5).clamp_min(0)
            order = torch.argsort(torch.where(radii[0].amin(dim=-1) > 0, depths[0], torch.inf), stable=True)
            order = order[radii[0].amin(dim=-1)[order] > 0]
            picture = _blend(centres[0, order], conics[0, order], opacities[order], colours[order], camera)
        return picture.clamp(0, 1).numpy()

    return frame


def _blend(centres: Any, conics: Any, opacities: Any, colours: Any, camera: Camera) -> Any:
    """(H, W, 3) of Gaussians in depth order, every one at every pixel."""
    import torch

    x, y = torch.meshgrid(torch.arange(camera.width) + 0.5, torch.arange(camera.height) + 0.5, indexing="xy")
    rows = []
    for part in torch.stack([x, y], dim=-1).reshape(-1, 2).split(_CHUNK):
        d = part[:, None] - centres[None]  # (P, N, 2)
        power = 0.5 * (conics[:, 0] * d[..., 0] ** 2 + conics[:, 2] * d[..., 1] ** 2) + conics[:, 1] * d.prod(dim=-1)
        alpha = (opacities * torch.exp(-power)).clamp_max(ALPHA_MAX)
        alpha = torch.where((power >= 0) & (alpha >= ALPHA_MIN), alpha, 0.0)
        left = torch.cumprod(1 - alpha, dim=1)
        before = torch.cat([torch.ones_like(left[:, :1]), left[:, :-1]], dim=1)
        rows.append(torch.where(left >= TRANSMITTANCE_MIN, alpha * before, 0.0) @ colours)
    return torch.cat(rows).reshape(camera.height, camera.width, 3)


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
    View(
        "torch rasteriser",
        "Rasteriser: peer",
        "gsplat's torch functions for projection and SH, its alphas blended densely in torch: another implementation of"
        " the same definition, for correctness first. Errors as above.",
        _FLOAT64,
    ),
)  # fmt: skip
