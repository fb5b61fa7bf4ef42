"""What does a user wait for? Everything between photos and a picture, in processor seconds beside dB."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE
from tinysplat_runtime.graphs.predict import predict
from tinysplat_runtime.render import DEFINITION, Renderer

from ..clock import Variant, measure
from ..pictures import PictureJudge
from ..rows import Row, of_study
from ..show.plots import Panel, save_panels
from ..show.tables import Listing, decibels, duration, kilobytes, mean, said
from ..study import Run, Study
from ..subjects.cases import Case

QPS = (-6.0, 0.0, 6.0, 12.0)
PROFILES = ("fast", DEFAULT_PROFILE, "max")

PHOTOS = "photos to a file"


def waiting_rows(run: Run) -> Iterator[Row]:
    """Rows of `waits` of the real photos, or what there is."""
    case = run.case
    pictures = PictureJudge(case, run.threads, **DEFINITION)
    variants: list[Variant] = []
    with tempfile.TemporaryDirectory() as folder:
        for qp in run.options.qps or (QPS[1:2] if run.quick else QPS):
            variants += _waits(run, case, pictures, qp, Path(folder))
        yield from measure("waits", case.name, variants, *_effort(run))


def _effort(run: Run) -> tuple[int, float]:
    """Rounds, and the seconds after which no more are begun."""
    rounds, budget = (5, 1.5) if run.quick else (9, 20.0)
    return run.options.rounds or rounds, budget


def _waits(run: Run, case: Case, pictures: PictureJudge, qp: float, folder: Path) -> Iterator[Variant]:
    """What is done at one Q_g; figures are those of the file that is made or read."""
    runtime, shots = run.runtime, case.shots
    figures, files = {}, {}
    for profile in PROFILES:
        files[profile] = runtime.compress(case.gaussians, profile, qp, drop_invalid=True)
        psnr = pictures.figures(runtime.decompress(files[profile]))["psnr_decoded_raw"]
        figures[profile] = {"bytes": len(files[profile]), "psnr_decoded_raw": psnr}
    path, picture = folder / f"{qp:g}.tsplat", folder / "p.png"
    path.write_bytes(files[DEFAULT_PROFILE])
    drawn = Renderer(runtime.decompress(files[DEFAULT_PROFILE]), run.threads)
    works: dict[str, tuple[str, Callable[[], object]]] = {
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
    works["first picture, a command"] = DEFAULT_PROFILE, partial(_drawn_by_command, path, picture)
    works["a file to Gaussians"] = DEFAULT_PROFILE, partial(runtime.decompress, files[DEFAULT_PROFILE])
    works["further pictures"] = DEFAULT_PROFILE, partial(drawn.render, case.cameras[-1])
    for name, (profile, work) in works.items():
        setting = {"thing": name, "profile": profile, "qp": qp, "threads": run.threads}
        yield Variant(f"{name}, Q_g {qp:g}", work, lambda _, figured=figures[profile]: figured, setting)  # type: ignore[misc]


def _drawn_by_command(path: Path, picture: Path) -> None:
    """A file to a picture by the command, a process."""
    command = [sys.executable, "-m", "tinysplat_runtime", "render", str(path), "-o", str(picture), "-q", "--force"]
    subprocess.run(command, stdout=subprocess.DEVNULL, check=True)


def plot_waits(path: Path, rows: Sequence[Row]) -> bool:
    """A line for everything that a user does, a point for each Q_g, the finest first."""
    points: dict[str, list[tuple[float, float]]] = {}
    for row in sorted(of_study(rows, "waits"), key=lambda row: row.setting["qp"]):
        points.setdefault(row.setting["thing"], []).append((row.costs["cpu"], row.figures["psnr_decoded_raw"]))
    if not points:
        return False
    curves = dict(sorted(points.items(), key=lambda item: min(item[1])))
    labels = "processor seconds, all threads", "dB of the file's pictures to those of the Gaussians"
    save_panels(path, [Panel("How long it takes, by the quality of the file", *labels, curves)])
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
            {"": said("thing"), "Q_g": said("qp", "{:g}".format),
             "processor time": mean("cpu", duration, "costs"), "KB": mean("bytes", kilobytes),
             "dB to raw": mean("psnr_decoded_raw", decibels)},
            sections="subject",
            text="Medians of interleaved rounds, processor seconds of all threads.",
        ),
        "encoding time": _longest,
    },
    {"waits": plot_waits},
)  # fmt: skip
