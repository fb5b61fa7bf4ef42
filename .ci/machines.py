"""The tests as other machines would run them: BLAS kernels, vector instructions, cores, old packages, absent ones.

    python .ci/machines.py [--each] [--numbers] [--only SkylakeX,…] [PYTEST ARGUMENTS…]      (`make test-machines`)

Every setting occurs in a run at least, several to a run; with `--each` every setting has a run of its own. `--numbers`
leaves out the tests of `NO_NUMBERS`. A table of what passed where goes to standard output and to build/machines.md;
the exit status is 1 if anything failed. Oldest and newest dependencies need the network.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import time
from pathlib import Path

from ranges import requirements

ROOT = Path(__file__).resolve().parents[1]
BUILD = ROOT / "build" / "machines"
TABLE = ROOT / "build" / "machines.md"

KERNELS = ("Haswell", "SkylakeX", "Prescott", "Zen")
"""Of OpenBLAS."""

VECTORS = {"no AVX-512": r"AVX512|X86_V4", "no AVX2": r"AVX512|X86_V4|AVX2|FMA3|X86_V3"}
"""What numpy is told not to use, by any of the names that its versions have for it."""

CORES = {"one core": 1, "two cores": 2}
ENDS = {"oldest dependencies": "oldest", "newest dependencies": "newest"}
NO_NUMBA = "no numba"
SETTINGS = (*KERNELS, *VECTORS, *CORES, *ENDS, NO_NUMBA)

RUNS: tuple[tuple[str, ...], ...] = (
    (),
    ("Prescott", "no AVX2", NO_NUMBA),
    ("Haswell", "no AVX-512", "one core"),
    ("SkylakeX", "two cores", "newest dependencies"),
    ("Zen", "oldest dependencies"),
)

NO_NUMBERS = (
    "tests/project", "tests/faults", "tests/page/test_browser.py", "tests/web/test_browser.py",
    "tests/web/test_fuzz.py", "tests/hostile/test_fuzz.py", "tests/e2e/test_pages.py", "tests/e2e/test_wheel.py",
    "tests/e2e/test_notebook.py", "tests/e2e/test_privacy.py", "tests/e2e/test_extras.py",
)  # fmt: skip
"""Texts of the project, Chromium, fuzzing, processes that are interrupted, wheels: no last bit decides there."""


def main() -> int:
    """Make every run asked for, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--each", action="store_true", help="every setting alone")
    parser.add_argument("--numbers", action="store_true", help="without tests in which no number is computed")
    parser.add_argument("--only", default="", help="runs with any of these settings, separated by commas")
    args, rest = parser.parse_known_args()
    runs = [(), *((setting,) for setting in SETTINGS)] if args.each else RUNS
    wanted = set(filter(None, args.only.split(",")))
    rest += [f"--ignore={path}" for path in NO_NUMBERS] if args.numbers else []
    lines = ["| machine | outcome | failed | seconds |", "|---|---|---|---|"]
    for settings in (run for run in runs if not wanted or wanted & set(run)):
        lines.append(tested(settings, rest))
        print(lines[-1], flush=True)
        TABLE.parent.mkdir(exist_ok=True)
        TABLE.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return int(any("failed" in line or "error" in line for line in lines[1:]))


def tested(settings: tuple[str, ...], arguments: list[str]) -> str:
    """A line of the table."""
    environment = dict(os.environ)
    folders = [str(overlay(ENDS[name])) for name in settings if name in ENDS]
    if NO_NUMBA in settings:
        stub = BUILD / "no_numba" / "numba.py"
        stub.parent.mkdir(parents=True, exist_ok=True)
        stub.write_text("raise ModuleNotFoundError('No module named numba', name='numba')\n", encoding="utf-8")
        folders.append(str(stub.parent))
    else:
        environment["TINYSPLAT_ALL_EXTRAS"] = "1"
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, (*folders, environment.get("PYTHONPATH", ""))))
    for name in settings:
        if name in KERNELS:
            environment["OPENBLAS_CORETYPE"] = name
        if name in VECTORS:
            environment["NPY_DISABLE_CPU_FEATURES"] = " ".join(features(VECTORS[name], environment))
    cores = next((CORES[name] for name in settings if name in CORES), None)
    command = [sys.executable, "-m", "pytest", "-q", "-m", "not slow", "--dist", "worksteal", "-p", "no:cacheprovider"]
    command += ["-n", str(cores or "auto"), *arguments]
    if "oldest dependencies" in settings:
        command += ["-W", "default"]  # old versions warn about what newer ones mended
    if cores:
        command = ["taskset", "-c", ",".join(map(str, range(cores))), *command]
    began = time.monotonic()
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    closing = done.stdout.strip().splitlines()[-1:] or [done.stderr.strip()[-200:]]
    outcome = re.sub(r"[= ]* in [\d.]+s.*", "", closing[0]).strip("= ")
    failed = sorted(set(re.findall(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.MULTILINE)))
    name = ", ".join(settings) or "as it is"
    return f"| {name} | {outcome} | {'<br>'.join(failed)} | {time.monotonic() - began:.0f} |"


def features(pattern: str, environment: dict[str, str]) -> list[str]:
    """The processor features that numpy chooses between and whose names begin like this."""
    code = "import numpy; print(*(getattr(numpy, '_core', None) or numpy.core)._multiarray_umath.__cpu_dispatch__)"
    shown = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    return [name for name in shown.stdout.split() if re.match(pattern, name)]


def overlay(end: str) -> Path:
    """A folder with the runtime's dependencies at one end of their ranges, made once; first on the path, it counts."""
    folder = BUILD / end
    if not folder.is_dir():
        others = ["scipy", "scikit-image", "matplotlib"] if end == "oldest" else []  # those of today want another numpy
        command = [sys.executable, "-m", "pip", "install", "-q", "--only-binary", ":all:", "--target", str(folder)]
        subprocess.run([*command, *requirements(end), *others], check=True)
    return folder


if __name__ == "__main__":
    sys.exit(main())
