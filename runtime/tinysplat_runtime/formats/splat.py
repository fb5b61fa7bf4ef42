"""`.splat` in, antimatter15's 32 bytes a Gaussian, which lie behind us.

Means and scales as three float32 each, RGBA as bytes, the quaternion wxyz as bytes (v − 128) / 128.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian.sh import C0
from ..system.files import read_limited
from .assembly import Contents

_RECORD = np.dtype([("means", "<f4", 3), ("scales", "<f4", 3), ("rgba", "u1", 4), ("quats", "u1", 4)])


def read_splat(path: Path, max_bytes: int) -> Contents:
    """Read means (N, 3), quats (N, 4), scales (N, 3), opacities (N,) and sh (N, 1, 3), linear, float.

    Raises:
        InputError: damaged, or larger than `max_bytes`.
    """
    data = read_limited(path, max_bytes)
    if len(data) % _RECORD.itemsize:
        raise InputError(f"{len(data)} bytes, expected a multiple of {_RECORD.itemsize}")
    rows = np.frombuffer(data, _RECORD)
    quats = (rows["quats"].astype(np.float64) - 128) / 128
    quats[~quats.any(axis=1), 0] = 1  # all 128: no rotation
    arrays: dict[str, NDArray] = {
        "means": rows["means"],
        "quats": quats,
        "scales": rows["scales"],
        "opacities": rows["rgba"][:, 3] / 255.0,
        "sh": ((rows["rgba"][:, None, :3] / 255.0) - 0.5) / C0,
    }
    return arrays, {}
