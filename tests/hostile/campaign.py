"""The fuzz campaign: millions of damaged files, in processes of their own so that a crash is a finding, not an end.

    PYTHONPATH=tests python -m hostile.campaign [--scale 1.0] [--targets container,decode] [-o REPORT.json]
    PYTHONPATH=tests python -m hostile.campaign --case container:123456     # one attack again, with its traceback

One JSON line per target on standard output: attacks, outcomes, attacks per CPU second, the slowest attack's CPU
seconds, growth of peak memory over what preparing took, and findings with their numbers. Warnings count as errors.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path
from random import Random
from typing import Any

from tinysplat_runtime.errors import InputWarning

from .targets import TARGETS, attack, prepare

COUNTS = {
    "container": 1_000_000, "picture": 400_000, "parameter_sets": 200_000, "decode": 100_000, "info": 50_000,
    "video": 10_000, "png": 5_000, "jpeg": 5_000, "heic": 5_000, "onnx": 5_000, "mask": 5_000,
}  # fmt: skip
"""Attacks of a full campaign, where they are not `MOST`."""

MOST = 20_000

CHUNK = 25_000
"""Attacks per process: what one leaks shows as growth, and a crash costs little."""

HANG_S = 2.0
"""CPU seconds that no attack may take."""

_KILL_AFTER_S = 3600


def _warnings_are_errors() -> None:
    """All but those that are meant for users."""
    warnings.simplefilter("error")
    warnings.simplefilter("ignore", InputWarning)


def run_chunk(name: str, start: int, count: int, progress: Path) -> dict[str, Any]:
    """Attack in this process; the number of the attack under way stands in `progress`, for whoever survives it."""
    _warnings_are_errors()
    target = TARGETS[name]
    prepare(target)
    before = _peak_kb()
    outcomes: Counter[str] = Counter()
    findings, slowest = [], (0.0, start)
    began = time.process_time()
    with progress.open("wb", buffering=0) as file:
        for case in range(start, start + count):
            file.seek(0)
            file.write(case.to_bytes(8, "little"))
            at = time.process_time()
            outcome = attack(target, case)
            taken = time.process_time() - at
            slowest = max(slowest, (taken, case))
            outcomes[outcome.kind] += 1
            if outcome.kind == "finding":
                findings.append({"case": case, "what": outcome.message[:300]})
            elif taken > HANG_S:
                findings.append({"case": case, "what": f"took {taken:.1f} CPU seconds"})
    return {
        "outcomes": outcomes,
        "findings": findings[:50],
        "cpu_seconds": time.process_time() - began,
        "slowest": {"cpu_seconds": slowest[0], "case": slowest[1]},
        "grown_kb": _peak_kb() - before,
    }


def run_target(name: str, count: int) -> dict[str, Any]:
    """All chunks of a target, one process after the other."""
    total: dict[str, Any] = {"target": name, "attacks": 0, "outcomes": Counter(), "findings": [], "cpu_seconds": 0.0}
    slowest, grown, began = {"cpu_seconds": 0.0, "case": 0}, 0, time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        progress = Path(folder) / "case"
        start = 0
        while start < count:
            size = min(CHUNK, count - start)
            found, done = _spawn(name, start, size, progress)
            start += done
            total["attacks"] += done
            total["outcomes"].update(found["outcomes"])
            total["findings"] += found["findings"]
            total["cpu_seconds"] += found["cpu_seconds"]
            slowest = max(slowest, found["slowest"], key=lambda s: s["cpu_seconds"])
            grown = max(grown, found["grown_kb"])
    return {
        **total,
        "slowest": slowest,
        "grown_mb": round(grown / 1024, 1),
        "per_cpu_second": round(total["attacks"] / max(total["cpu_seconds"], 1e-9)),
        "wall_seconds": round(time.perf_counter() - began, 1),
    }


def _spawn(name: str, start: int, count: int, progress: Path) -> tuple[dict[str, Any], int]:
    """A chunk's result and how many attacks it covers; a process that dies is a finding at the attack it died in."""
    command = [sys.executable, "-m", "hostile.campaign", "--chunk", f"{name}:{start}:{count}:{progress}"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=_KILL_AFTER_S, check=False)
    if done.returncode == 0:
        lines = done.stdout.split("\n")
        result = next(line for line in lines if line.startswith('{"outcomes"'))  # a library may print after it, too
        noise = [line for line in lines if line and line != result]
        found = json.loads(result)
        if noise or done.stderr:  # standard output carries results only, and refusals are exceptions
            found["findings"].append({"case": start, "what": f"printed: {[*noise, done.stderr][0][:200]}"})
        return found, count
    case = int.from_bytes(progress.read_bytes(), "little") if progress.exists() else start
    finding = {"case": case, "what": f"process ended with status {done.returncode}: {done.stderr[-300:]}"}
    nothing = {"cpu_seconds": 0.0, "case": case}
    died = {"outcomes": {"finding": 1}, "findings": [finding], "cpu_seconds": 0.0, "slowest": nothing, "grown_kb": 0}
    return died, case - start + 1


def _peak_kb() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def main() -> int:
    """Run what the command line asks for; status 1 when there are findings."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--scale", type=float, default=1.0, help="share of a full campaign's attacks")
    parser.add_argument("--targets", default=",".join(TARGETS), help="comma-separated; default all")
    parser.add_argument("-o", "--output", type=Path, help="also write all lines as one JSON list")
    parser.add_argument("--case", metavar="TARGET:N", help="run one attack again and let its error through")
    parser.add_argument("--chunk", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.chunk:
        name, start, count, progress = args.chunk.split(":", 3)
        print(json.dumps(run_chunk(name, int(start), int(count), Path(progress))))
        return 0
    if args.case:
        name, case = args.case.split(":")
        _warnings_are_errors()
        TARGETS[name].attack(Random(f"{name} {int(case)}"))
        return 0
    rows = []
    for name in args.targets.split(","):
        rows.append(run_target(name, max(1, round(COUNTS.get(name, MOST) * args.scale))))
        print(json.dumps(rows[-1]), flush=True)
        if args.output:
            args.output.write_text(json.dumps(rows, indent=1) + "\n")
    return int(any(row["findings"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
