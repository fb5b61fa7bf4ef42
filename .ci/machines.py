"""The tests as other machines would run them: other BLAS kernels, fewer vector instructions, one core, no numba.

    python .ci/machines.py [--only NAME,…] [PYTEST ARGUMENTS…]      (`make test-machines`)

A table of what passed where goes to standard output and to build/machines.md; the exit status is 1 if anything failed.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "build" / "machines.md"
AVX512 = "AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL AVX512_SPR"


@dataclass(frozen=True)
class Machine:
    """What sets one apart: environment variables, a number of cores, packages that are not there."""

    name: str
    variables: dict[str, str] = field(default_factory=dict)
    cores: int | None = None
    absent: str = ""


MACHINES = (
    Machine("as it is"),
    *(Machine(f"OpenBLAS {name}", {"OPENBLAS_CORETYPE": name}) for name in ("Haswell", "SkylakeX", "Prescott", "Zen")),
    Machine("numpy without AVX-512", {"NPY_DISABLE_CPU_FEATURES": AVX512}),
    Machine("numpy without AVX2", {"NPY_DISABLE_CPU_FEATURES": f"{AVX512} AVX2 FMA3"}),
    Machine("one core", cores=1),
    Machine("two cores", cores=2),
    Machine("without numba", absent="numba"),
)


def main() -> int:
    """Run the tests on every machine asked for, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="names of machines, separated by commas")
    args, rest = parser.parse_known_args()
    chosen = [machine for machine in MACHINES if not args.only or machine.name in args.only.split(",")]
    lines = ["| machine | outcome | failed | seconds |", "|---|---|---|---|"]
    for machine in chosen:
        lines.append(run(machine, rest))
        print(lines[-1], flush=True)
        OUT.parent.mkdir(exist_ok=True)
        OUT.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return int(any("failed" in line or "error" in line for line in lines[1:]))


def run(machine: Machine, arguments: list[str]) -> str:
    """A line of the table."""
    environment = {**os.environ, **machine.variables}
    if machine.absent:
        stub = OUT.parent / f"without-{machine.absent}" / f"{machine.absent}.py"
        stub.parent.mkdir(parents=True, exist_ok=True)
        stub.write_text(f"raise ModuleNotFoundError('No module named {machine.absent}', name='{machine.absent}')\n")
        paths = [str(stub.parent), environment.get("PYTHONPATH", "")]
        environment["PYTHONPATH"] = os.pathsep.join(filter(None, paths))
    else:
        environment["TINYSPLAT_ALL_EXTRAS"] = "1"
    command = [sys.executable, "-m", "pytest", "-q", "-m", "not slow", "--dist", "loadfile", "-p", "no:cacheprovider"]
    command += ["-n", str(machine.cores or "auto"), *arguments]
    if machine.cores:
        command = ["taskset", "-c", ",".join(map(str, range(machine.cores))), *command]
    began = time.monotonic()
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    closing = done.stdout.strip().splitlines()[-1:] or [done.stderr.strip()[-200:]]
    outcome = re.sub(r"[= ]* in [\d.]+s.*", "", closing[0]).strip("= ")
    failed = sorted(set(re.findall(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.MULTILINE)))
    return f"| {machine.name} | {outcome} | {'<br>'.join(failed)} | {time.monotonic() - began:.0f} |"


if __name__ == "__main__":
    sys.exit(main())
