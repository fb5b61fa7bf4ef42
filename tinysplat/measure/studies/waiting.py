"""What does a user wait for? Everything between photos and a picture, in processor seconds beside dB."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE
from tinysplat_runtime.graphs.predict import predict
from tinysplat_runtime.render import Renderer

from ..clock import Variant, measure
from ..pictures import PictureJudge
from ..rows import Row, of_study
from ..show.plots import Curve, Panel, save_grid
from ..show.tables import Listing, duration, kilobytes, mean, said
from ..study import Run, Study
from ..subjects.cases import Case
from ..subjects.made import view_between

QPS = (-6.0, 0.0, 6.0, 12.0)
PROFILES = ("fast", DEFAULT_PROFILE, "max")

PHOTOS, DECODE, FIRST, FURTHER = (
    "photos to a file",
    "a file to Gaussians",
    "first picture, a command",
    "further pictures",
)


def waiting_rows(run: Run) -> Iterator[Row]:
    """Rows of the real photos, or what there is."""
    case = run.case
    pictures = PictureJudge(case, run.drawing)
    variants: list[Variant] = []
    with tempfile.TemporaryDirectory() as folder:
        for qp in run.options.qps or (QPS[1:2] if run.quick else QPS):
            variants += _waits(run, case, pictures, qp, Path(folder))
        yield from measure("waits", case.name, variants, run.effort)


def _waits(run: Run, case: Case, pictures: PictureJudge, qp: float, folder: Path) -> Iterator[Variant]:
    """What is done at one Q_g; figures are those of the file that is made or read."""
    runtime, shots = run.runtime, case.shots
    figures, files = {}, {}
    for profile in PROFILES:
        files[profile] = runtime.compress(case.gaussians, profile, qp, drop_invalid=True)
        psnr = pictures.figures(runtime.decompress(files[profile]))["psnr_decoded_raw"]
        figures[profile] = {"bytes": len(files[profile]), "psnr_decoded_raw": psnr}
    path = folder / f"{qp:g}.tsplat"
    command = [sys.executable, "-m", "tinysplat_runtime", "render", path, "-o", folder / "p.png", "-q", "--force"]
    path.write_bytes(files[DEFAULT_PROFILE])
    drawn = Renderer(runtime.decompress(files[DEFAULT_PROFILE]), run.threads)
    works: dict[str, tuple[str, Callable[[], Any]]] = {
        f"Gaussians to a file, {profile}": (
            profile,
            partial(runtime.compress, case.gaussians, profile, qp, drop_invalid=True),
        )
        for profile in PROFILES
    }
    if shots is not None:
        graph, context = runtime.store.network(case.model), shots.context

        def encode() -> bytes:
            gaussians = predict(context.images, context.cameras, shots.near, shots.far, graph)
            return runtime.compress(gaussians, qp=qp, drop_invalid=True)

        works[PHOTOS] = DEFAULT_PROFILE, encode
    works[FIRST] = DEFAULT_PROFILE, partial(subprocess.run, command, check=True)
    works[DECODE] = DEFAULT_PROFILE, partial(runtime.decompress, files[DEFAULT_PROFILE])
    works[FURTHER] = DEFAULT_PROFILE, partial(drawn.render, view_between(case.gaussians))
    for name, (profile, work) in works.items():
        setting = {"thing": name, "profile": profile, "qp": qp}
        yield Variant(f"{name}, Q_g {qp:g}", work, lambda _, figured=figures[profile]: figured, setting, run.threads)  # type: ignore[misc]


def plot_waits(path: Path, rows: Sequence[Row]) -> bool:
    """A line for everything that a user does, a point for each Q_g, the finest first."""
    points: dict[str, list[tuple[float, float]]] = {}
    for row in sorted(of_study(rows, "waits"), key=lambda row: row.setting["qp"]):
        points.setdefault(row.setting["thing"], []).append((row.costs["cpu"], row.figures["psnr_decoded_raw"]))
    if not points:
        return False
    curves = [Curve(thing, drawn) for thing, drawn in sorted(points.items(), key=lambda item: min(item[1]))]
    labels = "processor seconds, all threads", "dB of the file's pictures to those of the Gaussians"
    save_grid(path, "", [[Panel("How long it takes, by the quality of the file", *labels, curves)]])
    return True


def _longest(rows: Sequence[Row]) -> str:
    """A sentence: how long photos, and Gaussians, take to become a file of the default quality."""
    by_thing = {row.setting["thing"]: row for row in of_study(rows, "waits") if row.setting["qp"] == 0}
    if PHOTOS not in by_thing:
        return ""
    said_of = [duration(by_thing[thing].costs["cpu"]) for thing in (PHOTOS, f"Gaussians to a file, {DEFAULT_PROFILE}")]
    quick, thorough = (duration(by_thing[f"Gaussians to a file, {name}"].costs["cpu"]) for name in ("fast", "max"))
    return (
        f"two photos of 256×256 take {said_of[0]} of processor time, of which {said_of[1]} are coding"
        f" (`fast` {quick}, `max` {thorough})"
    )


WAITING = Study(
    "What users wait for",
    waiting_rows,
    {
        "waits": Listing(
            "waits",
            {"": said("thing"), "Q_g": said("qp", lambda value: f"{value:g}"),
             "processor time": mean("cpu", duration, "costs"), "KB": mean("bytes", kilobytes),
             "dB to raw": mean("psnr_decoded_raw", lambda value: f"{value:.2f}")},
            sections="subject",
            text="Medians of interleaved rounds, processor seconds of all threads.",
        ),
        "encoding time": _longest,
    },
    {"waits": plot_waits},
)  # fmt: skip
