"""The runtime's decoder as a command for `run.py`.

PYTHONPATH=tests python -m conformance.reference F.tsplat OUT.npz [OPTIONS]
"""

import json
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import tinysplat_runtime as ts
from tinysplat_runtime.gaussian.gaussians import FIELDS


def decode(data: bytes, maxBytes: int | None = None, recover: bool = False) -> ts.Gaussians:
    """The Gaussians of a file under the options of a case; FormatError where it is refused."""
    lost: list[str] | None = [] if recover else None
    return ts.Runtime(threads=1).decompress(data, max_bytes=maxBytes, lost=lost)


def arrays_of(gaussians: ts.Gaussians) -> dict[str, NDArray]:
    """All layers' arrays one after the other, the origin, and of each layer views, rows, columns, degree and place."""
    flat = gaussians.flat()
    rows, at = [], 0
    for layer in gaussians.layers:
        shape = layer.opacities.shape if layer.is_per_pixel else (0, 0, 0)
        rows.append([*shape, layer.degree, at])
        at += layer.opacities.size
    arrays = {name: getattr(flat, name) for name in FIELDS}
    return {**arrays, "origin": np.asarray(flat.origin), "layers": np.array(rows, np.int32)}


def main(file: str, out: str, options: str = "{}") -> int:
    """Decode; returns the exit status."""
    try:
        gaussians = decode(Path(file).read_bytes(), **json.loads(options))
    except ts.FormatError as error:
        print(error, file=sys.stderr)
        return 2
    np.savez(out, **arrays_of(gaussians))  # type: ignore[arg-type]
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
