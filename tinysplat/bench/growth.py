"""How seconds and memory grow with views, pixels and Gaussians, and where they stop growing in proportion.

Times come from interleaved rounds in this process, peaks from a process per point. Lines are fitted to both: a slope in
log-log (1 is proportional) and fixed + per-unit costs.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.hevc import encode_plane
from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE, find_profile
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.graphs.predict import predict
from tinysplat_runtime.render import Renderer
from tinysplat_runtime.scene.images import write_png

from . import room
from .inputs import Photos, Room, made_gaussians
from .memory import Peak, measure_peak, peak_of_file, peak_of_gaussians
from .rasteriser import count_side
from .timing import Effort, Row, Setting, Stage, Variant, measure

DEGREE = 3

PROPORTIONAL = (0.85, 1.15)
"""Slopes between neighbouring points that count as proportional growth."""


@dataclass(frozen=True)
class Point:
    """One size on an axis: `views` × `height` × `width` per-pixel Gaussians, drawn at `picture`."""

    axis: str
    views: int
    height: int
    width: int
    picture: tuple[int, int]

    @property
    def x(self) -> int:
        """Where it lies on its axis."""
        return {"views": self.views, "pixels": self.height * self.width, "Gaussians": self.gaussians}[self.axis]

    @property
    def gaussians(self) -> int:
        """How many there are."""
        return self.views * self.height * self.width

    @property
    def label(self) -> str:
        """For reports."""
        return f"{self.views}×{self.height}×{self.width}"


@dataclass(frozen=True)
class Axes:
    """The points to measure.

    Attributes:
        views: numbers of views, at `view_size`.
        view_size: (H, W).
        pixels: (H, W) of two views.
        gaussians: numbers of Gaussians drawn at `picture`.
        picture: (H, W).
        network_views: numbers of views of the network's axis.
        memory_axes: axes that peaks are measured on.
    """

    views: Sequence[int]
    view_size: tuple[int, int]
    pixels: Sequence[tuple[int, int]]
    gaussians: Sequence[int]
    picture: tuple[int, int]
    network_views: Sequence[int]
    memory_axes: Sequence[str]

    def points(self, task: str) -> list[Point]:
        """Points of a task, axis after axis."""
        views = self.network_views if task == "network" else self.views
        points = [Point("views", v, *self.view_size, self.view_size) for v in views]
        points += [Point("pixels", 2, *size, size) for size in self.pixels]
        if task == "render":
            sides = [count_side(count) for count in self.gaussians]
            points += [Point("Gaussians", 2, side, side, self.picture) for side in sides]
        return points


TASKS = ("plane", "network", "encode", "decode", "render")
"""What growth is measured of."""

PLANE_SIDES = (16, 32, 64, 128, 256)


def plane_rows(effort: Effort) -> list[Row]:
    """One plane of noise through libx265 by its size: what is left at 16×16 is the price of opening the library."""
    rng = np.random.default_rng(0)
    settings = find_profile(DEFAULT_PROFILE).encoder
    variants = []
    for side in PLANE_SIDES:
        codes = rng.integers(1800, 2200, (side, side)).astype(np.uint16)
        run = partial(encode_plane, codes, 24, settings)
        variants.append(Variant(f"{side}×{side}", run, settings={"axis": "pixels", "x": side**2}))
    return measure(Stage("growth plane", "pixels", variants), effort)


Work = Callable[[], object]
Peaks = Callable[[], Peak]


def growth_rows(
    axes: Axes, model: str | None, runtime: Runtime, effort: Effort, tasks: Collection[str] = TASKS
) -> Iterator[Row]:
    """Rows of the stages `growth TASK`, the axis as the case, of some of `TASKS`; no network without a model."""
    if "plane" in tasks:
        yield from plane_rows(effort)
    jobs: dict[str, Callable[[Point], tuple[Work, Peaks]]] = {
        "encode": partial(_encode_job, runtime=runtime),
        "decode": partial(_decode_job, runtime=runtime),
        "render": partial(_render_job, runtime=runtime),
    }
    if model is not None:
        jobs = {"network": partial(_network_job, model=model, runtime=runtime), **jobs}
    for task, make in ((task, make) for task, make in jobs.items() if task in tasks):
        points = axes.points(task)
        for axis in dict.fromkeys(point.axis for point in points):
            yield from _axis_rows(task, [p for p in points if p.axis == axis], make, axes, runtime.threads, effort)


def _axis_rows(
    task: str,
    points: Sequence[Point],
    make: Callable[[Point], tuple[Work, Peaks]],
    axes: Axes,
    threads: int,
    effort: Effort,
) -> Iterator[Row]:
    axis = points[0].axis
    jobs = [make(point) for point in points]
    variants = []
    for point, (work, _) in zip(points, jobs, strict=True):
        settings: dict[str, Setting] = {"axis": axis, "x": point.x, "gaussians": point.gaussians}
        variants.append(Variant(point.label, work, settings=settings, threads=threads))
    rows = measure(Stage(f"growth {task}", axis, variants), effort)
    for row, (_, peak) in zip(rows, jobs, strict=True):
        yield replace(row, peak_bytes=peak().total) if axis in axes.memory_axes else row


def _gaussians(point: Point) -> Gaussians:
    return made_gaussians(point.views, point.height, point.width, DEGREE)


def _encode_job(point: Point, runtime: Runtime) -> tuple[Work, Peaks]:
    gaussians = _gaussians(point)
    return (
        lambda: runtime.compress(gaussians, DEFAULT_PROFILE),
        lambda: peak_of_gaussians("encode", gaussians, DEFAULT_PROFILE, runtime.threads),
    )


def _decode_job(point: Point, runtime: Runtime) -> tuple[Work, Peaks]:
    data = runtime.compress(_gaussians(point), DEFAULT_PROFILE)
    return lambda: runtime.decompress(data), lambda: peak_of_file(data, runtime.threads)


def _render_job(point: Point, runtime: Runtime) -> tuple[Work, Peaks]:
    gaussians = _gaussians(point)
    renderer = Renderer(gaussians, runtime.threads)
    camera = gaussians.cameras[0].resized(*point.picture)
    size = f"{point.picture[0]}x{point.picture[1]}"
    return (
        lambda: renderer.render(camera),
        lambda: peak_of_gaussians("render", gaussians, size, runtime.threads),
    )


def _network_job(point: Point, model: str, runtime: Runtime) -> tuple[Work, Peaks]:
    source = Room(point.views)
    photos = source.context(point.height, point.width)
    graph = runtime.store.network(model)

    def peak() -> Peak:
        with tempfile.TemporaryDirectory() as folder:
            write_room(Path(folder), photos)
            return measure_peak("network", folder, model, runtime.threads)

    return lambda: predict(photos.images, photos.cameras, *source.depth_range, graph), peak


def write_room(folder: Path, photos: Photos) -> None:
    """Write photos as a scene folder."""
    frames = []
    for i, (image, camera) in enumerate(zip(photos.images, photos.cameras, strict=True)):
        write_png(folder / f"{i}.png", np.rint(image * 255).astype(np.uint8))
        size = {"width": camera.width, "height": camera.height}
        frames.append({"file": f"{i}.png", **size, "K": camera.K.tolist(), "c2w": camera.c2w.tolist()})
    document = {"near": room.NEAR, "far": room.FAR, "frames": frames}
    (folder / "cameras.json").write_text(json.dumps(document), "utf-8")


@dataclass(frozen=True)
class Fit:
    """How a cost y grows with x.

    Attributes:
        slope: of the line through all points in log-log.
        fixed, per_unit: y ≈ fixed + per_unit · x, relative errors weighed alike, neither below 0.
        steps: slopes in log-log between neighbouring points, by the x of the later one.
        linear_from: the smallest x from which on all steps are within `PROPORTIONAL`; None if the last is not.
    """

    slope: float
    fixed: float
    per_unit: float
    steps: tuple[tuple[float, float], ...]
    linear_from: float | None

    @classmethod
    def of(cls, x: Sequence[float], y: Sequence[float]) -> Fit:
        """Fit points of rising x."""
        log_x, log_y = np.log(x), np.log(y)
        slope = float(np.polyfit(log_x, log_y, 1)[0])
        local = np.diff(log_y) / np.diff(log_x)
        linear_from = None
        for i in range(len(local) - 1, -1, -1):
            if not PROPORTIONAL[0] <= local[i] <= PROPORTIONAL[1]:
                break
            linear_from = float(x[i])
        fixed, per_unit = _affine(np.asarray(x, float), np.asarray(y, float))
        steps = tuple((float(later), float(step)) for later, step in zip(x[1:], local, strict=True))
        return cls(slope, fixed, per_unit, steps, linear_from)

    def sentence(self, axis: str, unit: Callable[[float], str], x_first: float) -> str:
        """What the fit says, in words.

        Args:
            axis: what x counts.
            unit: writes a cost.
            x_first: the smallest x measured.
        """
        each = axis.removesuffix("s") if x_first == 1 else f"{x_first:,.0f} {axis}"
        model = f"{unit(self.fixed)} + {unit(self.per_unit * x_first)} for every {each}"
        if self.linear_from is not None and self.linear_from <= x_first:
            return f"in proportion over the whole range ({model})"
        share = self.fixed / (self.fixed + self.per_unit * x_first)
        fixed = f"fixed costs are {share:.0%} of the smallest point's; {model}"
        if self.linear_from is not None:
            return f"in proportion from {self.linear_from:,.0f} {axis} on ({fixed})"
        at, last = self.steps[-1]
        trend = "faster" if last > PROPORTIONAL[1] else "slower"
        return f"{trend} than in proportion up to {at:,.0f} {axis}, slope {last:.2f} there ({fixed})"


def _affine(x: NDArray, y: NDArray) -> tuple[float, float]:
    """a, b ≥ 0 of the least squares of (a + b·x − y) / y."""
    (a, b), *_ = np.linalg.lstsq(np.column_stack([1 / y, x / y]), np.ones_like(y), rcond=None)
    if a < 0:
        return 0.0, float((x / y).sum() / ((x / y) ** 2).sum())
    if b < 0:
        return float((1 / y).sum() / (1 / y**2).sum()), 0.0
    return float(a), float(b)
