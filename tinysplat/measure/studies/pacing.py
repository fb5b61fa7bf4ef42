"""How soon does refinement reach what that of another checkout reaches? Held-out dB by processor seconds, in turns.

A window's Gaussians and photos are given to two processes, each on one checkout's runtime (`stepper.py`). Whichever has
used less processor time takes the next step, so that a slow spell hits both, and after each step Gaussians are drawn at
the window's targets, which counts nowhere. Compared are the seconds to shares of the most gain that both reach.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

from tinysplat_runtime.errors import InputError, TinySplatError
from tinysplat_runtime.formats.table import load_gaussians, save_gaussians

from .. import stepper
from ..pictures import Drawing, photo_psnr
from ..rows import Row, grouped, of_study
from ..runner import WindowJob
from ..show.tables import decibels, format_table
from ..study import Run, Study
from ..subjects.cases import Case

STUDY = "paces"
OWN_ROOT = Path(stepper.__file__).resolve().parents[2]
VIEWS = (4, 6)
STEPS, QUICK_STEPS = 12, 2
"""Most of either."""

SHARES = (0.5, 0.75, 1.0)
"""Of the gain that both reach."""


def pace_rows(run: Run) -> Iterator[Row]:
    """A row per window, checkout and step."""
    beside = run.options.beside
    if beside is None:
        raise InputError("missing, expected the checkout whose refinement takes turns", where="--beside")
    for job in run.jobs(VIEWS):
        try:
            yield from _window_rows(job, {"this": OWN_ROOT, "other": beside}, run)
        except TinySplatError as error:
            run.left_out.append(f"left out {job}: {error}")


def _window_rows(job: WindowJob, roots: dict[str, Path], run: Run) -> Iterator[Row]:
    case = job.case(run.runtime)
    if case.shots is None or case.shots.scene is None:
        return
    steps, drawing = QUICK_STEPS if run.quick else STEPS, Drawing(run.threads)
    setting = {"views": len(case.gaussians.cameras), "size": "{1}x{0}".format(*job.size), "model": job.model}
    with tempfile.TemporaryDirectory() as top, ExitStack() as stack:
        steppers = {}
        for name, root in roots.items():
            folder = Path(top) / name
            _write(case, folder)
            words = [sys.executable, stepper.__file__, str(root / "runtime"), str(folder)]
            process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            steppers[name] = stack.enter_context(process)
            _told(process, "")
        spent, taken = dict.fromkeys(roots, 0.0), dict.fromkeys(roots, 0)
        while spent:
            name = min(spent, key=lambda name: spent[name])
            answer = _told(steppers[name], "\n")
            if not answer:
                del spent[name]
                continue
            spent[name] = float(answer)
            gaussians = load_gaussians(Path(top) / name / "step.npz")
            psnr = photo_psnr(gaussians, case.cameras, case.shots.targets.images, drawing)
            yield Row(STUDY, f"{job.source.name} {job.window}, {setting['size']}", name,
                      {**setting, "step": taken[name]}, {"psnr": psnr}, {"cpu": spent[name]})  # fmt: skip
            taken[name] += 1
            if taken[name] > steps:
                del spent[name]
        for process in steppers.values():
            process.stdin.close()  # type: ignore[union-attr]


def _told(process: subprocess.Popen, line: str) -> str:
    """What a stepper answers; nothing where it has come to an end."""
    assert process.stdin is not None and process.stdout is not None
    if line:
        process.stdin.write(line)
        process.stdin.flush()
    return process.stdout.readline().strip()


def _write(case: Case, folder: Path) -> None:
    """Gaussians, photos and cameras, as a stepper reads them."""
    assert case.shots is not None
    folder.mkdir()
    case.shots.write(folder)
    save_gaussians(folder / "g.npz", case.gaussians)


def seconds_to(points: Sequence[tuple[float, float]], psnr: float) -> float | None:
    """When (seconds, dB), in order, first reach a dB, between two points by a line; None where they never do."""
    for (before, low), (after, high) in zip([points[0], *points], points, strict=False):
        if high >= psnr:
            return after if high <= low else before + (after - before) * max(psnr - low, 0.0) / (high - low)
    return None


def pace_table(rows: Sequence[Row]) -> str:
    """A line per window and one of medians for every number of photos and size: seconds to equal gains, by ratio."""
    lines = []
    for (views, size), alike in grouped(of_study(rows, STUDY), "views", "size").items():
        found: list[list[float]] = []
        for (subject,), members in grouped(alike, "subject").items():
            curves = {
                way: [(row.costs["cpu"], row.figures["psnr"]) for row in same]
                for (way,), same in grouped(members, "way").items()
            }
            start, reached = curves["this"][0][1], min(max(psnr for _, psnr in curve) for curve in curves.values())
            if reached <= start:
                continue
            cells: list[str] = []
            ratios = []
            for share in SHARES:
                level = start + share * (reached - start)
                this, other = (seconds_to(curves[way], level) for way in ("this", "other"))
                assert this is not None and other is not None
                ratios.append(this / other)
                cells.append(f"{this:.1f} / {other:.1f} = {this / other:.2f}")
            found.append(ratios)
            lines.append([subject, str(views), size, f"{decibels(start)} → {decibels(reached)}", *cells])
        if found:
            medians = [f"**{statistics.median(column):.2f}**" for column in zip(*found, strict=True)]
            lines.append([f"median of {len(found)}", str(views), size, "", *medians])
    heads = ["window", "photos", "size", "dB, of both", *(f"{share:.0%} of the gain" for share in SHARES)]
    return format_table(heads, lines) if lines else ""


PACES = Study("Refinement beside another checkout's", pace_rows, {STUDY: pace_table})
