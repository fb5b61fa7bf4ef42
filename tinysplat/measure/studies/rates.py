"""How many decibels does a capture's file have, for how many bytes and how many seconds?

Every fourth photo is left out, and drawn from the file that `encode` makes of up to 24 others: for a given size, which
trains a list of its own (also written as SPZ and SOG), and for a given number of steps. Beside them stand planes of the
network (`--fast`), for a size and as they come, and rows of OpenSplat on the same photos, by its number of steps
(`checks/opensplat.py --study rates`).
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
from ..rows import TRAINER, Row, grouped, of_study
from ..show.plots import Panel, save_panels
from ..show.tables import ABSENT, Listing, decibels, digits, kilobytes, mean, said
from ..study import Run, Study
from ..subjects.captures import Capture

STUDY = "rates"
LISTS, PLANES, OTHERS = "list", "planes", ("SPZ", "SOG")

PHOTOS = 24
SIZES, QUICK_SIZES = (40, 80, 150, 300, 600), (40,)
"""KB of files."""

STEPS, QUICK_STEPS = (100, 300, 1000), (30,)
"""Of training."""


def rate_rows(run: Run) -> Iterator[Row]:
    """Rows of every file of every scene."""

    def of_scene(name: str, scene: Scene) -> Iterator[Row]:
        capture = Capture.of(scene).resized(run.size, run.size)
        given = replace(capture.given(PHOTOS), near=None, far=None)

        def row(way: str, asked: dict[str, int], drawn: Gaussians, count: int, cpu: float | None = None) -> Row:
            figures = to_photos(as_photos(drawn, capture.targets.cameras, run.threads), capture.targets)
            setting, counts = {"photos": len(given.frames), **asked}, {"bytes": count, "gaussians": drawn.count}
            return Row(STUDY, name, way, setting, {**figures, **counts}, {} if cpu is None else {"cpu": cpu})

        def made(way: str, asked: dict[str, int], **options: Any) -> tuple[Row, Gaussians]:
            request = EncodeRequest(given, model=run.model, fast=way == PLANES, **options)
            file, cpu = cpu_of(partial(encode, request, run.runtime, keep=True))
            assert file.gaussians is not None
            return row(way, asked, run.runtime.decompress(file.data), len(file.data), cpu), file.gaussians

        for size in QUICK_SIZES if run.quick else SIZES:
            asked = {"size": size}
            listed, gaussians = made(LISTS, asked, target_size=1000 * size)
            yield listed
            for other in OTHERS:
                with tempfile.TemporaryDirectory() as folder:
                    save_gaussians(file := Path(folder) / f"list.{other.lower()}", gaussians)
                    again = replace(load_gaussians(file), viewpoints=gaussians.viewpoints)
                    yield row(other, asked, again, file.stat().st_size)
            yield made(PLANES, asked, target_size=1000 * size)[0]
        yield made(PLANES, {"steps": 0})[0]
        for steps in QUICK_STEPS if run.quick else STEPS:
            yield made(LISTS, {"steps": steps}, train=steps)[0]

    return run.of_scenes(of_scene)


# ---- shown --------------------------------------------------------------------------------------------------------


def _plotted(asked: str, label: str, ways: Sequence[str], at: Callable[[Row], float]) -> Callable[..., bool]:
    """Draws decibels and SSIM by what a file takes, the means over all scenes of what was asked for."""

    def plot(path: Path, rows: Sequence[Row]) -> bool:
        rows = [row for row in of_study(rows, STUDY) if asked in row.setting and row.way in ways]

        def points(way: str, up: str) -> list[tuple[float, float]]:
            parts = grouped([row for row in rows if row.way == way], asked).values()
            return sorted(
                (statistics.fmean(map(at, part)), statistics.fmean(row.figures[up] for row in part)) for part in parts
            )

        def panel(up: str, name: str) -> Panel:
            return Panel(name, label, name, {way: found for way in ways if (found := points(way, up))})

        if rows:
            save_panels(path, [panel("fitted", "dB at photos left out"), panel("fitted_ssim", "SSIM")])
        return bool(rows)

    return plot


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


def _way(rows: Sequence[Row]) -> str:
    """A way, and how long it trained."""
    steps = rows[0].setting["steps"]
    return f"{rows[0].way}, {steps:,} steps" if steps else "planes (`--fast`)"


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
                "KB": mean("bytes", kilobytes, way=LISTS),
                "dB at photos left out": mean("fitted", decibels, way=LISTS),
                "SSIM": mean("fitted_ssim", digits(3), way=LISTS),
                "Gaussians": mean("gaussians", "{:,.0f}".format, way=LISTS),
                "the same as SPZ, KB": mean("bytes", kilobytes, way="SPZ"),
                "SPZ, dB": mean("fitted", decibels, way="SPZ"),
                "as SOG, KB": mean("bytes", kilobytes, way="SOG"),
                "SOG, dB": mean("fitted", decibels, way="SOG"),
                "planes, KB": mean("bytes", kilobytes, way=PLANES),
                "planes, dB": mean("fitted", decibels, way=PLANES),
            },
            by=("size",),
            wanted=lambda row: "size" in row.setting,
        ),
        f"{STUDY} seconds": Listing(
            STUDY,
            {
                "": _way,
                "CPU s": mean("cpu", digits(0), "costs"),
                "dB at photos left out": mean("fitted", decibels),
                "worst": mean("fitted_worst", decibels),
                "SSIM": mean("fitted_ssim", digits(3)),
                "KB": mean("bytes", kilobytes),
            },
            by=("way", "steps"),
            wanted=lambda row: "steps" in row.setting,
        ),
        f"{STUDY} in words": _in_words,
    },
    {
        STUDY: _plotted("size", "KB", (LISTS, *OTHERS, PLANES), lambda row: row.figures["bytes"] / 1000),
        f"{STUDY} seconds": _plotted("steps", "CPU s", (LISTS, TRAINER, PLANES), lambda row: row.costs["cpu"]),
    },
)
