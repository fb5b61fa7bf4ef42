"""Rewrite the golden files from `tests/golden_cases.py` (`make golden`).

A reviewed decision: its reason goes into the changelog.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "runtime"), str(ROOT / "tests")]

from golden_cases import DATA, FILES, golden_planes  # noqa: E402

import tinysplat_runtime as ts  # noqa: E402
from tinysplat_runtime.codec.hevc import encode_plane  # noqa: E402
from tinysplat_runtime.codec.profiles import EncoderSettings  # noqa: E402
from tinysplat_runtime.gaussian.gaussians import FIELDS  # noqa: E402


def main() -> None:
    """Write every golden file."""
    DATA.mkdir(exist_ok=True)
    for case in FILES:
        data = case.code(case.make(), case.profile, case.qp)
        (DATA / f"{case.name}.tsplat").write_bytes(data)
        decoded = ts.decompress(data)
        arrays = {f"layer{n}_{name}": getattr(layer, name) for n, layer in enumerate(decoded.layers) for name in FIELDS}
        np.savez_compressed(DATA / f"{case.name}.npz", **arrays)
        print(case.name, len(data))
    for name, (codes, qp) in golden_planes().items():
        coded = encode_plane(codes, qp, EncoderSettings("medium"))
        (DATA / f"{name}.hevc").write_bytes(coded.parameter_sets + coded.payload)


if __name__ == "__main__":
    main()
