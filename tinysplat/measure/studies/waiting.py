"""What does a user wait for? Everything between photos and a picture, in processor seconds beside dB; and commands as
they are started, each beside the same command of another checkout.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from tinysplat_runtime.codec.profiles import DEFAULT_PROFILE
from tinysplat_runtime.formats.table import save_gaussians
from tinysplat_runtime.graphs.predict import predict
from tinysplat_runtime.render import DEFINITION, Renderer

from ..clock import Variant, measure
from ..pictures import PictureJudge
from ..rows import Row, of_study
from ..show.plots import Panel, save_grid
from ..show.tables import Listing, decibels, digits, duration, kilobytes, mean, megabytes, said
from ..study import Run, Study
from ..subjects.cases import Case
from ..subjects.made import made_gaussians

ROOT = Path(__file__).resolve().parents[3]

QPS = (-6.0, 0.0, 6.0, 12.0)
PROFILES = ("fast", DEFAULT_PROFILE, "max")

PHOTOS = "photos to a file"

PEAK = (
    "import os, sys; pid = os.posix_spawn(sys.argv[1], sys.argv[1:], os.environ);"
    " print(1024 * os.wait4(pid, 0)[2].ru_maxrss)"
)
"""Runs a command and prints its peak; in a small process, since one begins with the peak of who started it."""


def waiting_rows(run: Run) -> Iterator[Row]:
    """Rows of `waits` of the real photos, or what there is; then of `commands`."""
    case = run.case
    pictures = PictureJudge(case, run.threads, **DEFINITION)
    variants: list[Variant] = []
    with tempfile.TemporaryDirectory() as folder:
        for qp in run.options.qps or (QPS[1:2] if run.quick else QPS):
            variants += _waits(run, case, pictures, qp, Path(folder))
        yield from measure("waits", case.name, variants, *_effort(run))
        if run.options.beside is not None:
            yield from command_rows(run, run.options.beside, Path(folder))


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
    works["first picture, a command"] = DEFAULT_PROFILE, call_of(ROOT, ["render", path, "-o", picture])
    works["a file to Gaussians"] = DEFAULT_PROFILE, partial(runtime.decompress, files[DEFAULT_PROFILE])
    works["further pictures"] = DEFAULT_PROFILE, partial(drawn.render, case.cameras[-1])
    for name, (profile, work) in works.items():
        setting = {"thing": name, "profile": profile, "qp": qp, "threads": run.threads}
        yield Variant(f"{name}, Q_g {qp:g}", work, lambda _, figured=figures[profile]: figured, setting)  # type: ignore[misc]


def command_rows(run: Run, beside: Path, folder: Path) -> Iterator[Row]:
    """Commands of this checkout in turns with those of another."""
    source, file = folder / "g.npz", folder / "f.tsplat"
    gaussians = made_gaussians(2, run.side, run.side, 4)
    save_gaussians(source, gaussians)
    file.write_bytes(run.runtime.compress(gaussians, drop_invalid=True))
    target, coded, picture = folder / "out.npz", folder / "out.tsplat", folder / "p.png"
    commands: dict[str, list[str | Path]] = {
        "info": ["info", file],
        "decode": ["decode", file, "-o", target],
        "render": ["render", file, "-o", picture],
        "compress": ["compress", source, "-o", coded],
        "compress --profile fast": ["compress", source, "-o", coded, "--profile", "fast"],
    }
    shots = run.case.shots
    if shots is not None:
        photos = folder / "photos"
        photos.mkdir()
        shots.write(photos)
        commands[f"encode of {len(shots.context.cameras)} photos"] = ["encode", photos, "-o", coded]
    figures, setting = {"bytes": file.stat().st_size}, {"baseline": beside.name, "threads": run.threads}
    variants = [
        Variant(name, call_of(ROOT, words), lambda _: figures, setting, call_of(beside, words))
        for name, words in commands.items()
    ]
    for row in measure("commands", f"2×{run.side}×{run.side}, SH degree 4", variants, *_effort(run)):
        peaks = [peak_bytes(root, commands[row.way]) for root in (ROOT, beside)]
        yield replace(row, costs={**row.costs, "peak_bytes": peaks[0], "baseline_peak_bytes": peaks[1]})


def _words(root: Path, words: Sequence[str | Path]) -> tuple[list[str], dict[str, str]]:
    """A command of a checkout, and its environment."""
    quiet = [] if words[0] == "info" else ["-q", "--force"]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    environment |= {"TINYSPLAT_MODELS": str(root / "models"), "PYTHONPATH": str(root / "runtime")}
    return [sys.executable, "-m", "tinysplat_runtime", *map(str, words), *quiet], environment


def call_of(root: Path, words: Sequence[str | Path]) -> Callable[[], object]:
    """A command of a checkout, to be run as a process."""
    command, environment = _words(root, words)
    return partial(subprocess.run, command, env=environment, stdout=subprocess.DEVNULL, check=True)


def peak_bytes(root: Path, words: Sequence[str | Path]) -> int:
    """Its peak memory in bytes."""
    command, environment = _words(root, words)
    helper = [sys.executable, "-S", "-c", PEAK, *command]
    return int(subprocess.run(helper, env=environment, capture_output=True, check=True).stdout.split()[-1])


def plot_waits(path: Path, rows: Sequence[Row]) -> bool:
    """A line for everything that a user does, a point for each Q_g, the finest first."""
    points: dict[str, list[tuple[float, float]]] = {}
    for row in sorted(of_study(rows, "waits"), key=lambda row: row.setting["qp"]):
        points.setdefault(row.setting["thing"], []).append((row.costs["cpu"], row.figures["psnr_decoded_raw"]))
    if not points:
        return False
    curves = dict(sorted(points.items(), key=lambda item: min(item[1])))
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
            {"": said("thing"), "Q_g": said("qp", "{:g}".format),
             "processor time": mean("cpu", duration, "costs"), "KB": mean("bytes", kilobytes),
             "dB to raw": mean("psnr_decoded_raw", decibels)},
            sections="subject",
            text="Medians of interleaved rounds, processor seconds of all threads.",
        ),
        "commands": Listing(
            "commands",
            {"command": said("way"), "processor time": mean("cpu", duration, "costs"),
             "by the other's": mean("cpu_ratio", digits(2), "costs"),
             "on the clock, by the other's": mean("ratio", digits(2), "costs"),
             "memory": mean("peak_bytes", megabytes, "costs"),
             "the other's": mean("baseline_peak_bytes", megabytes, "costs")},
            sections="subject",
            text="Commands as processes, in turns with those of another checkout.",
        ),
        "encoding time": _longest,
    },
    {"waits": plot_waits},
)  # fmt: skip
