"""What do lists cost, in `.tsplat` and in other formats, at equal dB?

A trained scene's file, or a made statue, goes into mode list over Q_g: as it is by default, without what
pictures hardly need, and whole. It goes into other formats as `convert` writes them. A point is a file's bytes and the
mean dB of pictures from all sides, at which removal did not look, against those of the Gaussians as they were read. A
folder with photos behind a file is the scene that it was trained on: then pictures are taken from every eighth photo,
from the fifth on, which training should not have seen, and are held against these, too.
"""

import math
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.codec.job import EncodeStats, Job
from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE, find_profile
from tinysplat_runtime.container.layout import SUFFIX
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.formats.table import load_gaussians, save_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.list.coding.rounding import Rounding
from tinysplat_runtime.list.pruning.encoder import PruningEncoder
from tinysplat_runtime.list.views import from_anywhere, views_of
from tinysplat_runtime.list.visible import visible
from tinysplat_runtime.modes.list import encoder as encoder_of
from tinysplat_runtime.render import DEFINITION
from tinysplat_runtime.render.paths import ring
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.intake.layouts import load_scene

from ..pictures import PictureJudge, mean_psnr
from ..rows import Row
from ..show.tables import ABSENT, Cell, Listing, decibels, kilobytes, mean, said
from ..study import Run, Study
from ..subjects.made import statues

STUDY = "list"

VIEWS, QUICK_VIEWS = 6, 2
QPS, QUICK_QPS = (0.0, -12.0, -6.0, 6.0), (-6.0, 0.0, 6.0)
UNSEEN = slice(4, None, 8)
"""Photos that a scene was not trained on."""

MADE, QUICK_MADE = 25_000, 2_500
"""Gaussians where no file is given."""

OURS, WHOLE = f"`{SUFFIX}`", f"`{SUFFIX}`, all kept"

Point = tuple[float, float]
"""Bytes of a file, and dB of its pictures."""

OTHERS = {"SPZ v4": ".spz", "SOG": ".sog", "compressed PLY": ".compressed.ply"}
"""Other formats as `convert` writes them: suffixes."""


@dataclass(frozen=True, eq=False)
class Subject:
    """A list that is coded.

    Attributes:
        name: for reports.
        pictures: of it as it was read.
        photos: (H, W, 3) per picture; empty where there are none.
    """

    name: str
    pictures: PictureJudge
    photos: NDArray | tuple[()] = ()

    def row(self, way: str, qp: float, data: bytes, decoded: Gaussians) -> Row:
        """What a file of it is like."""
        images, _ = self.pictures.render(decoded)
        figures = {"bytes": len(data), "kept": decoded.count, "psnr_decoded_raw": mean_psnr(images, self.pictures.raw)}
        if len(self.photos):
            figures["psnr"] = mean_psnr(images, self.photos)
        return Row(STUDY, self.name, way, {"qp": qp}, figures)


def list_rows(run: Run) -> Iterator[Row]:
    """A row per file and setting: bytes, how many are left, dB; of other formats also what ours takes at their dB."""
    for subject in _subjects(run):
        curve = list(_own(run, subject))
        points = [(row.figures["bytes"], row.figures["psnr_decoded_raw"]) for row in curve if row.way == OURS]
        yield from curve
        for name, suffix in OTHERS.items():
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder, f"g{suffix}")
                save_gaussians(path, subject.pictures.gaussians, spz_version=4)
                row = subject.row(name, 0.0, path.read_bytes(), load_gaussians(path))
            beside = bytes_at(points, row.figures["psnr_decoded_raw"])
            yield replace(row, figures={**row.figures, **({"bytes_ours": beside} if beside else {})})


def _own(run: Run, subject: Subject) -> Iterator[Row]:
    """Files of ours; what pictures need is ranked once."""
    gaussians, profile = subject.pictures.gaussians, find_profile(DEFAULT_PROFILE)
    shown = visible(gaussians)
    views = from_anywhere(views_of(shown), shown)
    job = Job(gaussians, profile, 0.0, run.runtime.store, run.threads, EncodeStats())
    rounding = Rounding.of(shown, views, run.threads, profile.list_steps)
    pruning, whole = PruningEncoder(job, views, rounding), encoder_of(job, rounding)
    for qp in run.options.qp or (QUICK_QPS if run.quick else QPS):
        for way, encoder in ((OURS, pruning), (WHOLE, whole)):
            data = encoder.code(qp)
            yield subject.row(way, qp, data, run.runtime.decompress(data))


def _subjects(run: Run) -> Iterator[Subject]:
    views = QUICK_VIEWS if run.quick else VIEWS

    def seen(gaussians: Gaussians, cameras: Sequence[Camera]) -> PictureJudge:
        return PictureJudge(gaussians, cameras, run.threads, **DEFINITION)

    if not run.paths:
        statue = statues(QUICK_MADE if run.quick else MADE)
        yield Subject(f"a statue, {statue.count:,} of SH degree 3", seen(statue, ring(statue, views)))
    for path, behind in zip_longest(run.paths, run.paths[1:]):
        if path.is_dir():
            continue
        try:
            gaussians = load_gaussians(path).flat()
            photos = load_scene(behind) if behind is not None and behind.is_dir() else None
        except InputError as error:
            run.left_out.append(f"left out {error}")
            continue
        name = f"{path.name}, {gaussians.count:,} of SH degree {gaussians.degree}"
        if photos is None:
            yield Subject(name, seen(gaussians, ring(gaussians, views)))
        else:
            unseen = photos.views(range(len(photos.frames))[UNSEEN])
            yield Subject(name, seen(gaussians, unseen.cameras), unseen.images(judged=True))


def _share(rows: Sequence[Row]) -> str:
    """What ours takes at the same dB, between its own points."""
    figures = rows[0].figures
    return f"{figures['bytes_ours'] / figures['bytes']:.0%}" if "bytes_ours" in figures else ABSENT


def bytes_at(points: Iterable[Point], db: float) -> float | None:
    """Bytes that a curve needs for a PSNR, between its points on a scale of decibels; None outside them."""
    rising: list[tuple[float, float]] = []  # dB and log bytes; points that others beat in both are left out
    for size, level in sorted(points, key=lambda p: (p[0], -p[1])):
        if not rising or level > rising[-1][0]:
            rising.append((level, math.log(size)))
    if len(rising) < 2 or not rising[0][0] <= db <= rising[-1][0]:
        return None
    levels, sizes = zip(*rising, strict=True)
    return math.exp(float(np.interp(db, levels, sizes)))


def _in_short(way: str, qp: float | None = None) -> Cell:
    """KB and dB of a way's first row, or of that at Q_g, and what ours takes for as many dB."""

    def cell(rows: Sequence[Row]) -> str:
        chosen = [row for row in rows if row.way == way and qp in (None, row.setting["qp"])][:1]
        if not chosen:
            return ABSENT
        size, level, share = (
            mean("bytes", kilobytes)(chosen),
            mean("psnr_decoded_raw", decibels)(chosen),
            _share(chosen),
        )
        return f"{size} KB, {level} dB" + (f" (ours {share})" if share != ABSENT else "")

    return cell


_POINTS = Listing(
    STUDY,
    {
        "format": said("way"),
        "Q_g": said("qp", "{:g}".format),
        "KB": mean("bytes", kilobytes),
        "dB to its source": mean("psnr_decoded_raw", decibels),
        "dB to photos": mean("psnr", decibels),
        "ours at that dB": _share,
    },
    sections="subject",
)

_SCENES = Listing(
    STUDY,
    {
        "Gaussians": said("subject"),
        f"{OURS}, Q_g 0": _in_short(OURS, 0.0),
        "Q_g 6": _in_short(OURS, 6.0),
        "all kept, Q_g 0": _in_short(WHOLE, 0.0),
        **{name: _in_short(name) for name in OTHERS},
    },
    by=("subject",),
)

LIST = Study("Lists of Gaussians", list_rows, {STUDY: _POINTS, f"{STUDY} in short": _SCENES})
