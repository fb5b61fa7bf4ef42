"""Rate–distortion curves of ways to store Gaussians, and what lies between them: BD-rate.

A point is a file's bytes and the PSNR of pictures of the decoded Gaussians against pictures of the raw ones, at cameras
that the Gaussians were not made from where a file names some. Everything is rendered once per set of Gaussians.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from tinysplat.metrics import psnr
from tinysplat_runtime.cameras import Camera
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussians import Gaussians
from tinysplat_runtime.render import Renderer

_LEAST_OVERLAP_DB = 0.5


@dataclass(frozen=True)
class Point:
    """One file.

    Attributes:
        setting: what it was coded with, Q_g for instance.
        bytes: of the file.
        psnr: decoded against raw pictures, dB, mean over pictures.
        bytes_by_class: of its planes, where it has any.
        encode_cpu_s, decode_cpu_s: processor seconds of this process, all threads.
    """

    setting: float
    bytes: int
    psnr: float
    bytes_by_class: dict[str, int]
    encode_cpu_s: float
    decode_cpu_s: float


class Pictures:
    """Pictures of the raw Gaussians, and PSNR against them.

    Args:
        gaussians: raw.
        cameras: where pictures are taken.
        threads: of the rasteriser.
    """

    def __init__(self, gaussians: Gaussians, cameras: Sequence[Camera], threads: int) -> None:
        self._cameras, self._threads = tuple(cameras), threads
        self._raw = self._render(gaussians)

    def psnr(self, decoded: Gaussians) -> float:
        """Mean PSNR in dB of the decoded Gaussians' pictures."""
        return float(np.mean([psnr(a, b) for a, b in zip(self._render(decoded), self._raw, strict=True)]))

    def _render(self, gaussians: Gaussians) -> list[NDArray]:
        renderer = Renderer(gaussians, self._threads)
        return [renderer.render(camera) for camera in self._cameras]


def measure_point(
    pictures: Pictures,
    gaussians: Gaussians,
    setting: float,
    encode: Callable[[Gaussians], bytes],
    decode: Callable[[bytes], Gaussians],
    classes: Callable[[bytes], dict[str, int]] | None = None,
) -> Point:
    """Code, decode, look."""
    start = time.process_time()
    data = encode(gaussians)
    coded = time.process_time()
    decoded = decode(data)
    done = time.process_time()
    by_class = classes(data) if classes else {}
    return Point(setting, len(data), pictures.psnr(decoded), by_class, coded - start, done - coded)


def bytes_at(points: Iterable[Point], db: float) -> float | None:
    """Bytes that a curve needs for a PSNR, between its points; None outside them."""
    curve = _curve(points)
    if len(curve) < 2 or not curve[0, 0] <= db <= curve[-1, 0]:
        return None
    return float(np.exp(_interpolated(curve)(db)))


def bd_rate(reference: Iterable[Point], points: Iterable[Point], limits: tuple[float, float] | None = None) -> float:
    """Mean difference of bytes at equal PSNR, as a share of the reference's: −0.5 is half the bytes.

    Bjøntegaard's measure (VCEG-M33) with log bytes over dB interpolated by monotone cubics in place of one polynomial,
    integrated over the range of dB that both curves have.

    Args:
        reference, points: at least two files each.
        limits: dB to integrate between, where the whole overlap is not wanted.

    Raises:
        InputError: the curves have less than half a dB in common.
    """
    curves = [_curve(reference), _curve(points)]
    low, high = limits or (-np.inf, np.inf)
    for curve in curves:
        low, high = max(low, curve[0, 0]), min(high, curve[-1, 0])
    if high - low < _LEAST_OVERLAP_DB or min(map(len, curves)) < 2:
        raise InputError(f"curves share {max(high - low, 0):.2f} dB, BD-rate needs {_LEAST_OVERLAP_DB}", where="curves")
    areas = [float(_interpolated(curve).integrate(low, high)) for curve in curves]
    return float(np.expm1((areas[1] - areas[0]) / (high - low)))


def to_json(points: Iterable[Point]) -> list[dict[str, Any]]:
    """Points as JSON-ready objects."""
    return [vars(point) for point in points]


def _curve(points: Iterable[Point]) -> NDArray:
    """(n, 2) dB and log bytes, rising in both: of points that others beat in both, none is kept."""
    kept: list[tuple[float, float]] = []
    for point in sorted(points, key=lambda p: (p.bytes, -p.psnr)):
        if not kept or point.psnr > kept[-1][0]:
            kept.append((point.psnr, float(np.log(point.bytes))))
    return np.array(kept).reshape(-1, 2)


def _interpolated(curve: NDArray) -> PchipInterpolator:
    return PchipInterpolator(curve[:, 0], curve[:, 1])
