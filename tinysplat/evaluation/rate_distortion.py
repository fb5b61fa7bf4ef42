"""Rate–distortion curves of ways to store Gaussians, and what lies between them: BD-rate.

A point is a file's bytes and the PSNR of pictures of the decoded Gaussians, at cameras that the Gaussians were not made
from where there are some: against pictures of the raw ones, and against photos where these are at hand. Everything is
rendered once per set of Gaussians.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import DEFINITION, Renderer
from tinysplat_runtime.scene.cameras import Camera

from .measure import capped_psnr

LEAST_OVERLAP_DB = 0.5
"""A BD-rate over less says more about the curves' ends than about the codecs."""


@dataclass(frozen=True)
class Point:
    """One file.

    Attributes:
        setting: what it was coded with, Q_g for instance.
        bytes: of the file.
        psnr: decoded against raw pictures, dB, mean over pictures.
        to_photo: decoded pictures against photos, dB, mean over pictures; None where there are no photos.
        bytes_by_class: of its planes, where it has any.
    """

    setting: float
    bytes: int
    psnr: float
    to_photo: float | None = None
    bytes_by_class: Mapping[str, int] = field(default_factory=dict)


class Pictures:
    """Pictures of the raw Gaussians, and PSNR against them and against photos.

    Attributes:
        raw_to_photo: the raw Gaussians' own pictures against the photos, dB; None where there are no photos.
    """

    def __init__(
        self, gaussians: Gaussians, cameras: Sequence[Camera], photos: Sequence[NDArray] | None, threads: int
    ) -> None:
        """Render the raw Gaussians.

        Args:
            gaussians: raw.
            cameras: where pictures are taken.
            photos: (H, W, 3) in [0, 1] per camera, or None.
            threads: of the rasteriser.
        """
        self._cameras, self._photos, self._threads = tuple(cameras), photos, threads
        self._raw = self._render(gaussians)
        self.raw_to_photo = None if photos is None else _mean_psnr(self._raw, photos)

    def psnr(self, decoded: Gaussians) -> tuple[float, float | None]:
        """Mean PSNR in dB of the decoded Gaussians' pictures to raw pictures, and to photos where there are some."""
        seen = self._render(decoded)
        return _mean_psnr(seen, self._raw), None if self._photos is None else _mean_psnr(seen, self._photos)

    def _render(self, gaussians: Gaussians) -> list[NDArray]:
        renderer = Renderer(gaussians, self._threads, **DEFINITION)
        return [renderer.render(camera) for camera in self._cameras]


def measure_point(
    pictures: Pictures,
    setting: float,
    encode: Callable[[], bytes],
    decode: Callable[[bytes], Gaussians],
    classes: Callable[[bytes], Mapping[str, int]],
) -> Point:
    """Code, decode, look."""
    data = encode()
    return Point(setting, len(data), *pictures.psnr(decode(data)), classes(data))


def towards_photos(points: Iterable[Point]) -> list[Point]:
    """The curve against photos: points whose `psnr` is that to photos; those without one are left out."""
    return [replace(point, psnr=point.to_photo) for point in points if point.to_photo is not None]


def bytes_at(points: Iterable[Point], db: float) -> float | None:
    """Bytes that a curve needs for a PSNR, between its points; None outside them."""
    curve = _curve(points)
    if len(curve) < 2 or not curve[0, 0] <= db <= curve[-1, 0]:
        return None
    return float(np.exp(_interpolated(curve)(db)))


def bd_rate(
    reference: Iterable[Point],
    points: Iterable[Point],
    limits: tuple[float, float] | None = None,
    least_overlap: float = LEAST_OVERLAP_DB,
) -> float:
    """Mean difference of bytes at equal PSNR, as a share of the reference's: −0.5 is half the bytes.

    Bjøntegaard's measure (VCEG-M33) with log bytes over dB interpolated by monotone cubics in place of one polynomial,
    integrated over the range of dB that both curves have.

    Args:
        reference, points: at least two files each.
        limits: dB to integrate between, where the whole overlap is not wanted.
        least_overlap: dB that the curves must have in common.

    Raises:
        InputError: the curves have less in common, or one has a single point.
    """
    curves = [_curve(reference), _curve(points)]
    if min(map(len, curves)) < 2:
        raise InputError("a curve of one point, BD-rate needs two", where="curves")
    low, high = limits or (-np.inf, np.inf)
    for curve in curves:
        low, high = max(low, curve[0, 0]), min(high, curve[-1, 0])
    if high - low < least_overlap:
        raise InputError(f"curves share {max(high - low, 0):.2f} dB, BD-rate needs {least_overlap:g}", where="curves")
    areas = [float(_interpolated(curve).integrate(low, high)) for curve in curves]
    return float(np.expm1((areas[1] - areas[0]) / (high - low)))


def _curve(points: Iterable[Point]) -> NDArray:
    """(n, 2) dB and log bytes, rising in both: of points that others beat in both, none is kept."""
    kept: list[tuple[float, float]] = []
    for point in sorted(points, key=lambda p: (p.bytes, -p.psnr)):
        if not kept or point.psnr > kept[-1][0]:
            kept.append((point.psnr, float(np.log(point.bytes))))
    return np.array(kept).reshape(-1, 2)


def _interpolated(curve: NDArray) -> PchipInterpolator:
    return PchipInterpolator(curve[:, 0], curve[:, 1])


def _mean_psnr(images: Iterable[NDArray], references: Iterable[NDArray]) -> float:
    return float(np.mean([capped_psnr(a, b) for a, b in zip(images, references, strict=True)]))
