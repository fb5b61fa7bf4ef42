"""Damaged files for tsplat.js, which has to refuse them or to decode what the runtime decodes.

    PYTHONPATH=tests python -m web.campaign [--count 20000] [--first 0]

One JSON object on standard output: outcomes, findings with their numbers, the slowest attack and the largest memory.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from random import Random
from typing import Any

import numpy as np
from hostile import corpus
from hostile.containers import damage_container, damage_whole
from hostile.targets import LIMITS
from numpy.typing import NDArray
from web.node import Decoder

import tinysplat_runtime as ts
from tinysplat_runtime.codec.decoder import decode_gaussians
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.errors import FormatError
from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.gaussian.planes import MAX_CODE
from tinysplat_runtime.graphs.inference import GraphStore

SLOW_MS = 2000.0
MOST_MB = 200.0
"""Node itself, its compiled code and what LIMITS lets a file take."""

TOLERANCE, TERM_TOLERANCE = 1e-4, 1e-6
"""Of an array's largest value, and of the largest term of SH coefficients: damaged numbers cancel in float32 as a
file's own never do."""


def damaged(case: int) -> tuple[bytes, dict[str, Any]]:
    """Attack number `case`: a file, and options for both decoders."""
    rng = Random(f"web {case}")
    seeds = rng.choices((corpus.tsplat_seeds(), corpus.free_seeds(), corpus.photo_file_seeds()), (0.7, 0.2, 0.1))[0]
    data = rng.choices((damage_whole, damage_container), (0.7, 0.3))[0](rng.choice(seeds), rng)
    options: dict[str, Any] = {}
    if rng.random() < 0.2:
        options["maxBytes"] = rng.randrange(len(data) + 10)
    if rng.random() < 0.2:
        options["recover"] = True
    return data, options


def reference(data: bytes, options: dict[str, Any], store: GraphStore) -> ts.Gaussians | str:
    """What the runtime decodes, or why it refuses."""
    lost: list[str] | None = [] if options.get("recover") else None
    try:
        return decode_gaussians(
            data, store, threads=1, limits=LIMITS, max_bytes=options.get("maxBytes"), lost=lost
        ).flat()
    except FormatError as error:
        return str(error)


def largest_term(data: bytes) -> float:
    """Bound of what is added up to an SH coefficient of the file's layers."""
    body = read_container(data, LIMITS, is_prefix=True).body
    terms = [0.0]
    for layer in getattr(body, "layers", ()):
        basis = 1.0 if getattr(layer, "basis", None) is None else float(np.abs(layer.basis.astype(float)).max())
        terms += [(abs(c.offset) + MAX_CODE * abs(c.scale)) * basis for c in getattr(layer, "channels", ())]
    return max(terms)


def fault(data: bytes, said: dict[str, Any], found: dict[str, NDArray], wanted: ts.Gaussians | str) -> str | None:
    """What is wrong with tsplat.js's answer; None if nothing is."""
    if said["ms"] > SLOW_MS:
        return f"took {said['ms']:.0f} ms"
    if said["mb"] > MOST_MB:
        return f"node has {said['mb']:.0f} MB"
    if "error" in said:
        return None if said["error"] == "TsplatError" and said["section"] else f"{said['error']}: {said['stack']}"
    if isinstance(wanted, str):
        return f"decoded, where the runtime says: {wanted}"
    for name in FIELDS:
        theirs, ours = getattr(wanted, name), found[name]
        if theirs.shape != ours.shape:
            return f"{name}: shape {ours.shape}, expected {theirs.shape}"
        if not np.isfinite(ours).all():
            return f"{name} is not finite"
        difference = float(np.abs(ours - theirs.astype(np.float64)).max())
        accepted = TOLERANCE * max(float(np.abs(theirs).max()), 1e-30)
        if difference > accepted and not (name == "sh" and difference <= TERM_TOLERANCE * largest_term(data)):
            return f"{name} differs by {difference:.3g} of {float(np.abs(theirs).max()):.3g}"
    return None


def attack(first: int, count: int) -> dict[str, Any]:
    """Run attacks; the same numbers are the same files."""
    outcomes: Counter[str] = Counter()
    findings, slowest, largest = [], (0.0, first), 0.0
    store = GraphStore(threads=1)
    limits = {"maxPixels": LIMITS.max_pixels, "maxMemory": LIMITS.max_memory_bytes}
    with Decoder() as decode:
        for case in range(first, first + count):
            data, options = damaged(case)
            said, found = decode(data, limits=limits, **options)
            network = said.get("section", "") == "NETW[0]"  # nothing is given here that could run it
            wanted = "a network is needed" if network else reference(data, options, store)
            accepted = "refused" if "error" in said else "decoded"
            outcomes[f"{accepted}, runtime {'refused' if isinstance(wanted, str) else 'decoded'}"] += 1
            slowest, largest = max(slowest, (said["ms"], case)), max(largest, said["mb"])
            if what := fault(data, said, found, wanted):
                findings.append({"case": case, "what": what[:300], "options": options})
    return {
        "attacks": count,
        "outcomes": outcomes,
        "findings": findings,
        "slowest": {"ms": slowest[0], "case": slowest[1]},
        "mb": largest,
    }


def main() -> int:
    """Run what the command line asks for; status 1 when there are findings."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--count", type=int, default=20_000, help="attacks")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    args = parser.parse_args()
    result = attack(args.first, args.count)
    print(json.dumps(result, indent=1))
    return int(bool(result["findings"]))


if __name__ == "__main__":
    sys.exit(main())
