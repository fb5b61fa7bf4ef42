"""Ways to code Gaussians that ours are held against, there and back."""

from __future__ import annotations

import numpy as np
from scenes import make_gaussians

from tinysplat.measure.ways import decode_half, encode_half


def test_packed_half_floats_come_back_as_half_floats() -> None:
    gaussians = make_gaussians(2, 5, 7, degree=2).flat()
    found = decode_half(encode_half(gaussians))
    for name in ("means", "quats", "scales", "opacities", "sh"):
        wanted = getattr(gaussians, name).astype(np.float16).astype(np.float32)
        np.testing.assert_array_equal(getattr(found, name), wanted, err_msg=name)
