"""One window measured: its raw render once, then as many codings as are wanted, all against the same pictures."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tinysplat.measure.metrics import attribute_errors, depth_errors, plane_errors, psnr, ssim
from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.encoder import EncodeStats
from tinysplat_runtime.container.inspection import inspect_bytes
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.render import Renderer
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.images import write_png

from .sources import Case

PSNR_CEILING = 150.0
"""dB given to identical pictures, where float32's own rounding lies: JSON has no infinity."""

PictureMetric = Callable[[NDArray, NDArray], float]


@dataclass(frozen=True, eq=False)
class Rendered:
    """Target pictures of one set of Gaussians.

    Attributes:
        images: (T, H, W, 3) float32.
        depths: (H, W) float32 per target where the true depth is known, else None.
        seconds: median of one picture.
    """

    images: NDArray
    depths: tuple[NDArray | None, ...]
    seconds: float


@dataclass(frozen=True, eq=False)
class Prepared:
    """A window with everything that does not depend on the coding.

    Attributes:
        case: Gaussians, target cameras and photos.
        raw: pictures of the Gaussians as they are.
        scores: per-image lists of the raw render and the photo baseline.
    """

    case: Case
    raw: Rendered
    scores: dict[str, list[float]]


def prepare(case: Case, runtime: Runtime, lpips: PictureMetric | None = None) -> Prepared:
    """Render a window's Gaussians as they are and score them and the photo baseline.

    Args:
        case: the window.
        runtime: its threads are used.
        lpips: the metric, or None where there are no weights.
    """
    raw = render_targets(case.gaussians, case, runtime.threads)
    scores: dict[str, list[float]] = {}
    if case.covered is not None:
        scores["coverage"] = [float(mask.mean()) for mask in case.covered]
    if case.photos is not None:
        scores |= _scores(raw.images, case.photos, lpips, "_raw")
        scores |= _covered_psnr(raw.images, case, "psnr_raw_covered")
    if case.photos is not None and case.nearest is not None:
        scores |= _scores(case.nearest, case.photos, lpips, "_photo")
        scores |= _covered_psnr(case.nearest, case, "psnr_photo_covered")
    return Prepared(case, raw, scores)


def measure_coding(
    prepared: Prepared,
    profile: str,
    qp: float,
    runtime: Runtime,
    *,
    lpips: PictureMetric | None = None,
    pictures: Path | None = None,
) -> dict[str, Any]:
    """Code, decode, render and compare a prepared window.

    Args:
        prepared: the window.
        profile, qp: how to code it.
        runtime: codes and decodes.
        lpips: the metric, or None where there are no weights.
        pictures: folder for PNG files of the target pictures, or None.

    Returns:
        The fields of a `Record` that measuring gives.
    """
    case, stats = prepared.case, EncodeStats()
    data = runtime.compress(case.gaussians, profile, qp, drop_invalid=True, stats=stats)
    decoded = runtime.decompress(data, watch=stats.watch)
    rendered = render_targets(decoded, case, runtime.threads)
    per_image = {**prepared.scores, **_scores(rendered.images, prepared.raw.images, lpips, "_decoded_raw")}
    if case.photos is not None:
        per_image |= _scores(rendered.images, case.photos, lpips, "")
        per_image |= _covered_psnr(rendered.images, case, "psnr_covered")
    if pictures is not None:
        write_pictures(pictures, prepared, rendered.images)
    described = inspect_bytes(data)
    return {
        **{name: _mean(values) for name, values in per_image.items()},
        "bytes": len(data),
        "seconds": {**case.seconds, **stats.watch.seconds, "render": rendered.seconds},
        "depth": _depth_scores(case, {"raw": prepared.raw, "decoded": rendered}),
        "bytes_by_class": described["bytes_by_class"],
        "metadata_bytes": described["metadata_bytes"],
        "raw_bytes": raw_bytes(case.gaussians),
        "gaussians": case.gaussians.count,
        "attribute_errors": {
            "world": attribute_errors(case.gaussians, decoded),
            "planes": plane_errors(case.gaussians, decoded, runtime.store),
        },
        "per_image": per_image,
    }


def render_targets(gaussians: Gaussians, case: Case, threads: int) -> Rendered:
    """Pictures of a window's targets, and depth maps where the truth is known."""
    renderer = Renderer(gaussians, threads=threads)
    images, depths, seconds = [], [], []
    for camera, truth in zip(case.cameras, case.depths, strict=True):
        start = time.perf_counter()
        images.append(renderer.render(camera))
        seconds.append(time.perf_counter() - start)
        depths.append(None if truth is None else _depth_map(renderer, camera))
    return Rendered(np.stack(images), tuple(depths), statistics.median(seconds))


def write_pictures(folder: Path, prepared: Prepared, decoded: NDArray) -> None:
    """Target pictures as `<n>_photo.png`, `<n>_raw.png`, `<n>_decoded.png`, n counting the window's targets."""
    sets: dict[str, NDArray | None] = {
        "photo": prepared.case.photos, "raw": prepared.raw.images, "decoded": decoded
    }  # fmt: skip
    for name, images in sets.items():
        for n, image in enumerate(() if images is None else images):
            write_png(folder / f"{n}_{name}.png", image)


def raw_bytes(gaussians: Gaussians) -> int:
    """Size of the Gaussians' float32 arrays over all layers."""
    return sum(getattr(layer, name).nbytes for layer in gaussians.layers for name in FIELDS)


def capped_psnr(image: NDArray, reference: NDArray, mask: NDArray | None = None) -> float:
    """PSNR in dB, at most PSNR_CEILING."""
    return min(psnr(image, reference, mask), PSNR_CEILING)


def _scores(
    images: Sequence[NDArray] | NDArray, references: NDArray, lpips: PictureMetric | None, suffix: str
) -> dict[str, list[float]]:
    metrics: dict[str, PictureMetric] = {"psnr": capped_psnr, "ssim": ssim, **({"lpips": lpips} if lpips else {})}
    return {
        f"{name}{suffix}": [metric(a, b) for a, b in zip(images, references, strict=True)]
        for name, metric in metrics.items()
    }


def _covered_psnr(images: NDArray, case: Case, name: str) -> dict[str, list[float]]:
    """Of the targets that have covered pixels at all, under a name; nothing where it is not known what is covered."""
    if case.photos is None or case.covered is None:
        return {}
    triples = zip(images, case.photos, case.covered, strict=True)
    return {name: [capped_psnr(image, photo, mask) for image, photo, mask in triples if mask.any()]}


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if len(values) else None


def _depth_map(renderer: Renderer, camera: Camera) -> NDArray:
    return renderer.render(camera, outputs=("depth",))["depth"]


def _depth_scores(case: Case, sets: Mapping[str, Rendered]) -> dict[str, dict[str, float]]:
    """Means over the targets whose true depth is known and met by the rendered one."""
    scores: dict[str, dict[str, float]] = {}
    for name, rendered in sets.items():
        pairs = zip(rendered.depths, case.depths, strict=True)
        found = [depth_errors(d, t) for d, t in pairs if d is not None and t is not None and t.any()]
        found = [errors for errors in found if errors["covered"] > 0]
        if found:
            scores[name] = {key: float(np.mean([errors[key] for errors in found])) for key in found[0]}
    return scores
