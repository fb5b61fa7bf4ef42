"""Rate control: how near targets are met, and what the search costs.

    python benchmarks/rate.py [--profiles balanced] [--sizes 40,80,160] [--psnrs 38,42] G.npz …

One JSON line per target and one of means per profile. For sizes (KB): `share` of the target that the file has, `ratio`
of CPU time to a plain encode at the Q_g that was found (median of three rounds, interleaved), and `loss_db`, what the
search's file lacks against the plain one at the same bytes, which lie within a few percent: PSNR of decoded to raw
renders at the input views, the plain file's moved along 0.085 octaves and 0.5 dB per Q_g. For PSNRs (dB): `excess_db`
and the same ratio.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections import defaultdict
from collections.abc import Callable

import numpy as np

import tinysplat_runtime as ts
from tinysplat.measure.metrics import psnr

_DB_PER_OCTAVE = 0.5 / 0.085


def timed(call: Callable[[], bytes]) -> tuple[bytes, float]:
    """What it gives, and CPU seconds."""
    start = time.process_time()
    data = call()
    return data, time.process_time() - start


def measure(name: str, gaussians: ts.Gaussians, profile: str, target: dict[str, float]) -> dict:
    """One target of one file."""
    runtime = ts.Runtime()
    hit, plain, ratios = b"", b"", []
    for _ in range(3):
        hit, searched = timed(lambda: runtime.compress(gaussians, profile, **target))  # type: ignore[arg-type]
        qp = ts.inspect(hit)["qp"]
        plain, seconds = timed(lambda qp=qp: runtime.compress(gaussians, profile, qp))  # type: ignore[misc]
        ratios.append(searched / seconds)
    raw = [runtime.render(gaussians, camera) for camera in gaussians.cameras]

    def fidelity(data: bytes) -> float:
        decoded = runtime.decompress(data)
        return float(
            np.mean([psnr(runtime.render(decoded, c), r) for c, r in zip(gaussians.cameras, raw, strict=True)])
        )

    row = {"file": name, "profile": profile, **target, "bytes": len(hit), "qp": round(qp, 2)}
    found = fidelity(hit)
    if "target_size" in target:
        row["share"] = len(hit) / target["target_size"]
        row["loss_db"] = fidelity(plain) + _DB_PER_OCTAVE * math.log2(len(hit) / len(plain)) - found
    else:
        row["excess_db"] = found - target["target_psnr"]
    return {**row, "psnr": found, "ratio": float(np.median(ratios))}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("files", nargs="+")
    parser.add_argument("--profiles", default="paper,fast,balanced,max")
    parser.add_argument("--sizes", default="40,80,160")
    parser.add_argument("--psnrs", default="38")
    args = parser.parse_args()
    targets = [{"target_size": int(float(size) * 1000)} for size in args.sizes.split(",") if size]
    targets += [{"target_psnr": float(value)} for value in args.psnrs.split(",") if value]  # type: ignore[dict-item]
    rows: dict[str, list[dict]] = defaultdict(list)
    for file in args.files:
        gaussians = ts.load_gaussians(file)
        for profile in args.profiles.split(","):
            for target in targets:
                row = measure(file, gaussians, profile, target)
                rows[profile].append(row)
                print(json.dumps({k: round(v, 4) if isinstance(v, float) else v for k, v in row.items()}), flush=True)
    for profile, group in rows.items():
        sizes = [row for row in group if "share" in row]
        worst = {"share_least": min(r["share"] for r in sizes), "share_most": max(r["share"] for r in sizes)}
        ratios = [row["ratio"] for row in sizes]
        summary = {**worst, "ratio_median": float(np.median(ratios)), "ratio_most": max(ratios)}
        print(json.dumps({"case": f"rate/{profile}", **{k: round(v, 4) for k, v in summary.items()}}))


if __name__ == "__main__":
    main()
