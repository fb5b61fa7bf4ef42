"""What does pruning leave of captures as one list, with cameras of their photos and without?

Every fourth photo of a capture is left out. Up to 24 of the others are encoded, decoded and fused (`decode --fuse`),
and that list is compressed at each Q_g: as by a user who has no cameras, by one who has those of the photos, and with
all kept. A point is a file's bytes, and dB of pictures of up to eight photos left out against these, and against
pictures of the list as it was.
"""

from __future__ import annotations

import statistics
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.formats.table import load_gaussians, save_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.recipe.words import ALL
from tinysplat_runtime.render import DEFINITION
from tinysplat_runtime.scene.scenes import Scene

from ..curves import bytes_at
from ..pictures import PictureJudge
from ..rows import Row
from ..show.tables import ABSENT, Cell, Listing, decibels, kilobytes, mean, said
from ..study import Run, Study
from ..subjects.captures import Capture
from ..subjects.cases import Case

STUDY = "pruned"
BLIND, SEEING, WHOLE = "no cameras", "cameras", "all kept"
QPS = (0.0, 6.0, 12.0)
GIVEN = 24
STEPS, QUICK_STEPS = 240, 4
"""Of fusing."""


def pruned_rows(run: Run) -> Iterator[Row]:
    """A row per scene, way and Q_g."""
    return run.of_scenes(lambda name, scene: _scene_rows(name, Capture.of(scene.resized(*run.size)), run))


def _scene_rows(name: str, capture: Capture, run: Run) -> Iterator[Row]:
    targets, given = capture.targets, _one_list(name, capture.given(GIVEN), run)
    blind = replace(given, viewpoints=())
    case = replace(Case.without_photos(name, blind, targets.cameras), photos=tuple(targets.images()))
    pictures = PictureJudge(case, run.threads, **DEFINITION)
    rows = []
    for qp in run.options.qps or QPS:
        rows.append(_row(pictures, WHOLE, qp, blind, run.runtime, keep_all=True))
        for way, gaussians in ((BLIND, blind), (SEEING, given)):
            rows.append(_row(pictures, way, qp, gaussians, run.runtime))
    for row in rows:
        yield replace(row, figures={**row.figures, **_beside(row, rows)} if row.way == WHOLE else row.figures)


def _beside(whole: Row, rows: Sequence[Row]) -> dict[str, float]:
    """Bytes with cameras for as many dB as a file with all kept has, to photos and to the list."""
    reference: dict[str, float] = {}
    for name, db in (("bytes_pruned", "psnr"), ("bytes_pruned_raw", "psnr_decoded_raw")):
        points = [(row.figures["bytes"], row.figures[db]) for row in rows if row.way == SEEING]
        beside = bytes_at(points, whole.figures[db])
        reference |= {name: beside} if beside else {}
    return reference


def _one_list(name: str, scene: Scene, run: Run) -> Gaussians:
    """A capture of these photos, fused. It is kept in the report's folder, where the next run finds it."""
    from tinysplat_runtime.refine.fuse import fused

    path = run.folder / f"{name}.npz"
    if not path.exists():
        capture = run.runtime.decompress(run.runtime.encode(scene, views=ALL, size="full"))
        steps = QUICK_STEPS if run.quick else STEPS
        run.folder.mkdir(parents=True, exist_ok=True)
        save_gaussians(path, fused(capture, steps=steps, threads=run.threads))
    return load_gaussians(path)


def _row(
    pictures: PictureJudge, way: str, qp: float, given: Gaussians, runtime: Runtime, *, keep_all: bool = False
) -> Row:
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        data = runtime.compress(given, qp=qp, keep_all=keep_all)
    decoded = runtime.decompress(data)
    figures = {"bytes": len(data), "given": given.count, "kept": decoded.count, **pictures.figures(decoded)}
    return Row(STUDY, pictures.case.name, way, {"qp": qp}, figures, note="; ".join(str(one.message) for one in heard))


def _of(way: str, cell: Cell) -> Cell:
    """A cell of one way's rows."""
    return lambda rows: cell([row for row in rows if row.way == way])


def _most_lost(rows: Sequence[Row]) -> str:
    """dB to photos that the default loses to keeping all, without cameras, at most."""
    to_photos = {(row.way, row.setting["qp"]): row.figures["psnr"] for row in rows}
    lost = [psnr - to_photos[BLIND, qp] for (way, qp), psnr in to_photos.items() if way == WHOLE]
    return decibels(max(lost)) if lost else ABSENT


def _lost(way: str) -> Cell:
    """dB to photos that a way loses to the list as it was, by Q_g."""
    return lambda rows: ", ".join(decibels(row.figures["db_lost"]) for row in rows if row.way == way)


def _share(name: str) -> Cell:
    """Bytes with cameras at the dB of all kept, over those of all kept."""

    def cell(rows: Sequence[Row]) -> str:
        shares = [row.figures[name] / row.figures["bytes"] for row in rows if name in row.figures]
        return f"{statistics.fmean(shares):.2f}" if shares else ABSENT

    return cell


def _point(way: str) -> Cell:
    """KB, dB to photos and, in brackets, to the list."""
    size, photos = _of(way, mean("bytes", kilobytes)), _of(way, mean("psnr", decibels))
    raw = _of(way, mean("psnr_decoded_raw", decibels))
    return lambda rows: f"{size(rows)} KB, {photos(rows)} ({raw(rows)})"


_POINTS = {
    "as it is, dB": mean("psnr_raw", decibels),
    WHOLE: _point(WHOLE),
    BLIND: _point(BLIND),
    SEEING: _point(SEEING),
}
_SHARES = {"bytes with cameras at these dB": _share("bytes_pruned"), "at those in brackets": _share("bytes_pruned_raw")}

PRUNED = Study(
    "Captures as one list, pruned",
    pruned_rows,
    {
        STUDY: Listing(
            STUDY,
            {"capture": said("subject"), "Q_g": said("qp", "{:g}".format), **_POINTS, **_SHARES},
            by=("subject", "qp"),
        ),
        f"{STUDY} in short": Listing(
            STUDY,
            {
                "capture": said("subject"),
                "Gaussians": lambda rows: f"{rows[0].figures['given']:,}",
                "dB lost by Q_g, all kept": _lost(WHOLE),
                BLIND: _lost(BLIND),
                SEEING: _lost(SEEING),
                "no cameras against all kept, at most": _most_lost,
                "bytes with cameras at the dB of all kept": _share("bytes_pruned"),
                "at its dB to the list": _share("bytes_pruned_raw"),
            },
            by=("subject",),
        ),
    },
)
