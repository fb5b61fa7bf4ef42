"""How do seconds and memory grow with pixels of photos, photos of captures, and Gaussians of clouds?

Each point is done once, in a process of its own.
"""

from __future__ import annotations

import json
import math
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from tinysplat_runtime import Runtime, load_scene
from tinysplat_runtime.codec.encoder import EncodeStats
from tinysplat_runtime.errors import TinySplatError
from tinysplat_runtime.render import Renderer
from tinysplat_runtime.scene.pictures import write_png
from tinysplat_runtime.system.stopwatch import Stopwatch

from ..clock import high_water_mark, measure_peak, reset_high_water_mark
from ..rows import Row, grouped
from ..show.tables import duration, format_table, megabytes
from ..study import Run, Study
from ..subjects.made import cloud, cloud_camera
from ..subjects.room import Motorcycle, Room

STAGES_FILE = "stages.json"

Size = tuple[int, int]

PHOTO_SIZES: tuple[Size, ...] = ((256, 256), (512, 512), (1024, 1024), (3024, 4032))
"""Of two photos that a command makes a file and a picture of; the last are a phone's."""

QUICK_SIZES = 2
"""How many of them, of captures and of clouds, the short form has."""

CAPTURES, CAPTURE_PHOTOS, CAPTURE_SIDE = (4, 12, 48, 200, 1000), 12, 64
"""Numbers of photos, how many of them show one place, and their side."""

LARGE_CAPTURE = 48
"""Photos from which on slopes are told: of fewer, what a command takes at all is much of the whole."""

CLOUDS = (131_072, 1_000_000, 3_000_000, 7_000_000)
CLOUD_PICTURES: tuple[Size, ...] = ((256, 256), (1080, 1920), (2160, 3840))
"""Clouds drawn at the middle size, and the second of them at all."""


def growth_rows(run: Run) -> Iterator[Row]:
    """Rows of the studies `growth TASK`, the axis as the subject; of captures alone where their photos are given."""
    if not run.options.views:
        yield from _photo_rows(run)
    yield from _capture_rows(run)
    if not run.options.views:
        yield from _cloud_rows(run)


def _photo_rows(run: Run) -> Iterator[Row]:
    """What users wait for: the motorcycle pair to a file and the file to a picture, each once in a process of its own.

    Rows `growth photos, TASK` of the whole and `growth photos, TASK: STAGE` of each stage, on photos of every size.
    """
    sizes = PHOTO_SIZES[:QUICK_SIZES] if run.quick else PHOTO_SIZES
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for height, width in sizes:
            try:
                _write_pair(folder, (height, width))
            except TinySplatError as error:  # scikit-image is not installed
                yield Row("growth photos", "pixels of a photo", f"2x{width}x{height}", note=str(error))
                return
            setting = {"x": height * width, "threads": run.threads}
            for task in ("encode", "render"):
                row = Row(f"growth photos, {task}", "pixels of a photo", f"2x{width}x{height}", setting)
                try:
                    peak = measure_peak(f"{__name__}.{task}_photos", folder, run.threads).total
                except (TinySplatError, subprocess.TimeoutExpired) as error:
                    rows.append(replace(row, note=str(error)))
                    break
                stages = json.loads((folder / STAGES_FILE).read_text("utf-8"))
                peak = max(peak, *(costs.get("peak_bytes", 0) for costs in stages.values()))
                seconds = sum(costs["seconds"] for costs in stages.values())
                rows.append(replace(row, costs={"seconds": seconds, "peak_bytes": peak}))
                rows += [replace(row, study=f"{row.study}: {at}", costs=costs) for at, costs in stages.items()]
    yield from sorted(rows, key=lambda row: row.study)


def _cloud_rows(run: Run) -> Iterator[Row]:
    """Rows `growth clouds, WAY` of one picture each in a process of its own, by Gaussians and by pixels."""
    counts = CLOUDS[:QUICK_SIZES] if run.quick else CLOUDS
    pictures = CLOUD_PICTURES[:QUICK_SIZES] if run.quick else CLOUD_PICTURES
    drawn = [("Gaussians", count, count, CLOUD_PICTURES[1]) for count in counts]
    drawn += [("pixels of the picture", size[0] * size[1], CLOUDS[1], size) for size in pictures]
    is_compiled = Renderer(cloud(100)).is_compiled
    for way in ("numpy", "compiled") if is_compiled else ("numpy",):
        for axis, x, count, (height, width) in drawn:
            with tempfile.TemporaryDirectory() as folder:
                row = Row(
                    f"growth clouds, {way}", axis, f"{count} at {width}×{height}", {"x": x, "threads": run.threads}
                )
                try:
                    peak = measure_peak(f"{__name__}.draw_cloud", folder, count, height, width, way, run.threads)
                except (TinySplatError, subprocess.TimeoutExpired) as error:
                    yield replace(row, note=str(error))
                    continue
                seconds = json.loads((Path(folder) / "seconds.json").read_text("utf-8"))
            yield replace(row, costs={"seconds": seconds, "peak_bytes": peak.total})


def draw_cloud(folder: str, count: str, height: str, width: str, way: str, threads: str) -> Callable[[], Any]:
    """A task: one picture of a cloud, prepared for that one; seconds go to `seconds.json`."""
    gaussians, camera = cloud(int(count)), cloud_camera(int(height), int(width))
    settings: dict[str, Any] = {"threads": int(threads), "compiled": way == "compiled", "keep": False}
    Renderer(cloud(100), **settings).render(camera, (16, 16))  # loads what is compiled

    def run() -> None:
        start = time.perf_counter()
        Renderer(gaussians, **settings).render(camera)
        (Path(folder) / "seconds.json").write_text(json.dumps(time.perf_counter() - start), "utf-8")

    return run


def _capture_rows(run: Run) -> Iterator[Row]:
    """Rows `growth captures`, a file and a picture each, in their own process: a capture repeated in far places."""
    height, width = run.options.size or (CAPTURE_SIDE, CAPTURE_SIDE)
    for count in run.options.views or (CAPTURES[:QUICK_SIZES] if run.quick else CAPTURES):
        row = Row("growth captures", "photos", f"{count}x{width}x{height}", {"x": count, "threads": run.threads})
        with tempfile.TemporaryDirectory() as folder:
            try:
                task = f"{__name__}.walk_capture"
                peak = measure_peak(task, folder, count, height, width, run.models[0], run.threads)
            except (TinySplatError, subprocess.TimeoutExpired) as error:
                yield replace(row, note=str(error))
                continue
            costs = json.loads((Path(folder) / STAGES_FILE).read_text("utf-8"))
        yield replace(row, figures={"bytes": costs.pop("bytes")}, costs={**costs, "peak_bytes": peak.total})


def walk_capture(folder: str, count: str, height: str, width: str, model: str, threads: str) -> Callable[[], Any]:
    """A task: so many photos to a file and a picture of it; seconds and bytes go to `STAGES_FILE`."""
    Room(CAPTURE_PHOTOS).write(Path(folder), (int(height), int(width)))
    scene, frames = load_scene(folder), []
    for number in range(int(count)):
        place, frame = number // CAPTURE_PHOTOS, scene.frames[number % CAPTURE_PHOTOS]
        c2w = frame.camera.c2w + 100 * place * np.eye(4, k=3)  # along x
        frames.append(replace(frame, camera=replace(frame.camera, c2w=c2w)))
    scene, runtime = replace(scene, frames=tuple(frames)), Runtime(threads=int(threads))

    def run() -> None:
        watch, before = Stopwatch(), time.process_time()
        with watch.stage("seconds"):
            gaussians = runtime.predict(scene, model)
            if find_spec("numba"):
                gaussians = runtime.refine(gaussians, scene)
            data = runtime.compress(gaussians, drop_invalid=True)
        figures = {"bytes": len(data), "cpu": time.process_time() - before}
        with watch.stage("frame"), runtime.open(BytesIO(data)) as file:
            camera = scene.cameras[0]
            Renderer(file.near(camera), int(threads), compiled=False).render(camera)
        (Path(folder) / STAGES_FILE).write_text(json.dumps({**watch.seconds, **figures}), "utf-8")

    return run


def _write_pair(folder: Path, size: Size) -> None:
    """The motorcycle pair as a scene folder of photos of a size."""
    Motorcycle().shots(Motorcycle().windows()[0][0], size).write(folder)


@dataclass
class _Weighed(Stopwatch):
    """Also notes the peak memory of every stage, in bytes; what is resident outside of stages is in none."""

    peaks: dict[str, int] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time and weigh the block under `name`."""
        reset_high_water_mark()
        try:
            with super().stage(name):
                yield
        finally:
            self.peaks[name] = max(self.peaks.get(name, 0), high_water_mark())


def encode_photos(folder: str, threads: str) -> Callable[[], Any]:
    """A task: the pair in a folder to a file there; seconds and peak memory of stages go to `STAGES_FILE`."""
    watch = _Weighed()
    scene, runtime, stats = load_scene(folder), Runtime(threads=int(threads)), EncodeStats(watch=watch)

    def run() -> None:
        (Path(folder) / "f.tsplat").write_bytes(runtime.encode(scene, size="full", stats=stats))
        stages = {name: {"seconds": s, "peak_bytes": watch.peaks[name]} for name, s in watch.seconds.items()}
        (Path(folder) / STAGES_FILE).write_text(json.dumps(stages), "utf-8")

    return run


def render_photos(folder: str, threads: str) -> Callable[[], Any]:
    """A task: that file to a picture of its first view, with numpy alone, as `encode_photos` has it."""
    runtime, watch = Runtime(threads=int(threads)), Stopwatch()

    def run() -> None:
        gaussians = runtime.decompress((Path(folder) / "f.tsplat").read_bytes(), watch=watch)
        with watch.stage("render"):
            image = Renderer(gaussians, int(threads), compiled=False).render(gaussians.cameras[0])
        with watch.stage("write"):
            write_png(Path(folder) / "picture.png", image)
        stages = {name: {"seconds": s} for name, s in watch.seconds.items()}
        (Path(folder) / STAGES_FILE).write_text(json.dumps(stages), "utf-8")

    return run


# ---- shown --------------------------------------------------------------------------------------------------------


def _growing(rows: Sequence[Row]) -> dict[tuple[str, str], list[Row]]:
    return grouped((row for row in rows if row.study.startswith("growth ") and row.costs), "study", "subject")


AXES = {
    ("growth captures", "photos"): "photos of a capture to a file",
    ("growth photos, encode", "pixels of a photo"): "pixels of each of two photos, to a file",
    ("growth photos, render", "pixels of a photo"): "the same, to a picture",
    ("growth clouds, numpy", "Gaussians"): "Gaussians of a picture, numpy",
    ("growth clouds, compiled", "Gaussians"): "Gaussians of a picture, compiled",
    ("growth clouds, compiled", "pixels of the picture"): "pixels of a picture, compiled",
}
"""What grows, by study and axis, in the order of the table."""


def growth_table(rows: Sequence[Row]) -> str:
    """A line per axis: from where to where, seconds and peak memory there, and by what power seconds grow."""
    growing, lines = _growing(rows), []
    for axis, said in AXES.items():
        members = sorted(growing.get(axis, []), key=lambda row: row.setting["x"])
        if len(members) < 2:
            continue
        seconds = [float(row.costs.get("cpu", row.seconds or 0.0)) for row in members]
        middle, last = (len(members) - 1) // 2, len(members) - 1
        lines.append(
            [
                said,
                *(f"{members[n].setting['x']:,}" for n in (0, last)),
                *(duration(seconds[n]) for n in (0, last)),
                *(megabytes(members[n].costs["peak_bytes"]) for n in (0, last)),
                _power(members[middle], members[last], seconds[middle], seconds[last]),
            ]
        )
    heads = ["what grows", "from", "to", "seconds", "seconds", "memory", "memory", "power"]
    return format_table(heads, lines) if lines else ""


def _power(first: Row, last: Row, before: float, after: float) -> str:
    times = math.log(after / before) / math.log(last.setting["x"] / first.setting["x"])
    return f"{times:.2f}".replace("-", "−")


def capture_table(rows: Sequence[Row]) -> str:
    """A line per number of photos of a capture, and by what power of that all of it grows."""
    captures = sorted(
        (row for row in rows if row.study == "growth captures" and row.costs), key=lambda r: r.setting["x"]
    )
    if not captures:
        return ""
    lines = [
        [
            f"{row.setting['x']:,}",
            duration(row.costs["cpu"]),
            megabytes(row.costs["peak_bytes"]),
            f"{row.figures['bytes'] / 1000:,.0f} KB",
        ]
        for row in captures
    ]
    table = format_table(["photos", "processor seconds", "peak memory", "file"], lines)
    size = captures[0].way.partition("x")[2].replace("x", "×")
    text = f"Photos of {size}, a capture of {CAPTURE_PHOTOS} of the room repeated in other places."
    large = [row for row in captures if row.setting["x"] >= LARGE_CAPTURE]
    if len(large) > 1:
        first, last = large[0], large[-1]

        def power(of: Callable[[Row], float]) -> str:
            return _power(first, last, of(first), of(last))

        photos = f"From {first.setting['x']} to {last.setting['x']:,} photos"
        grown = f"processor seconds grow by the power {power(lambda row: row.costs['cpu'])} of their number"
        bytes_too = f"bytes by {power(lambda row: row.figures['bytes'])}"
        text += f" {photos} {grown}, {bytes_too}, and memory by {power(lambda row: row.costs['peak_bytes'])}."
    return f"{text}\n\n{table}"


def photo_line(rows: Sequence[Row]) -> str:
    """What a user may expect of the largest photos that were measured, as a sentence."""
    growing = _growing(rows)
    parts = []
    for task, made in (("encode", "a file"), ("render", "a picture of it")):
        taken = [row for (study, _), members in growing.items() if study == f"growth photos, {task}" for row in members]
        if taken:
            last = max(taken, key=lambda row: row.setting["x"])
            costs = f"{duration(last.seconds)} and {megabytes(last.costs['peak_bytes'])}"
            parts.append(f"{made} {costs}")
            _, width, height = last.way.split("x")
    return f"Two photos of {width}×{height}, all pixels kept: {', '.join(parts)}." if parts else ""


GROWTH = Study(
    "Growth", growth_rows, {"growth": growth_table, "growth captures": capture_table, "growth photos": photo_line}
)
