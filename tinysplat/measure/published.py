"""Figures that others published, quoted beside ours and never mixed with them: the paper's, arXiv 2506.09479, and those
of its peers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


class Quality(NamedTuple):
    """One cell: PSNR in dB, SSIM, LPIPS (VGG), and size in MB (raw sizes are rounded there, and count 2^20 bytes)."""

    psnr: float
    ssim: float
    lpips: float
    megabytes: float


MAIN: dict[str, dict[str, dict[str, Quality]]] = {
    "MVSplat": {
        "raw": {"re10k": Quality(26.36, 0.8679, 0.1291, 43), "acid": Quality(28.21, 0.8419, 0.1448, 43)},
        "FCGS": {"re10k": Quality(25.90, 0.8586, 0.1533, 2.650), "acid": Quality(27.61, 0.8298, 0.1800, 2.596)},
        "TinySplat": {"re10k": Quality(26.32, 0.8671, 0.1349, 0.216), "acid": Quality(28.13, 0.8401, 0.1528, 0.229)},
    },
    "DepthSplat": {
        "raw": {"re10k": Quality(27.50, 0.8900, 0.1125, 19), "acid": Quality(28.37, 0.8481, 0.1417, 19)},
        "FCGS": {"re10k": Quality(27.35, 0.8863, 0.1201, 2.674), "acid": Quality(28.27, 0.8454, 0.1466, 2.666)},
        "TinySplat": {"re10k": Quality(27.43, 0.8886, 0.1192, 0.166), "acid": Quality(28.29, 0.8470, 0.1501, 0.181)},
    },
}
"""Two views, Q_g = 0: network, codec, data set."""

VIEWS: dict[int, dict[str, Quality]] = {
    2: {
        "raw": Quality(19.62, 0.6265, 0.2986, 33),
        "FCGS": Quality(19.26, 0.6183, 0.3061, 4.518),
        "TinySplat": Quality(19.52, 0.6196, 0.3147, 0.615),
    },
    4: {
        "raw": Quality(23.16, 0.7792, 0.1745, 66),
        "FCGS": Quality(22.23, 0.7619, 0.1897, 9.054),
        "TinySplat": Quality(22.99, 0.7694, 0.1923, 1.275),
    },
    6: {
        "raw": Quality(24.16, 0.8191, 0.1456, 100),
        "FCGS": Quality(22.74, 0.7943, 0.1672, 13.561),
        "TinySplat": Quality(23.95, 0.8085, 0.1633, 1.892),
    },
}
"""DL3DV, DepthSplat: number of context views, codec."""

TIMES: dict[str, dict[str, float]] = {
    "FCGS": {"encode": 4.074, "decode": 4.095},
    "TinySplat": {"encode": 1.016, "vpt": 0.003, "vabr": 0.004, "hevc": 0.971, "decode": 0.042},
}
"""Seconds on an i7-13700K with an RTX 4090."""

BITS: dict[int, tuple[float, dict[str, float]]] = {
    0: (164.63, {"position": 21.4, "scale": 17.5, "rotation": 13.0, "color": 34.6, "opacity": 13.5}),
    3: (122.29, {"position": 21.0, "scale": 18.0, "rotation": 11.5, "color": 35.7, "opacity": 13.7}),
    6: (89.91, {"position": 20.5, "scale": 18.8, "rotation": 10.2, "color": 36.7, "opacity": 13.8}),
    12: (47.90, {"position": 20.0, "scale": 20.1, "rotation": 8.4, "color": 39.0, "opacity": 12.6}),
}
"""DepthSplat on 200 scenes of RE10K: Q_g to KB and the share of each class in percent."""


@dataclass(frozen=True)
class Published:
    """One line of a paper.

    Attributes:
        method: what was measured.
        data: on what.
        size: as printed.
        psnr: dB to photos, as printed.
        seconds: as printed, with the machine.
        source: where it stands.
    """

    method: str
    data: str
    size: str
    psnr: str
    seconds: str
    source: str


_TINYSPLAT = "arXiv 2506.09479"
_CODECSPLAT = "arXiv 2605.25563"
_GPU_PC = "i7-13700K, RTX 4090"

PUBLISHED: tuple[Published, ...] = (
    Published("MVSplat, raw", "RealEstate10K, 2×256×256", "≈ 43 MB", "26.36", "", _TINYSPLAT),
    Published(
        "MVSplat + FCGS", "RealEstate10K, 2×256×256", "2.650 MB", "25.90", f"4.074 / 4.095 ({_GPU_PC})", _TINYSPLAT
    ),
    Published(
        "MVSplat + TinySplat", "RealEstate10K, 2×256×256", "0.216 MB", "26.32", f"1.016 / 0.042 ({_GPU_PC})", _TINYSPLAT
    ),
    Published("DepthSplat, raw", "RealEstate10K, 2×256×256", "≈ 19 MB", "27.50", "", _TINYSPLAT),
    Published("DepthSplat + FCGS", "RealEstate10K, 2×256×256", "2.674 MB", "27.35", "", _TINYSPLAT),
    Published("DepthSplat + TinySplat", "RealEstate10K, 2×256×256", "0.166 MB", "27.43", "", _TINYSPLAT),
    Published(
        "CodecSplat", "RealEstate10K", "3.37–12.51 KiB", "24.76–27.05", "its decoder runs a network", _CODECSPLAT
    ),
    Published("CodecSplat", "DL3DV", "20–108 KiB", "23.56–26.36", "its decoder runs a network", _CODECSPLAT),
)
"""Rows of the report's table of quoted figures. Seconds are encode / decode."""
