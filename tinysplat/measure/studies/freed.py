"""What do Gaussians that belong to no pixels cost, in `.tsplat` and in other formats, at equal dB?

A trained scene's file, or the made room as a list of points, goes into mode free over Q_g and into the other formats as
`convert` writes them, those of SPZ over the bits of its SH coefficients. A point is a file's bytes and the mean dB of
pictures from all sides against those of the Gaussians as they were read.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from tinysplat_runtime.api import SUFFIX
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.table import load_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render.paths import ring
from tinysplat_runtime.scene.cameras import Camera

from ..curves import bytes_at
from ..pictures import Drawing, Pictures
from ..rows import Row
from ..show.plots import Axis, Chart
from ..show.tables import ABSENT, Cell, Listing, decibels, kilobytes, mean, said
from ..study import Run, Study
from ..subjects.cases import Case
from ..subjects.made import made_gaussians
from ..ways import Way, file_way, free_way, spz_ways

VIEWS, QUICK_VIEWS = 6, 2
QPS, QUICK_QPS = (-24.0, -18.0, -12.0, -6.0, -3.0, 0.0, 3.0, 6.0, 9.0), (-6.0, 0.0, 6.0)
_ROOM_VIEWS, _DEGREE = 2, 3

OURS = f"`{SUFFIX}`"

MOST_DB = 90
"""Above it a file holds what it was read from, as its own format does; its dB would flatten the others on a plot."""


def free_rows(run: Run) -> Iterator[Row]:
    """A row per file and setting: bytes, bytes a Gaussian, dB; of other formats also what ours takes at their dB."""
    ours = free_way(OURS, run.options.qps or (QUICK_QPS if run.quick else QPS), run.runtime)
    others = [*spz_ways(), file_way("SOG", ".sog"), file_way("compressed PLY", ".compressed.ply")]
    for case in _cases(run):
        pictures = Pictures(case, Drawing.as_defined(run.threads))
        curve = [_point(ours, qp, pictures) for qp in ours.settings]
        points = [(row.figures["bytes"], row.figures["psnr_decoded_raw"]) for row in curve]
        yield from curve
        for way in (one for one in others if not one.refuses(case)):
            for setting in way.settings:
                row = _point(way, setting, pictures)
                beside = bytes_at(points, row.figures["psnr_decoded_raw"])
                yield replace(row, figures={**row.figures, **({"bytes_ours": beside} if beside else {})})


def _point(way: Way, setting: float, pictures: Pictures) -> Row:
    case = pictures.case
    data = way.encode(case, setting)
    figures = {"bytes": len(data), "bytes_each": len(data) / case.gaussians.count}
    figures |= pictures.figures(way.decode(case, data))
    return Row("free", case.name, way.name, {"qp": setting}, figures)


def _cases(run: Run) -> Iterator[Case]:
    views = QUICK_VIEWS if run.quick else VIEWS
    if not run.paths:
        side = run.side // 2
        room = made_gaussians(_ROOM_VIEWS, side, side, _DEGREE)
        yield _seen(f"room, {_ROOM_VIEWS}×{side}², SH degree {_DEGREE}", room.flat(), room.cameras)
    for path in run.paths:
        try:
            gaussians = load_gaussians(path).flat()
        except InputError as error:
            run.left_out.append(f"left out {error}")
            continue
        name = f"{path.name}, {gaussians.count:,} of SH degree {gaussians.degree}"
        yield _seen(name, gaussians, tuple(ring(gaussians, views)))


def _seen(name: str, gaussians: Gaussians, cameras: tuple[Camera, ...]) -> Case:
    nothing = (None,) * len(cameras)
    return Case(name, name, gaussians, cameras, nothing, nothing)


def _each(rows: Sequence[Row]) -> str:
    return f"{rows[0].figures['bytes_each']:.2f}"


def _setting(rows: Sequence[Row]) -> str:
    return f"{rows[0].setting['qp']:g}" if rows[0].way == OURS else ABSENT


def _share(rows: Sequence[Row]) -> str:
    """What ours takes at the same dB, between its own points."""
    figures = rows[0].figures
    return f"{figures['bytes_ours'] / figures['bytes']:.0%}" if "bytes_ours" in figures else ABSENT


def _in_short(way: str, qp: float | None = None) -> Cell:
    """KB and dB of a way's first row, or of that at Q_g, and what ours takes for as many dB."""

    def cell(rows: Sequence[Row]) -> str:
        chosen = [row for row in rows if row.way == way and qp in (None, row.setting["qp"])][:1]
        if not chosen:
            return ABSENT
        size, level, share = mean("bytes", kilobytes)(chosen), _DB(chosen), _share(chosen)
        return f"{size} KB, {level} dB" + (f" (ours {share})" if share != ABSENT else "")

    return cell


_DB = mean("psnr_decoded_raw", decibels)
_POINTS = Listing(
    "free",
    {
        "format": said("way"), "Q_g": _setting, "KB": mean("bytes", kilobytes), "bytes a Gaussian": _each,
        "dB to its source": _DB, "ours at that dB": _share,
    },
    sections="subject",
)  # fmt: skip

_SCENES = Listing(
    "free",
    {"Gaussians": said("subject"), f"{OURS}, Q_g 0": _in_short(OURS, 0.0), f"{OURS}, Q_g 6": _in_short(OURS, 6.0),
     **{name: _in_short(name) for name in ("SPZ v4", "SOG", "compressed PLY")}},
    by=("subject",),
)  # fmt: skip

FREE = Study(
    "Gaussians of no pixels",
    free_rows,
    {"free": _POINTS, "free in short": _SCENES},
    {"free": Chart("free", "Gaussians of no pixels: bytes against dB to their source, by format",
                   Axis("bytes", "KB", unit=1e-3), Axis("psnr_decoded_raw", "dB, decoded to raw", most=MOST_DB),
                   panel="subject")},
)  # fmt: skip
