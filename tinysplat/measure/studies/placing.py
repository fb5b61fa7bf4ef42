"""How many photos does `tinysplat poses` place, how many of them right, and how soon?

The command gets the photos of a scene folder without their cameras. The places that it finds are laid over the known
ones by the similarity that fits most of them; right is what then lies within 2 % of the known places' extent.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.scene.intake.layouts import load_scene
from tinysplat_runtime.scene.scenes import Scene

from ..clock import cpu_of
from ..rows import Row, of_study
from ..show.tables import Listing, duration, format_table, mean, said
from ..study import Run, Study

STUDY = "poses"
TOLERANCE = 0.02
ROUNDS = 20
"""Of fitting without the places that lie farther off than half of them."""


def placing_rows(run: Run) -> Iterator[Row]:
    """A row per scene folder."""
    return run.of_scenes(lambda name, scene: iter([_scene_row(name, scene, run)]))


def _scene_row(name: str, scene: Scene, run: Run) -> Row:
    known = {frame.path.stem: frame.camera.centre for frame in scene.frames}
    with tempfile.TemporaryDirectory() as top:
        photos, output = Path(top) / "photos", Path(top) / "scene"
        photos.mkdir()
        for frame in scene.frames:
            (photos / frame.path.name).symlink_to(frame.path.resolve())
        command = [sys.executable, "-m", "tinysplat_runtime", "poses", photos, "-o", output, "-q"]
        call = partial(subprocess.run, [*command, "--threads", str(run.threads)], capture_output=True, text=True)
        began = time.perf_counter()
        done, cpu = cpu_of(call)
        costs = {"seconds": time.perf_counter() - began, "cpu": cpu}
        row = Row(STUDY, name, "poses", {"photos": len(known)}, costs=costs)
        if done.returncode:
            line = (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
            return replace(row, figures={"placed": 0.0, "right": 0.0}, note=line)
        placed = {frame.path.stem: frame.camera.centre for frame in load_scene(output).frames}
    extent = float(np.linalg.norm(np.ptp(list(known.values()), axis=0)))
    off = misplaced(np.array(list(placed.values())), np.array([known[stem] for stem in placed]))
    right = float((off <= TOLERANCE * extent).sum())
    return replace(row, figures={"placed": len(placed) / len(known), "right": right / len(known)})


def misplaced(places: NDArray, known: NDArray) -> NDArray:
    """How far places lie from the known ones, both (N, 3) float64, under the similarity that fits half of them best."""
    chosen = np.ones(len(places), bool)
    for _ in range(ROUNDS):
        off = np.linalg.norm(_fitted(places, known, chosen) - known, axis=1)
        chosen = off <= np.median(off)
    return off


def _fitted(places: NDArray, known: NDArray, chosen: NDArray) -> NDArray:
    """All places found, moved, turned and scaled as brings the chosen ones nearest (Umeyama 1991)."""
    a, b = places[chosen], known[chosen]
    u, spread, vt = np.linalg.svd((b - b.mean(axis=0)).T @ (a - a.mean(axis=0)))
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    scale = (spread * signs).sum() / max(float(((a - a.mean(axis=0)) ** 2).sum()), 1e-30)
    return scale * (places - a.mean(axis=0)) @ (u * signs @ vt).T + b.mean(axis=0)


_TABLE = Listing(
    STUDY,
    {
        "scene": said("subject"),
        "photos": said("photos"),
        "placed": mean("placed", "{:.0%}".format),
        "right": mean("right", "{:.0%}".format),
        "seconds": mean("seconds", duration, "costs"),
        "CPU s": mean("cpu", duration, "costs"),
    },
)


def _in_short(rows: Sequence[Row]) -> str:
    """A line per capture of which not all photos are placed right, and one for the others."""
    own = of_study(rows, STUDY)
    whole = [row for row in own if row.figures["right"] == 1]
    lines = [
        [row.subject, str(row.setting["photos"]), f"{row.figures['placed']:.0%}", f"{row.figures['right']:.0%}"]
        for row in own
        if row not in whole
    ]
    if whole:
        counts = [row.setting["photos"] for row in whole]
        lines.append([f"{len(whole)} others", f"{min(counts)}–{max(counts)}", "100%", "100%"])
    return format_table(["scene", "photos", "placed", "right"], lines) if lines else ""


def _in_words(rows: Sequence[Row]) -> str:
    """Shares of the photos of all captures, each of which counts once."""
    if not (own := of_study(rows, STUDY)):
        return ""
    placed, right = (sum(row.figures[name] for row in own) / len(own) for name in ("placed", "right"))
    return f"of {len(own)} captures' photos {placed:.0%} are placed, {right:.0%} right"


PLACING = Study(
    "Cameras from photos alone",
    placing_rows,
    {STUDY: _TABLE, f"{STUDY} in short": _in_short, f"{STUDY} in words": _in_words},
)
