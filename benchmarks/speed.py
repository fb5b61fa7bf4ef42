"""Two versions of the code and the physical floor, in interleaved rounds: a CSV line per case.

    python benchmarks/speed.py SECTION --before CHECKOUT [--rounds 9] [--pin] [--only TEXT]

SECTION is one of decode, encode, render, large and start; `--only` takes those of its cases whose name holds the text.

Each version works in a process of its own, which is asked for one call at a time: floor, before, after, floor, … . The
floor is what the work needs in any case: libavcodec alone on the same streams with as many threads, and writing the
result's bytes into memory; libx265 alone on the same planes, of each version its own, as versions choose other steps;
one numpy `exp` of as many numbers as there are pixels in footprints.

`--pin` keeps every thread of a pool on a core of its own, as the scheduler of an otherwise idle machine does. Beside
other work it tends to put a thread that is woken on the core of the one that woke it, which halves all threads alike.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[1]

Call = Callable[[], Any]


class Case(NamedTuple):
    """One line of the table: a task of `TASKS` and its arguments, and those that are its floor.

    `floors_differ` where each version is held to its own first floor.
    """

    name: str
    task: tuple[Any, ...]
    floors: tuple[tuple[Any, ...], ...]
    floors_differ: bool = False


def decode_cases() -> list[Case]:
    """Files of three sizes by the profile `balanced`."""
    return [
        Case(
            f"decode {views}×{height}×{width}, {threads} threads",
            ("decode", views, height, width, threads),
            (("libavcodec", views, height, width, threads), ("fill", views, height, width)),
        )
        for views, height, width in ((2, 256, 256), (16, 256, 256), (6, 512, 960))
        for threads in (1, 2)
    ]


def encode_cases() -> list[Case]:
    """Three profiles on two threads."""
    return [
        Case(
            f"encode {profile} 2×256×256, 2 threads",
            ("encode", profile, 2, 256, 256, 2),
            (("libx265", profile, 2, 256, 256, 2),),
            floors_differ=True,
        )
        for profile in ("fast", "balanced", "paper")
    ]


def render_cases(sizes: Sequence[tuple[int, int]], scene: str) -> list[Case]:
    """Frames along a path, in numpy and compiled."""
    return [
        Case(
            f"render {scene} {width}×{height}, {'compiled' if compiled else 'numpy'}, {threads} threads",
            ("render", scene, height, width, compiled, threads),
            (("exp", scene, height, width),),
        )
        for height, width in sizes
        for compiled in (False, True)
        for threads in (1, 2)
    ]


def start_cases() -> list[Case]:
    """`tinysplat decode` as a process."""
    return [Case("tinysplat decode, process start to file", ("start",), ())]


SECTIONS: dict[str, Callable[[], list[Case]]] = {
    "decode": decode_cases,
    "encode": encode_cases,
    "render": lambda: render_cases(((256, 256), (512, 512)), "small"),
    "large": lambda: render_cases(((540, 960),), "large"),
    "start": start_cases,
}


def decoding(folder: Path, views: int, height: int, width: int, threads: int) -> Call:
    """A file to Gaussians."""
    from tinysplat_runtime import Runtime

    runtime, data = Runtime(threads=threads), coded(folder, views, height, width)
    return lambda: runtime.decompress(data)


def libavcodec(folder: Path, views: int, height: int, width: int, threads: int) -> Call:
    """Its streams alone."""
    from tinysplat.bench.streams import decode_alone, file_streams

    return decode_alone(file_streams(coded(folder, views, height, width)), threads)


def fill(folder: Path, views: int, height: int, width: int) -> Call:
    """Write as many bytes as the decoded Gaussians take (SH degree 3) into fresh memory."""
    import numpy as np

    return lambda: np.full((views, height, width, 11 + 48), 1, np.float32)


def encoding(folder: Path, profile: str, views: int, height: int, width: int, threads: int) -> Call:
    """Gaussians to a file."""
    from tinysplat.bench.inputs import made_gaussians
    from tinysplat_runtime import Runtime

    runtime, gaussians = Runtime(threads=threads), made_gaussians(views, height, width, 3)
    return lambda: runtime.compress(gaussians, profile, drop_invalid=True)


def libx265(folder: Path, profile: str, views: int, height: int, width: int, threads: int) -> Call:
    """The planes of `encoding` alone."""
    from tinysplat.bench.streams import encode_alone, recorded_planes

    with recorded_planes() as planes:
        encoding(folder, profile, views, height, width, threads)()
    return encode_alone(planes, threads)


def coded(folder: Path, views: int, height: int, width: int) -> bytes:
    """A file of made-up Gaussians, the same for both versions."""
    path = folder / f"{views}x{height}x{width}.tsplat"
    if not path.exists():
        from tinysplat.bench.inputs import made_gaussians
        from tinysplat_runtime import Runtime

        path.write_bytes(Runtime().compress(made_gaussians(views, height, width, 3), drop_invalid=True))
    return path.read_bytes()


def rendering(folder: Path, scene: str, height: int, width: int, compiled: bool, threads: int) -> Call:
    """The next frame of a path, so that no two calls in a row have the same camera."""
    import render

    from tinysplat_runtime.render import Renderer, between

    gaussians = render.load(scene, None)
    path = itertools.cycle(between(list(gaussians.cameras), 8))
    renderer = Renderer(gaussians, threads, compiled=compiled)
    return lambda: renderer.render(next(path), (height, width))


def exponentials(folder: Path, scene: str, height: int, width: int) -> Call:
    """One `exp` for every pixel of every footprint before it stops."""
    import numpy as np
    import render

    from tinysplat_runtime.render import Renderer
    from tinysplat_runtime.render import composite as module

    gaussians, count, blend = render.load(scene, None), 0, module._blend

    def counting(state: Any, weights: Any, colours: Any, depths: Any) -> bool:
        nonlocal count
        count += np.count_nonzero(weights)
        return blend(state, weights, colours, depths)

    module._blend = counting
    Renderer(gaussians, 1, compiled=False).render(render.view_of(gaussians), (height, width))
    module._blend = blend
    exponents = -np.random.default_rng(0).uniform(0, 5, count).astype(np.float32)
    out = np.empty_like(exponents)
    return lambda: np.exp(exponents, out=out)


def starting(folder: Path) -> Call:
    """The command-line tool on a small file."""
    coded(folder, 2, 256, 256)
    command = [sys.executable, "-m", "tinysplat_runtime", "decode", str(folder / "2x256x256.tsplat")]
    command += ["-o", str(folder / "out.npz"), "-q"]
    return lambda: subprocess.run(command, check=True)


TASKS: dict[str, Callable[..., Call]] = {
    "decode": decoding,
    "libavcodec": libavcodec,
    "fill": fill,
    "encode": encoding,
    "libx265": libx265,
    "render": rendering,
    "exp": exponentials,
    "start": starting,
}


def work(folder: Path, pin: bool) -> None:
    """Answer requests on standard input, JSON arrays of a task and its arguments, with the seconds that a call took."""
    if pin:
        pin_pools()
    calls: dict[str, Call] = {}
    for line in sys.stdin:
        if line not in calls:
            name, *arguments = json.loads(line)
            calls[line] = TASKS[name](folder, *arguments)
            calls[line]()
        time.sleep(0.03)  # idle threads of a BLAS spin for a while
        start = time.perf_counter()
        result = calls[line]()
        seconds = time.perf_counter() - start
        del result
        print(seconds, flush=True)


def pin_pools() -> None:
    """Put this thread on the first core, and those of pools on the next ones in turn."""
    cores = sorted(os.sched_getaffinity(0))
    original = ThreadPoolExecutor.__init__

    def pinned(self: ThreadPoolExecutor, max_workers: int | None = None, thread_name_prefix: str = "") -> None:
        turn = itertools.cycle([*cores[1:], cores[0]])
        original(self, max_workers, thread_name_prefix, lambda: os.sched_setaffinity(0, {next(turn)}))

    ThreadPoolExecutor.__init__ = pinned  # type: ignore[method-assign]
    os.sched_setaffinity(0, cores[:1])


class Worker:
    """A process with one version of the code."""

    def __init__(self, checkout: Path, folder: Path, pin: bool) -> None:
        paths = [checkout / "runtime", checkout, ROOT / "benchmarks"]
        environment = os.environ | {
            "PYTHONPATH": os.pathsep.join(map(str, paths)),
            "TINYSPLAT_MODELS": str(checkout / "models"),
        }
        command = [sys.executable, __file__, "--worker", str(folder), *(["--pin"] if pin else [])]
        self._process = subprocess.Popen(
            command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=checkout
        )

    def seconds(self, task: tuple[Any, ...]) -> float:
        """Of one call."""
        assert self._process.stdin is not None and self._process.stdout is not None
        print(json.dumps(task), file=self._process.stdin, flush=True)
        return float(self._process.stdout.readline())

    def close(self) -> None:
        """End the process."""
        self._process.communicate()


def measure(case: Case, before: Worker, after: Worker, rounds: int) -> dict[str, str | float]:
    """Medians in milliseconds, and the ratios to the first floor taken round by round."""
    times: dict[str, list[float]] = {}
    for _ in range(rounds + 1):
        for floor in case.floors:
            times.setdefault(floor[0], []).append(after.seconds(floor))
        if case.floors_differ:
            times.setdefault("floor before", []).append(before.seconds(case.floors[0]))
        times.setdefault("before", []).append(before.seconds(case.task))
        times.setdefault("after", []).append(after.seconds(case.task))
    times = {name: values[1:] for name, values in times.items()}  # the first round warms up
    row: dict[str, str | float] = {"case": case.name}
    for name in ("before", "after"):
        row[f"{name} ms"] = round(1e3 * statistics.median(times[name]), 2)
    row["after / before"] = round(_ratio(times["after"], times["before"]), 2)
    for number, (name, *_) in enumerate(case.floors, 1):
        row[f"floor {number}"], row[f"floor {number} ms"] = name, round(1e3 * statistics.median(times[name]), 2)
    if case.floors:
        floor = times[case.floors[0][0]]
        row["before / floor 1"] = round(_ratio(times["before"], times.get("floor before", floor)), 2)
        row["after / floor 1"] = round(_ratio(times["after"], floor), 2)
    return row


def _ratio(above: Sequence[float], below: Sequence[float]) -> float:
    return statistics.median(a / b for a, b in zip(above, below, strict=True))


COLUMNS = ("case", "before ms", "after ms", "after / before", "floor 1", "floor 1 ms", "before / floor 1",
           "after / floor 1", "floor 2", "floor 2 ms")  # fmt: skip


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("section", nargs="?", choices=list(SECTIONS))
    parser.add_argument("--before", type=Path, help="checkout of the version to compare with")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--only", default="", metavar="TEXT", help="cases whose name holds this")
    parser.add_argument("--pin", action="store_true", help="threads of a pool stay on a core each")
    parser.add_argument("--worker", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.worker:
        work(args.worker, args.pin)
        return
    if args.section is None or args.before is None:
        parser.error("expected a section and --before CHECKOUT")
    writer = csv.DictWriter(sys.stdout, COLUMNS)
    writer.writeheader()
    with tempfile.TemporaryDirectory() as folder:
        workers = [Worker(checkout.resolve(), Path(folder), args.pin) for checkout in (args.before, ROOT)]
        for case in (case for case in SECTIONS[args.section]() if args.only in case.name):
            writer.writerow(measure(case, workers[0], workers[1], args.rounds))
            sys.stdout.flush()
        for worker in workers:
            worker.close()


if __name__ == "__main__":
    main()
