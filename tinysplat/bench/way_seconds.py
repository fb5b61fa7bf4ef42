"""Seconds of the ways to store Gaussians that `evaluation.ways` compares, and what each idea of the codec costs.

Ways take turns, round by round (`timing`); the first round warms up and gives bytes and dB.
"""

from __future__ import annotations

import cProfile
import gc
import json
import pstats
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tinysplat.evaluation import ideas
from tinysplat.evaluation.curve_plots import safe_name
from tinysplat.evaluation.plots import Curve, Panel, save_grid
from tinysplat.evaluation.rate_distortion import Pictures, Point
from tinysplat.evaluation.subjects import Subject
from tinysplat.evaluation.tables import format_table, number
from tinysplat.evaluation.ways import Way
from tinysplat_runtime.api import Runtime
from tinysplat_runtime.codec.encoder import SceneEncoder
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.planes import LayerPlan
from tinysplat_runtime.system.files import read_limited, write_atomically

from .timing import Effort, Stage, Variant, measure, timed

_MAX_BYTES = 16 * 1000 * 1000


@dataclass(frozen=True)
class Timed:
    """One way at one setting on one window; seconds are wall clock, medians with quartiles, and CPU medians.

    Attributes:
        network, views, case: what was coded.
        way, setting: how.
        bytes, psnr: of the file, and dB of decoded against raw.
        encode, decode: (median, lower quartile, upper quartile, CPU) seconds.
    """

    network: str
    views: int
    case: str
    way: str
    setting: float
    bytes: int
    psnr: float
    encode: Sequence[float]
    decode: Sequence[float]

    @property
    def key(self) -> tuple[str, int, str, str, float]:
        """What tells it from others."""
        return self.network, self.views, self.case, self.way, self.setting


@dataclass(frozen=True)
class Cost:
    """What an idea costs on one window, in CPU milliseconds over the codec without it; negative where it saves.

    Attributes:
        network, views, case: what was coded.
        idea: by what is undone, as `ideas` names it.
        plan: of the idea's own work before coding.
        coding: of quantising, coding and writing the planes.
        decoding: of the whole file.
    """

    network: str
    views: int
    case: str
    idea: str
    plan: float
    coding: float
    decoding: float


def time_ways(
    ways: Sequence[Way], subject: Subject, pictures: Pictures, effort: Effort, named: tuple[str, int, str]
) -> list[tuple[Timed, Point]]:
    """Every way at each of its settings, in turns; `named` is network, views and case. Each comes with its point."""
    cells = [(way, setting) for way in ways for setting in way.settings]
    variants, points = [], []
    for n, (way, setting) in enumerate(cells):
        data = way.encode(subject, setting)
        points.append(Point(setting, len(data), *pictures.psnr(way.decode(subject, data)), way.classes(data)))
        variants.append(Variant(f"{n} encode", lambda way=way, setting=setting: way.encode(subject, setting)))  # type: ignore[misc]
        variants.append(Variant(f"{n} decode", lambda way=way, data=data: way.decode(subject, data)))  # type: ignore[misc]
    seconds = [row.seconds for row in measure(Stage("ways", named[2], variants), effort)]
    quartets = [(s.median, s.low, s.high, s.cpu) for s in seconds if s is not None]
    return [
        (Timed(*named, way.name, setting, p.bytes, p.psnr, encode, decode), p)
        for (way, setting), p, encode, decode in zip(cells, points, quartets[::2], quartets[1::2], strict=True)
    ]


def time_costs(
    subject: Subject, qp: float, runtime: Runtime, effort: Effort, named: tuple[str, int, str]
) -> list[Cost]:
    """Every idea against the codec with all of them."""
    gaussians = subject.case.gaussians
    plain = SceneEncoder(gaussians, ideas.BASE, runtime.store, threads=runtime.threads, drop_invalid=True).plan(qp)
    changed = {name: ideas.changed_plans(gaussians, qp, runtime, change) for name, change in ideas.CHANGES.items()}
    changed[ideas.STEPS_NOT_MEASURED] = plain  # of another profile: its planes cost what others of its dB would
    rounds: dict[str, list[tuple[float, float, float]]] = {name: [] for name in changed}
    gc.freeze()  # as `measure` does
    for _ in range(effort.rounds + 1):
        work = work_seconds(gaussians, qp, runtime)
        coding, decoding = _coded_seconds(subject, plain, qp, runtime)
        for name, plans in changed.items():
            without = (coding, decoding) if plans is plain else _coded_seconds(subject, plans, qp, runtime)
            rounds[name].append((work.get(name, 0.0), coding - without[0], decoding - without[1]))
    gc.unfreeze()
    return [
        Cost(*named, name, *(1000 * statistics.median(column) for column in zip(*found[1:], strict=True)))
        for name, found in rounds.items()
    ]


def _coded_seconds(subject: Subject, plans: Sequence[LayerPlan], qp: float, runtime: Runtime) -> tuple[float, float]:
    """CPU seconds of coding such plans, and of decoding what comes of it."""
    gaussians = subject.case.gaussians
    encoder = SceneEncoder(gaussians, ideas.BASE, runtime.store, threads=runtime.threads, drop_invalid=True)
    data: list[bytes] = []
    _, coding = timed(lambda: data.append(encoder.code(plans, qp)))
    _, decoding = timed(lambda: runtime.decompress(data[0]))
    return coding, decoding


def work_seconds(gaussians: Gaussians, qp: float, runtime: Runtime) -> dict[str, float]:
    """CPU seconds, by idea, of the functions that planning calls for it alone."""
    encoder = SceneEncoder(gaussians, ideas.BASE, runtime.store, threads=runtime.threads, drop_invalid=True)
    profile = cProfile.Profile(time.process_time)
    profile.runcall(encoder.plan, qp)
    spent: dict[str, float] = {}
    for (_, _, function), (_, _, _, cumulative, _) in pstats.Stats(profile).stats.items():  # type: ignore[attr-defined]
        spent[function] = spent.get(function, 0.0) + cumulative
    return {name: sum(spent.get(f, 0.0) for f in functions) for name, functions in ideas.WORK.items()}


def read_times(path: Path) -> list[Timed]:
    """What `write_times` wrote; nothing where there is no such file, InputError where it is another."""
    if not path.is_file():
        return []
    try:
        return [Timed(**entry) for entry in json.loads(read_limited(path, _MAX_BYTES))]
    except (TypeError, ValueError) as error:
        raise InputError(f"not seconds of ways ({error})", where=str(path)) from None


def write_times(path: Path, times: Sequence[Timed]) -> None:
    """As JSON, an object per way, setting and window."""
    document = json.dumps([vars(entry) for entry in times], indent=1, ensure_ascii=False)
    write_atomically(path, (document + "\n").encode())


def seconds_table(times: Sequence[Timed]) -> str:
    """A row per way and setting, a table per window."""
    sections = []
    for case in dict.fromkeys((t.network, t.views, t.case) for t in times):
        members = [t for t in times if (t.network, t.views, t.case) == case]
        rows = [
            [
                f"{t.way}, Q_g {t.setting:g}", number(t.bytes / 1000, 1), number(t.psnr, 2), *_cells(t.encode),
                *_cells(t.decode),
            ]
            for t in members
        ]  # fmt: skip
        header = ["", "KB", "dB", "encode s", "quartiles", "CPU s", "decode s", "quartiles", "CPU s"]
        sections.append(f"{case[0]}, {case[1]} views, {case[2]}\n\n{format_table(header, rows)}")
    return "\n\n".join(sections)


def cost_table(costs: Sequence[Cost]) -> str:
    """CPU milliseconds of encoding and decoding by idea, a column pair per window."""
    cases = list(dict.fromkeys((c.network, c.views, c.case) for c in costs))
    rows = []
    for idea in dict.fromkeys(c.idea for c in costs):
        found = {(c.network, c.views, c.case): c for c in costs if c.idea == idea}
        cells = [(f"{found[case].plan + found[case].coding:+.0f}", f"{found[case].decoding:+.1f}") for case in cases]
        rows.append([idea, *(cell for pair in cells for cell in pair)])
    labels = [f"{network}, {views} views: {what}" for network, views, _ in cases for what in ("encode", "decode")]
    return "CPU milliseconds of the idea\n\n" + format_table(["undone", *labels], rows)


def save_seconds_plots(folder: Path, times: Sequence[Timed]) -> list[Path]:
    """Write seconds-NETWORK.png: dB against seconds, encoding above and decoding below; the paths."""
    paths = []
    for network in dict.fromkeys(t.network for t in times):
        members = [t for t in times if t.network == network]
        views = list(dict.fromkeys(t.views for t in members))
        grid = [
            [_panel(f"{what}, {count} views", [t for t in members if t.views == count], key) for count in views]
            for what, key in _STAGES.items()
        ]
        paths.append(folder / f"seconds-{safe_name(network)}.png")
        save_grid(paths[-1], f"{network}: error against run time, means over windows", grid)
    return paths


_STAGES: dict[str, Callable[[Timed], float]] = {"encoding": lambda t: t.encode[0], "decoding": lambda t: t.decode[0]}


def _panel(title: str, times: Sequence[Timed], seconds: Callable[[Timed], float]) -> Panel:
    curves = []
    for way in dict.fromkeys(t.way for t in times):
        points = []
        for setting in dict.fromkeys(t.setting for t in times if t.way == way):
            chosen = [t for t in times if (t.way, t.setting) == (way, setting)]
            points.append((float(np.mean([seconds(t) for t in chosen])), float(np.mean([t.psnr for t in chosen]))))
        curves.append(Curve(way, points))
    return Panel(title, "seconds, median", "dB, decoded to raw", curves)


def _cells(seconds: Sequence[float]) -> tuple[str, str, str]:
    median, low, high, cpu = seconds
    return number(median, 3), f"{low:.3f}–{high:.3f}", number(cpu, 3)
