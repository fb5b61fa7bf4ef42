"""How many decibels do lists of captures have for how many bytes, and the same lists in other formats?

Every fourth photo is left out, and drawn from the file that `encode` makes of up to 24 others for a given size, which
trains a list of its own. The lists are also written as SPZ and SOG.
"""

from __future__ import annotations

import math
import statistics
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tinysplat_runtime.api import load_gaussians, save_gaussians
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.recipe.encode import encode
from tinysplat_runtime.recipe.request import EncodeRequest
from tinysplat_runtime.scene.scenes import Scene

from ..clock import cpu_of
from ..pictures import as_photos, to_photos
from ..rows import Row, grouped, of_study
from ..show.plots import Panel, Points, save_panels
from ..show.tables import ABSENT, Cell, Listing, decibels, digits, kilobytes, mean, said
from ..study import Run, Study
from ..subjects.captures import Capture

STUDY = "rates"
LISTS, OTHERS = ".tsplat", ("SPZ", "SOG")

PHOTOS = 24
SIZES, QUICK_SIZES = (40, 80, 150, 300), (40,)
"""KB of files of lists."""


def rate_rows(run: Run) -> Iterator[Row]:
    """Rows of every file of every scene."""

    def of_scene(name: str, scene: Scene) -> Iterator[Row]:
        capture = Capture.of(scene).resized(run.size, run.size)
        given = replace(capture.given(PHOTOS), near=None, far=None)

        def row(way: str, size: int, drawn: Gaussians, count: int, cpu: float | None = None) -> Row:
            figures = to_photos(as_photos(drawn, capture.targets.cameras, run.threads), capture.targets)
            setting, counts = {"photos": len(given.frames), "size": size}, {"bytes": count, "gaussians": drawn.count}
            return Row(STUDY, name, way, setting, {**figures, **counts}, {} if cpu is None else {"cpu": cpu})

        for size in QUICK_SIZES if run.quick else SIZES:
            request = EncodeRequest(given, model=run.model, target_size=1000 * size)
            made, cpu = cpu_of(partial(encode, request, run.runtime, keep=True))
            assert made.gaussians is not None
            yield row(LISTS, size, run.runtime.decompress(made.data), len(made.data), cpu)
            for other in OTHERS:
                with tempfile.TemporaryDirectory() as folder:
                    save_gaussians(file := Path(folder) / f"list.{other.lower()}", made.gaussians)
                    again = replace(load_gaussians(file), viewpoints=made.gaussians.viewpoints)
                    yield row(other, size, again, file.stat().st_size)

    return run.of_scenes(of_scene)


# ---- shown --------------------------------------------------------------------------------------------------------


def plot_rates(path: Path, rows: Sequence[Row]) -> bool:
    """Decibels and SSIM by KB, the means over all scenes."""
    rows = of_study(rows, STUDY)
    if not rows:
        return False

    def points(way: str, up: str) -> Points:
        sizes = grouped((row for row in rows if row.way == way), "size").values()
        pairs = [[(row.figures["bytes"] / 1000, row.figures[up]) for row in part] for part in sizes]
        return [(statistics.fmean(x for x, _ in part), statistics.fmean(y for _, y in part)) for part in pairs]

    ways = [way for way in (LISTS, *OTHERS) if any(row.way == way for row in rows)]
    labels = {"fitted": "dB at photos left out", "fitted_ssim": "SSIM"}
    save_panels(path, [Panel(name, "KB", name, {way: points(way, up) for way in ways}) for up, name in labels.items()])
    return True


def _as(way: str, write: Callable[[Any], str], name: str) -> Cell:
    """Mean of a figure over a way's rows."""
    return lambda rows: mean(name, write)([row for row in rows if row.way == way])


def _times(way: str) -> Callable[[Sequence[Row]], str]:
    """How many times as many bytes another format takes for as many dB, the mean over scenes of their logarithms."""

    def cell(rows: Sequence[Row]) -> str:
        found = []
        for part in grouped(rows, "subject").values():
            curves = {
                one: sorted((row.figures["fitted"], math.log(row.figures["bytes"])) for row in part if row.way == one)
                for one in (LISTS, way)
            }
            for reached, size in curves[LISTS] if curves[way] else []:
                at, sizes = zip(*curves[way], strict=True)
                if at[0] <= reached <= at[-1]:
                    found.append(float(np.interp(reached, at, sizes)) - size)
        return digits(1)(math.exp(statistics.fmean(found))) if found else ABSENT

    return cell


def _in_words(rows: Sequence[Row]) -> str:
    """Other formats' bytes for as many dB."""
    rows = of_study(rows, STUDY)
    return f"SPZ takes {_times('SPZ')(rows)} and SOG {_times('SOG')(rows)} times as many bytes" if rows else ""


RATES = Study(
    "Rates",
    rate_rows,
    {
        STUDY: Listing(
            STUDY,
            {
                "asked for, KB": said("size"),
                "KB": _as(LISTS, kilobytes, "bytes"),
                "dB at photos left out": _as(LISTS, decibels, "fitted"),
                "SSIM": _as(LISTS, digits(3), "fitted_ssim"),
                "Gaussians": _as(LISTS, "{:,.0f}".format, "gaussians"),
                "the same as SPZ, KB": _as("SPZ", kilobytes, "bytes"),
                "SPZ, dB": _as("SPZ", decibels, "fitted"),
                "as SOG, KB": _as("SOG", kilobytes, "bytes"),
                "SOG, dB": _as("SOG", decibels, "fitted"),
            },
            by=("size",),
        ),
        f"{STUDY} in words": _in_words,
    },
    {STUDY: plot_rates},
)
