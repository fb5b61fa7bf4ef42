"""Hold a decoder to the corpus.

    python tests/conformance/run.py [--without network,views] [--cases NAME,…] -- COMMAND…

COMMAND is called with a file, the .npz to write and, where a case has them, options as JSON. It ends with 0 and writes
arrays as `expected.npz` has them (means, quats, scales, opacities, sh, origin), or ends otherwise and writes nothing.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

CASES = Path(__file__).parent / "cases"

Answer = Mapping[str, NDArray] | None
"""Arrays, or None of a file that was refused."""


def names() -> list[str]:
    """All cases."""
    return sorted(folder.name for folder in CASES.iterdir())


def described(name: str) -> tuple[Path, dict[str, Any]]:
    """A case's file and its description."""
    path = CASES / name / f"{name}.tsplat"
    return path, json.loads((CASES / name / "case.json").read_text("utf-8"))


def fault(name: str, decode: Callable[[Path, dict[str, Any]], Answer]) -> str | None:
    """What is wrong with a decoder's answer to a case; None if nothing is."""
    path, case = described(name)
    if sha256(path.read_bytes()).hexdigest() != case["sha256"]:
        return "the file is not the corpus'"
    found = decode(path, case.get("options", {}))
    if case.get("refused"):
        return None if found is None else "was not refused"
    if found is None:
        return "was refused"
    with np.load(CASES / name / "expected.npz") as expected:
        if not np.array_equal(found["origin"], expected["origin"]):
            return f"origin {found['origin']}, expected {expected['origin']}"
        for array, tolerance in case["tolerance"].items():
            ours, theirs = expected[array], np.asarray(found[array])
            if theirs.shape != ours.shape:
                return f"{array}: shape {theirs.shape}, expected {ours.shape}"
            largest = max(float(np.abs(ours).max()), case.get("scales", {}).get(array, 0.0))
            difference = float(np.abs(theirs.astype(np.float64) - ours).max())
            if not difference <= tolerance * largest:
                return f"{array} differs by {difference:.3g}, {tolerance * largest:.3g} is accepted"
    return None


def called(command: list[str]) -> Callable[[Path, dict[str, Any]], Answer]:
    """A decoder that is a command."""

    def decode(path: Path, options: dict[str, Any]) -> Answer:
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "out.npz"
            given = [json.dumps(options)] if options else []
            done = subprocess.run([*command, str(path), str(out), *given], capture_output=True, text=True, check=False)
            if done.returncode or not out.exists():
                return None
            with np.load(out) as arrays:
                return dict(arrays)

    return decode


def main() -> int:
    """Run what the command line asks for; status 1 when a case fails."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--without", default="", help="what the decoder cannot do: network, views")
    parser.add_argument("--cases", help="these alone")
    parser.add_argument("command", nargs="+", help="behind --")
    args = parser.parse_args()
    lacking, failed, left = set(args.without.split(",")), 0, 0
    for name in args.cases.split(",") if args.cases else names():
        if lacking & set(described(name)[1].get("needs", [])):
            left += 1
            continue
        what = fault(name, called(args.command))
        failed += what is not None
        print(f"{'ok  ' if what is None else 'FAIL'} {name}{': ' + what if what else ''}", flush=True)
    print(f"{failed} failed, {left} left out")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
