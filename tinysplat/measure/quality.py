"""The work on windows with photos: networks and codings, raw, decoded and the photo baseline, and means of its rows.

PSNR in dB, SSIM, FLIP, sharpness and LPIPS are means over the target images, as are those called `fitted`, of pictures
with the photo's exposure; `_raw` is the render of the network's Gaussians against the photo, no suffix that of the
decoded ones, `_decoded_raw` decoded against raw, `_photo` the context photo taken from nearest, as if it were the
answer. Covered pixels are those that some context view has in its
frame.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.job import EncodeStats
from tinysplat_runtime.container.inspection import inspect_bytes
from tinysplat_runtime.gaussian.difference import attribute_errors
from tinysplat_runtime.network.masked import hidden
from tinysplat_runtime.network.predict import predict
from tinysplat_runtime.system.jsonfields import JsonObject
from tinysplat_runtime.system.stopwatch import Stopwatch

from .lpips import LpipsFiles, load_lpips
from .metrics import judged, psnr
from .pictures import PictureJudge, PictureMetric
from .rows import Row, grouped
from .subjects.cases import Shots, WindowJob, covered_pixels

STUDY = "quality"

GROUP = ("kind", "views", "model", "profile", "qp", "size")
"""What rows that compare have in common."""

_UNKNOWN = dict.fromkeys(("flip_raw", "flip", "lpips", "lpips_raw", "lpips_decoded_raw", "lpips_photo"))
"""Where the package or weights are missing."""


@dataclass(frozen=True)
class ProfileQp:
    """A profile at a Q_g."""

    profile: str
    qp: float


@dataclass(frozen=True)
class Quality:
    """The work on every window; see the module.

    Attributes:
        codings: each is done for every window.
        lpips: weights, or None.
    """

    codings: tuple[ProfileQp, ...]
    lpips: LpipsFiles | None = None

    def wanted(self, job: WindowJob) -> list[Row]:
        """A window's rows with neither figures nor costs: what is to be measured."""
        stamp = job.stamp(str(self.lpips or ""))
        window = job.window
        identity = {
            "scene": job.source.name,
            "kind": window.kind,
            "model": job.model,
            "views": len(window.context),
            "context": window.context,
            "targets": window.targets,
            "size": job.size,
        }
        row = Row(STUDY, f"{job.source.name} {window}", "", stamp=stamp)
        return [replace(row, way=f"{c.profile} {c.qp:g}", setting={**identity, **asdict(c)}) for c in self.codings]

    def measure(self, job: WindowJob, wanted: Sequence[Row], runtime: Runtime) -> Iterator[Row]:
        """Some of them, measured."""
        lpips = load_lpips(self.lpips, runtime.threads) if self.lpips else None
        prepared = Prepared.of(job, runtime, self, lpips)
        for row in wanted:
            yield _measure_coding(row, prepared, runtime, lpips)


@dataclass(frozen=True, eq=False)
class Prepared:
    """A window with everything that does not depend on the coding.

    Attributes:
        shots: its photos.
        pictures: of its raw Gaussians.
        seconds: by stage, of what came before coding.
        per_image: lists behind the figures of the raw render and the photo baseline.
        covered: (H, W) bool per target.
        shared: figures that all codings have.
    """

    shots: Shots
    pictures: PictureJudge
    seconds: dict[str, float]
    per_image: dict[str, list[float]]
    covered: tuple[NDArray, ...]
    shared: JsonObject

    @classmethod
    def of(cls, job: WindowJob, runtime: Runtime, quality: Quality, lpips: PictureMetric | None = None) -> Prepared:
        """Bring a window to Gaussians, render them as they are and score them and the photo baseline."""
        shots, watch, shared = job.shots(), Stopwatch(), JsonObject()
        context, photos = shots.context, shots.targets.images
        graph = runtime.store.network(job.model)
        with watch.stage("network"):
            gaussians = predict(context.images, context.cameras, shots.near, shots.far, graph)
            if shots.scene is not None:
                gaussians = hidden(gaussians, shots.scene)
        pictures, cameras = PictureJudge(gaussians, shots.targets.cameras, runtime.threads), context.cameras
        covered = tuple(covered_pixels(c, cameras, shots.near, shots.far) for c in pictures.cameras)
        per_image = {"coverage": [float(mask.mean()) for mask in covered]}
        centres = np.stack([camera.centre for camera in cameras])
        away = [np.linalg.norm(centres - camera.centre, axis=1) for camera in pictures.cameras]
        nearest = [context.images[distances.argmin()] for distances in away]
        for name, images in (("_raw", pictures.raw), ("_photo", nearest)):
            per_image |= _scores(images, photos, lpips, name, covered)
        return cls(shots, pictures, watch.seconds, per_image, covered, shared)


def _measure_coding(row: Row, prepared: Prepared, runtime: Runtime, lpips: PictureMetric | None) -> Row:
    """Code, decode, render and compare a prepared window."""
    pictures, stats = prepared.pictures, EncodeStats()
    gaussians, camera = pictures.gaussians, pictures.cameras[0]
    data = runtime.compress(gaussians, row.setting["profile"], row.setting["qp"], drop_invalid=True, stats=stats)
    decoded = runtime.decompress(data, watch=stats.watch)
    images, seconds = pictures.render(decoded)
    per_image = {
        **prepared.per_image,
        **_scores(images, pictures.raw, lpips, "_decoded_raw"),
        **_scores(images, prepared.shots.targets.images, lpips, "", prepared.covered),
    }
    described = inspect_bytes(data)
    figures = {
        **_UNKNOWN,
        **{name: float(np.mean(values)) if values else None for name, values in per_image.items()},
        "height": camera.height,
        "width": camera.width,
        "bytes": len(data),
        "bytes_by_class": described["bytes_by_class"],
        "metadata_bytes": described["metadata_bytes"],
        "raw_bytes": gaussians.nbytes,
        "gaussians": gaussians.count,
        "attribute_errors": attribute_errors(gaussians, decoded),
        "per_image": per_image,
        **prepared.shared,
    }
    return replace(row, figures=figures, costs={**prepared.seconds, **stats.watch.seconds, "render": seconds})


def _scores(
    images: Sequence[NDArray],
    references: Iterable[NDArray],
    lpips: PictureMetric | None,
    suffix: str,
    covered: Sequence[NDArray] = (),
) -> dict[str, list[float]]:
    """By figure, a number per picture; over covered pixels of the targets that have some at all."""
    pairs = list(zip(images, references, strict=True))
    each = [judged(*pair) | ({"lpips": lpips(*pair)} if lpips else {}) for pair in pairs]
    scores = {f"{name}{suffix}": [own[name] for own in each] for name in each[0]}
    if covered:
        masked = zip(pairs, covered, strict=True)
        scores[f"psnr{suffix}_covered"] = [psnr(*pair, mask) for pair, mask in masked if mask.any()]
    return scores


# ---- condensed ---------------------------------------------------------------------------------------------------


def record(row: Row) -> JsonObject:
    """A row as `eval --json` has it under `scenes`: one flat object, seconds under their own name."""
    setting = {name: value for name, value in row.setting.items() if name != "size"}
    return {**setting, **row.figures, "seconds": dict(row.costs)}


def mean_of(values: Sequence[Any]) -> Any:
    """Mean of numbers, or of objects key by key; what is None or lacks a key is left out, and None if nothing stays."""
    present = [value for value in values if value is not None]
    if not present:
        return None
    if isinstance(present[0], Mapping):
        keys = dict.fromkeys(key for value in present for key in value)
        return {key: mean_of([value.get(key) for value in present]) for key in keys}
    return float(np.mean(present))


def mean_of_rows(rows: Sequence[Row]) -> JsonObject:
    """Means over rows of every figure and of `seconds`, every row counting once."""
    skipped = ("per_image", "height", "width")
    averaged = [{**row.figures, "seconds": row.costs} for row in rows]
    return mean_of([{name: value for name, value in entry.items() if name not in skipped} for entry in averaged])


def mean_of_scenes(rows: Sequence[Row]) -> JsonObject:
    """Means over scenes of each scene's means: a scene with many windows weighs no more than one with few."""
    return mean_of([mean_of_rows(members) for members in grouped(rows, "scene").values()])
