"""Figures that others published, quoted beside ours and never mixed with them."""

from __future__ import annotations

from dataclasses import dataclass


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
