"""One row about this processor: what decodes to the same bits as elsewhere, what differs and by how much, and seconds.

    python checks/processor.py [--repeat 5]

Needs the runtime alone (numpy, onnxruntime, av). Run it on a Raspberry Pi, or on any machine that is not listed yet.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import sys
import time
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "runtime"), str(ROOT / "tests")]
os.environ.setdefault("TINYSPLAT_MODELS", str(ROOT / "models"))

from golden.cases import DATA, FILES, golden_planes  # noqa: E402

import tinysplat_runtime as ts  # noqa: E402
from tinysplat_runtime.codec.hevc import encode_plane  # noqa: E402
from tinysplat_runtime.codec.profiles import EncoderSettings  # noqa: E402
from tinysplat_runtime.gaussian.gaussians import FIELDS  # noqa: E402


def main() -> int:
    """Print what was found; status 1 where something differs by more than FORMAT.md allows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=5, help="decodes and encodes timed, of which the median is told")
    repeat = parser.parse_args().repeat
    print(
        f"processor: {platform.machine()}, {os.cpu_count()} cores, {platform.system()}, Python", sys.version.split()[0]
    )
    sizes = [_check_planes()]
    runtime = ts.Runtime()
    for case in FILES:
        data = (DATA / f"{case.name}.tsplat").read_bytes()
        worst, equal = _worst(runtime.decompress(data), case.name)
        again = runtime.compress(case.make(), case.profile, case.qp)
        same = "the golden bytes" if again == data else f"{len(again)} bytes, the golden file has {len(data)}"
        print(
            f"{case.name}: decodes with {worst:.1e} of the largest value at most, {equal} fields bit for bit; "
            f"encodes to {same} ({sha256(again).hexdigest()[:12]})"
        )
        sizes.append(worst <= 5e-6)
        _seconds(f"{case.name}: decoding", repeat, lambda data=data: runtime.decompress(data))
        _seconds(f"{case.name}: encoding", repeat, lambda case=case: runtime.compress(case.make(), case.profile))
    print("peak memory:", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024, "MB")
    return 0 if all(sizes) else 1


def _check_planes() -> bool:
    """Whether integer planes code to the golden bytes."""
    alike = {}
    for name, (codes, qp) in golden_planes().items():
        coded = encode_plane(codes, qp, EncoderSettings("medium"))
        alike[name] = coded.parameter_sets + coded.payload == (DATA / f"{name}.hevc").read_bytes()
    print(
        "integer planes code to the golden bytes:", ", ".join(f"{n} {'yes' if a else 'NO'}" for n, a in alike.items())
    )
    return all(alike.values())


def _worst(decoded: ts.Gaussians, name: str) -> tuple[float, str]:
    """Largest difference to the golden Gaussians as a share of a field's largest value, and in how many none is."""
    golden, differences = np.load(DATA / f"{name}.npz"), []
    for index, layer in enumerate(decoded.layers):
        for field in FIELDS:
            wanted = golden[f"layer{index}_{field}"].astype(np.float64)
            differences.append(float(np.abs(getattr(layer, field) - wanted).max() / max(np.abs(wanted).max(), 1e-30)))
    return max(differences), f"{differences.count(0.0)} of {len(differences)}"


def _seconds(label: str, repeat: int, work: Callable[[], object]) -> None:
    seconds = []
    for _ in range(repeat):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    print(f"{label}: {np.median(seconds):.4f} s")


if __name__ == "__main__":
    sys.exit(main())
