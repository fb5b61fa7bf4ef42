"""Does another way to make files of photos replace today's? `encode` as it is, on captures and windows, way by way.

Every fourth photo of a capture is left out, and pictures are drawn from the file that `encode` makes of the others.
Photos of at most `SMALL` pixels across are 24, of `--size`; larger ones are all taken, at the size that `encode`
chooses. Of the first scenes with `eval_index.json`, windows of three, four and six photos are measured too. A further
run with `--mode` adds the rows of another way.
"""

import itertools
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import replace

from tinysplat_runtime.codec.job import EncodeStats
from tinysplat_runtime.recipe.encode import encode
from tinysplat_runtime.recipe.prepare import prepared
from tinysplat_runtime.recipe.request import EncodeRequest
from tinysplat_runtime.scene.scenes import Scene

from ..clock import cpu_of
from ..pictures import as_photos, to_photos
from ..rows import Row
from ..show.tables import ABSENT, Cell, Listing, Write, decibels, digits, kilobytes, said
from ..study import Run, Study
from ..subjects.captures import Capture
from ..subjects.sources import EVAL_INDEX, FolderSource

STUDY = "gate"

SMALL = 512
"""Pixels of the longer side of photos that were made small for measuring."""

PHOTOS = 24
"""Of a capture of small photos."""

WINDOW_SCENES, WINDOWS = 6, (3, 4, 6)
"""Scenes whose windows are measured; and their photos."""

BEFORE, AFTER = "gaussians", "list"
"""Ways that the table compares."""


def gate_rows(run: Run) -> Iterator[Row]:
    """A row per capture and window."""
    seen = itertools.count()

    def of_scene(name: str, scene: Scene) -> Iterator[Row]:
        camera = scene.cameras[0]
        is_small = max(camera.width, camera.height) <= SMALL
        capture = Capture.of(scene)
        given = capture.given(PHOTOS).resized(*run.size) if is_small else capture.others
        targets = capture.targets.resized(*run.size) if is_small else capture.targets
        yield _row(run, name, "capture" if is_small else "large capture", given, targets)
        source = FolderSource(scene.path)
        if (scene.path / EVAL_INDEX).is_file() and next(seen) < WINDOW_SCENES:
            windows = {len(window.context): window for window in reversed(source.windows()[0])}
            for count in WINDOWS:
                window = windows[max(count, 4)]
                context, left_out = (scene.views(views) for views in (window.context[:count], window.targets))
                yield _row(run, name, f"window of {count}", context.resized(*run.size), left_out.resized(*run.size))

    return run.of_scenes(of_scene)


def _row(run: Run, name: str, kind: str, given: Scene, targets: Scene) -> Row:
    """A file of photos by default, and its pictures at photos left out."""
    scene, stats = replace(given, near=None, far=None), EncodeStats()
    request = EncodeRequest(scene, model=run.model, mode=run.options.mode)
    made, cpu = cpu_of(lambda: encode(request, run.runtime, stats=stats, keep=True))
    assert made.gaussians is not None
    camera = prepared(request).cameras[0]
    height, width = run.options.drawn or (camera.height, camera.width)
    targets = targets.resized(height, width)
    decoded = run.runtime.decompress(made.data)
    setting = {"kind": kind, "photos": len(made.photos.frames), "size": f"{camera.width}×{camera.height}"}
    setting |= {"drawn": f"{width}×{height}", "model": run.model}
    figures = to_photos(as_photos(decoded, targets.cameras, run.threads), targets)
    figures |= {"bytes": len(made.data), "gaussians": decoded.count}
    return Row(STUDY, name, stats.mode, setting, figures, {"cpu": cpu, **stats.watch.seconds})


def _of(way: str, name: str, write: Write, kind: str = "figures") -> Cell:
    """Mean of a figure over a way's rows of subjects that both ways were measured on; a dash for none."""

    def cell(rows: Sequence[Row]) -> str:
        both = set.intersection(*({row.subject for row in rows if row.way == one} for one in (BEFORE, AFTER)))
        own = [row for row in rows if row.way == way and (row.subject in both or not both)]
        found = [getattr(row, kind)[name] for row in own if name in getattr(row, kind)]
        return write(statistics.fmean(found)) if found else ABSENT

    return cell


def _pair(name: str, write: Write, kind: str = "figures") -> Cell:
    """Both ways' means of a figure."""
    return lambda rows: " → ".join(_of(way, name, write, kind)(rows) for way in (BEFORE, AFTER))


def _fails(rows: Sequence[Row]) -> str:
    """By which figures the second way fails on a subject: dB, its worst, SSIM, all fitted."""
    ways = {row.way: row.figures for row in rows}
    if not {BEFORE, AFTER} <= set(ways):
        return ABSENT
    limits = {"fitted": -0.3, "fitted_worst": -0.5, "fitted_ssim": -0.003}
    lost = {name: ways[AFTER][name] - ways[BEFORE][name] for name in limits}
    return ", ".join(
        f"{name.removeprefix('fitted_')} {lost[name]:+.3f}" for name in limits if lost[name] < limits[name]
    )


_COLUMNS: dict[str, Cell] = {
    "dB": _pair("psnr", decibels),
    "worst": _pair("worst", decibels),
    "fitted": _pair("fitted", decibels),
    "worst fitted": _pair("fitted_worst", decibels),
    "SSIM fitted": _pair("fitted_ssim", digits(3)),
    "FLIP fitted": _pair("fitted_flip", digits(3)),
    "sharpness": _pair("sharpness", digits(2)),
    "KB": _pair("bytes", kilobytes),
    "Gaussians": _of(AFTER, "gaussians", lambda value: f"{value:,.0f}"),
    "CPU s": _pair("cpu", digits(0), "costs"),
}

GATE = Study(
    "Gate",
    gate_rows,
    {
        STUDY: Listing(
            STUDY,
            {"scene": said("subject"), "photos": said("photos"), "size": said("size"), **_COLUMNS, "fails": _fails},
            by=("subject", "kind"),
            sections="kind",
        ),
        f"{STUDY} means": Listing(
            STUDY,
            {"": said("kind"), "scenes": lambda rows: str(sum(row.way == AFTER for row in rows)), **_COLUMNS},
            by=("kind",),
        ),
    },
)
