"""Networks: photos to Gaussians, by network and by the size it works at.

Whatever size a network works at, its Gaussians are rendered at one size and held against the photos of that size, so
that a smaller input shows what it costs. Where the true depth is known, the error of the Gaussians' own z counts too.
Where a network has a torch twin, its depth in float32 is held against the twin's in float64.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.errors import TinySplatError
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.graphs.artifacts import load_manifest
from tinysplat_runtime.graphs.inference import as_input
from tinysplat_runtime.graphs.predict import predict

from ..measure.metrics import depth_errors
from .inputs import Photos, PhotoSource
from .judge import photo_figures
from .timing import Figures, Row, Stage, Variant

TWINS = ("sweep",)
"""Networks of the manifest whose torch module needs no checkpoint."""


def shipped_networks() -> list[str]:
    """Names of the networks in the manifest."""
    return sorted(a.name for a in load_manifest().values() if a.role == "network")


def network_stage(
    source: PhotoSource,
    models: Sequence[str],
    sizes: Sequence[tuple[int, int]],
    judged_at: tuple[int, int],
    threads: Sequence[int],
) -> tuple[Stage, list[Row]]:
    """Every network at every size; and a row with the reason for each that could not run."""
    judge = _PhotoJudge(source, judged_at, max(threads))
    stage_name, variants, failed = "network", [], []
    for model in models:
        for height, width in sizes:
            for count in threads:
                label = f"{model} at {height}×{width}, {count} thread{'s' * (count > 1)}"
                try:
                    variants.append(_variant(label, source, model, (height, width), count, judge))
                except TinySplatError as error:
                    failed.append(Row(stage_name, source.name, label, count, note=str(error)))
    return Stage(stage_name, source.name, variants), failed


def _variant(
    label: str, source: PhotoSource, model: str, size: tuple[int, int], threads: int, judge: _PhotoJudge
) -> Variant:
    photos = source.context(*size)
    near, far = source.depth_range
    graph = Runtime(threads=threads).store.network(model)

    def run() -> Gaussians:
        return predict(photos.images, photos.cameras, near, far, graph)

    run()  # what this network cannot take is found out here
    rounding = float64_figures(model, photos, (near, far))
    return Variant(
        label,
        run,
        figures=lambda gaussians: judge.figures(gaussians, photos) | rounding(gaussians),
        settings={"model": model, "height": size[0], "width": size[1], "views": len(photos.cameras)},
        threads=threads,
    )


class _PhotoJudge:
    """A source's photos at the size of judgement."""

    def __init__(self, source: PhotoSource, size: tuple[int, int], threads: int) -> None:
        self._context, self._targets, self._threads = source.context(*size), source.targets(*size), threads

    def figures(self, gaussians: Gaussians, photos: Photos) -> Figures:
        """`psnr` at the targets, `psnr_inputs` at the input views, `depth_abs_rel` over all pixels of known depth."""
        inputs = photo_figures(gaussians, self._context.cameras, list(self._context.images), self._threads)
        targets = photo_figures(gaussians, self._targets.cameras, list(self._targets.images), self._threads)
        figures = {**targets, "psnr_inputs": inputs["psnr"]}
        if photos.depths is not None:
            depth = _depths(gaussians)
            both = photos.depths > 0
            figures["depth_abs_rel"] = depth_errors(depth[both][None], photos.depths[both][None])["abs_rel"]
        return figures


def _depths(gaussians: Gaussians) -> NDArray:
    """(V, H, W) float32 z of layer 0 in the own camera's frame."""
    rows = [camera.rotation[2] for camera in gaussians.cameras]
    return np.stack(
        [
            (means + (gaussians.origin - camera.centre)) @ row
            for means, camera, row in zip(gaussians.means, gaussians.cameras, rows, strict=True)
        ]
    ).astype(np.float32)


def float64_figures(model: str, photos: Photos, depth_range: tuple[float, float]) -> Callable[[Gaussians], Figures]:
    """Errors of depth against the torch twin in float64; no figures for a network without twin.

    A rounding that decides which candidate wins moves a depth by far more than a rounding, so quantiles are given.
    """
    if model not in TWINS:
        return lambda _: {}
    import torch

    from ..networks.sweep import OUTPUT_NAMES, Sweep

    inputs = [array.astype(np.float64) for array in contract_inputs(photos, depth_range).values()]
    default = torch.get_default_dtype()
    torch.set_default_dtype(torch.float64)
    try:
        with torch.inference_mode():
            outputs = Sweep()(*(torch.from_numpy(array) for array in inputs))
    finally:
        torch.set_default_dtype(default)
    truth = outputs[OUTPUT_NAMES.index("depth")].numpy()

    def figures(gaussians: Gaussians) -> Figures:
        error = np.abs(_depths(gaussians) - truth) / truth
        return {"depth_error_median": float(np.median(error)), "depth_error_99": float(np.quantile(error, 0.99))}

    return figures


def contract_inputs(photos: Photos, depth_range: tuple[float, float]) -> dict[str, NDArray]:
    """Photos and cameras under the contract of the role `network`, float32: what `predict` feeds a graph."""
    poses = np.stack([camera.c2w for camera in photos.cameras])
    poses[:, :3, 3] -= poses[:, :3, 3].mean(axis=0)
    near, far = (np.full(len(poses), limit) for limit in depth_range)
    K = np.stack([camera.K_unit for camera in photos.cameras])
    arrays = {"images": photos.images.transpose(0, 3, 1, 2), "K": K, "c2w": poses, "near": near, "far": far}
    return {name: as_input(array) for name, array in arrays.items()}
