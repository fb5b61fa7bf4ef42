"""How do seconds and memory grow with pixels of photos, photos of captures, and Gaussians of clouds?

Each point is done once, in a process of its own.
"""

import math
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tinysplat_runtime import Runtime, load_scene
from tinysplat_runtime.errors import TinySplatError
from tinysplat_runtime.list.views import views_about
from tinysplat_runtime.render import Renderer
from tinysplat_runtime.scene.pictures import write_png

from ..clock import measure_apart
from ..rows import Row, grouped, of_study
from ..show.tables import Listing, digits, duration, format_table, kilobytes, mean, megabytes, said
from ..study import Run, Study
from ..subjects.made import cloud, cloud_camera, statues
from ..subjects.room import write_motorcycle, write_room

Size = tuple[int, int]
Work = Callable[[], object]

PHOTO_SIZES: tuple[Size, ...] = ((256, 256), (512, 512), (1024, 1024), (3024, 4032))
"""Of two photos that a command makes a file and a picture of; the last are a phone's."""

QUICK_SIZES = 2
"""How many of them, of captures and of clouds, the short form has."""

CAPTURES: Sequence[int] = (4, 12, 48, 200, 1000)
CAPTURE_PHOTOS, CAPTURE_SIZE = 12, (64, 64)
"""Numbers of photos, how many of them show one place, and their size."""

LARGE_CAPTURE = 48
"""Photos from which on slopes are told: of fewer, what a command takes at all is much of the whole."""

CLOUDS: Sequence[int] = (131_072, 1_000_000, 3_000_000, 7_000_000)
CLOUD_PICTURE = (1080, 1920)

LISTS: Sequence[int] = (100_000, 1_000_000, 4_000_000, 10_000_000)
USUAL_LISTS, QUICK_LISTS = 2, 1
"""How many of them are done where nobody sets a limit: the others take an hour."""

ALL_KEPT, PRUNED = "all kept", "pruned"
"""Ways to code lists."""


def growth_rows(run: Run) -> Iterator[Row]:
    """Rows of the studies `growth TASK`, the axis as the subject; of captures alone where their photos are given, and
    of lists alone of as many Gaussians as the limit is, where that is given.
    """
    some = slice(QUICK_SIZES if run.quick else None)
    if run.options.limit:
        yield from list_rows(run, [count for count in LISTS if count <= run.options.limit])
        return
    if run.options.views:
        yield from capture_rows(run, run.options.views)
        return
    yield from photo_rows(run, PHOTO_SIZES[some])
    yield from capture_rows(run, CAPTURES[some])
    yield from cloud_rows(run, CLOUDS[some])
    yield from list_rows(run, LISTS[: QUICK_LISTS if run.quick else USUAL_LISTS])


def photo_rows(run: Run, sizes: Sequence[Size]) -> Iterator[Row]:
    """Rows `growth photos, TASK`: the motorcycle pair of every size to a file, and the file to a picture."""
    with tempfile.TemporaryDirectory() as folder:
        for height, width in sizes:
            way, setting = f"2x{width}x{height}", {"x": height * width, "threads": run.threads}
            try:
                write_motorcycle(Path(folder), height, width)
            except TinySplatError as error:  # scikit-image is not installed
                yield Row("growth photos", "pixels of a photo", way, note=str(error))
                return
            for task in ("encode", "render"):
                row = Row(f"growth photos, {task}", "pixels of a photo", way, setting)
                yield (row := _measured(row, f"{task}_photos", folder, run.threads))
                if row.note:
                    break


def capture_rows(run: Run, counts: Sequence[int]) -> Iterator[Row]:
    """Rows `growth captures` of a file each: a capture repeated in far places."""
    height, width = run.options.size or CAPTURE_SIZE
    for count in counts:
        row = Row("growth captures", "photos", f"{count}x{width}x{height}", {"x": count, "threads": run.threads})
        with tempfile.TemporaryDirectory() as folder:
            yield _measured(row, "encode_capture", folder, count, height, width, run.model, run.threads)


def cloud_rows(run: Run, counts: Sequence[int], picture: Size = CLOUD_PICTURE) -> Iterator[Row]:
    """Rows `growth clouds, WAY` of one picture each."""
    height, width = picture
    way = "compiled" if Renderer(cloud(100)).is_compiled else "numpy"
    for count in counts:
        setting = {"x": count, "threads": run.threads}
        row = Row(f"growth clouds, {way}", "Gaussians", f"{count} at {width}×{height}", setting)
        yield _measured(row, "draw_cloud", count, height, width, run.threads)


def list_rows(run: Run, counts: Sequence[int]) -> Iterator[Row]:
    """Rows `growth lists, WAY` in, out and drawn: made statues to a file, the file to Gaussians, and these to a
    picture.
    """
    for count in counts:
        for way in (ALL_KEPT, PRUNED):
            with tempfile.TemporaryDirectory() as folder:
                for task in ("in", "out", "drawn"):
                    setting = {"x": count, "threads": run.threads}
                    row = Row(f"growth lists, {way}, {task}", "Gaussians", str(count), setting)
                    yield (row := _measured(row, f"list_{task}", folder, count, way, run.threads))
                    if row.note:
                        break


def _measured(row: Row, task: str, *arguments: object) -> Row:
    """The row with what a task took, or why it could not be done."""
    try:
        taken = measure_apart(f"{__name__}.{task}", *arguments)
    except TinySplatError as error:
        return replace(row, note=str(error))
    costs = {"seconds": taken.seconds, "cpu": taken.cpu, "peak_bytes": taken.total}
    return replace(row, figures=taken.figures, costs=costs)


def draw_cloud(count: str, height: str, width: str, threads: str) -> Work:
    """A task: one picture of a cloud, prepared for that one."""
    gaussians, camera = cloud(int(count)), cloud_camera(int(height), int(width))
    settings: dict[str, Any] = {"threads": int(threads), "keep": False}
    Renderer(cloud(100), **settings).render(camera, (16, 16))  # loads what is compiled

    def work() -> None:
        Renderer(gaussians, **settings).render(camera)

    return work


def encode_capture(folder: str, count: str, height: str, width: str, model: str, threads: str) -> Work:
    """A task: so many photos to a file."""
    write_room(Path(folder), CAPTURE_PHOTOS, int(height), int(width))
    scene, frames = load_scene(folder), []
    for number in range(int(count)):
        place, frame = number // CAPTURE_PHOTOS, scene.frames[number % CAPTURE_PHOTOS]
        c2w = frame.camera.c2w + 100 * place * np.eye(4, k=3)  # along x
        frames.append(replace(frame, camera=replace(frame.camera, c2w=c2w)))
    scene, runtime = replace(scene, frames=tuple(frames)), Runtime(threads=int(threads))

    def work() -> dict[str, int]:
        gaussians = runtime.predict(scene, model)
        return {"bytes": len(runtime.compress(gaussians, drop_invalid=True))}

    return work


def encode_photos(folder: str, threads: str) -> Work:
    """A task: the pair in a folder to a file there."""
    scene, runtime = load_scene(folder), Runtime(threads=int(threads))

    def work() -> None:
        (Path(folder) / "f.tsplat").write_bytes(runtime.encode(scene, size="full"))

    return work


def render_photos(folder: str, threads: str) -> Work:
    """A task: that file to a picture of its first view, with numpy alone, as `encode_photos` has it."""

    def work() -> None:
        gaussians = Runtime(threads=int(threads)).decompress((Path(folder) / "f.tsplat").read_bytes())
        image = Renderer(gaussians, int(threads), compiled=False).render(gaussians.cameras[0])
        write_png(Path(folder) / "picture.png", image)

    return work


def list_in(folder: str, count: str, way: str, threads: str) -> Work:
    """A task: so many Gaussians of degree 3 to a file there."""
    gaussians, runtime = statues(int(count)), Runtime(threads=int(threads))
    runtime.compress(statues(100), keep_all=True)  # loads what is compiled

    def work() -> dict[str, int]:
        data = runtime.compress(gaussians, keep_all=way == ALL_KEPT)
        (Path(folder) / "f.tsplat").write_bytes(data)
        return {"bytes": len(data)}

    return work


def list_out(folder: str, count: str, way: str, threads: str) -> Work:
    """A task: that file to Gaussians."""

    def work() -> dict[str, int]:
        found = Runtime(threads=int(threads)).decompress((Path(folder) / "f.tsplat").read_bytes())
        return {"gaussians": found.count}

    return work


def list_drawn(folder: str, count: str, way: str, threads: str) -> Work:
    """A task: that file's Gaussians to a picture of all of them, prepared for that one."""
    gaussians = Runtime(threads=int(threads)).decompress((Path(folder) / "f.tsplat").read_bytes())
    camera = views_about(gaussians, 1)[0].resized(*CLOUD_PICTURE)
    Renderer(statues(100), int(threads), keep=False).render(camera, (16, 16))  # loads what is compiled

    def work() -> None:
        Renderer(gaussians, int(threads), keep=False).render(camera)

    return work


# ---- shown --------------------------------------------------------------------------------------------------------


AXES = {
    ("growth captures", "photos"): "photos of a capture to a file",
    ("growth photos, encode", "pixels of a photo"): "pixels of each of two photos, to a file",
    ("growth clouds, compiled", "Gaussians"): "Gaussians of a picture",
}
"""What grows, by study and axis, in the order of the table."""

LIST_AXES = {
    (f"growth lists, {way}, {task}", "Gaussians"): label
    for way, first in ((ALL_KEPT, "all kept"), (PRUNED, "by default"))
    for task, label in (
        ("in", f"Gaussians of degree 3 to a file, {first}"),
        ("out", "the file to Gaussians"),
        ("drawn", "these to a picture"),
    )
}


def growth_table(rows: Sequence[Row], axes: Mapping[tuple[str, str], str] = AXES) -> str:
    """A line per axis: from where to where, seconds (of processors for captures and lists) and peak memory there, and
    by what power seconds grow.
    """
    growing, lines = grouped((row for row in rows if row.costs), "study", "subject"), []
    for (study, axis), label in axes.items():
        members = sorted(growing.get((study, axis), []), key=lambda row: row.setting["x"])
        if len(members) < 2:
            continue
        clock = "cpu" if study.startswith(("growth captures", "growth lists")) else "seconds"
        first, middle, last = (members[n] for n in (0, (len(members) - 1) // 2, -1))
        lines.append(
            [
                label,
                *(f"{row.setting['x']:,}" for row in (first, last)),
                *(duration(row.costs[clock]) for row in (first, last)),
                *(megabytes(row.costs["peak_bytes"]) for row in (first, last)),
                _power(middle, last, lambda row, clock=clock: row.costs[clock]),  # type: ignore[misc]
            ]
        )
    heads = ["what grows", "from", "to", "seconds", "seconds", "memory", "memory", "power"]
    return format_table(heads, lines) if lines else ""


def _power(first: Row, last: Row, of: Callable[[Row], float]) -> str:
    times = math.log(of(last) / of(first)) / math.log(last.setting["x"] / first.setting["x"])
    return f"{times:.2f}".replace("-", "−")


_CAPTURES = Listing(
    "growth captures",
    {
        "photos": said("x", "{:,}".format),
        "processor seconds": mean("cpu", duration, "costs"),
        "peak memory": mean("peak_bytes", megabytes, "costs"),
        "file": mean("bytes", lambda count: f"{count / 1000:,.0f} KB"),
    },
)


def capture_table(rows: Sequence[Row]) -> str:
    """A line per number of photos of a capture, and by what power of that all of it grows."""
    captures = sorted((row for row in of_study(rows, "growth captures") if row.costs), key=lambda r: r.setting["x"])
    if not captures:
        return ""
    size = captures[0].way.partition("x")[2].replace("x", "×")
    text = f"Photos of {size}, a capture of {CAPTURE_PHOTOS} of the room repeated in other places."
    large = [row for row in captures if row.setting["x"] >= LARGE_CAPTURE]
    if len(large) > 1:
        first, last = large[0], large[-1]
        seconds = _power(first, last, lambda row: row.costs["cpu"])
        size = _power(first, last, lambda row: row.figures["bytes"])
        memory = _power(first, last, lambda row: row.costs["peak_bytes"])
        text += (
            f" From {first.setting['x']} to {last.setting['x']:,} photos processor seconds grow by the power {seconds}"
            f" of their number, bytes by {size}, and memory by {memory}."
        )
    return f"{text}\n\n{_CAPTURES.table(captures)}"


def photo_line(rows: Sequence[Row]) -> str:
    """What a user may expect of the largest photos that were measured, as a sentence."""
    parts = []
    for task, made in (("encode", "a file"), ("render", "a picture of it")):
        taken = [row for row in of_study(rows, f"growth photos, {task}") if row.costs]
        if taken:
            last = max(taken, key=lambda row: row.setting["x"])
            parts.append(f"{made} {duration(last.seconds)} and {megabytes(last.costs['peak_bytes'])}")
            _, width, height = last.way.split("x")
    return f"Two photos of {width}×{height}, all pixels kept: {', '.join(parts)}." if parts else ""


GROWTH = Study(
    "Growth",
    growth_rows,
    {
        "growth in short": growth_table,
        "growth lists": partial(growth_table, axes=LIST_AXES),
        "growth captures": capture_table,
        "growth photos": photo_line,
        "phone": Listing(
            "phone", {"": said("way"), "CPU s": mean("cpu", digits(0), "costs"), "KB": mean("bytes", kilobytes)}
        ),
    },
)
