"""How much a way of storing Gaussians costs in the pictures that are rendered from them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import DEFINITION, Renderer
from tinysplat_runtime.scene.cameras import Camera

from ..measure.metrics import psnr
from .inputs import Case
from .timing import Figures


class Judge:
    """Renders a case's Gaussians once, and holds other versions of them against the pictures and the photos."""

    def __init__(self, case: Case, threads: int) -> None:
        """Render the raw Gaussians at the case's cameras."""
        self._cameras, self._photos, self._threads = case.cameras, case.photos, threads
        self._raw = self.pictures(case.gaussians)
        self._raw_to_photo = _to_photos(self._raw, self._photos)

    def pictures(self, gaussians: Gaussians) -> list[NDArray]:
        """(H, W, 3) per camera."""
        renderer = Renderer(gaussians, self._threads, **DEFINITION)
        return [renderer.render(camera) for camera in self._cameras]

    def figures(self, decoded: Gaussians) -> Figures:
        """dB means over the case's cameras.

        Returns:
            `psnr_decoded_raw` against the raw Gaussians' pictures; where there are photos, `psnr` and `psnr_raw`
            against them and `db_lost` = `psnr_raw` − `psnr`.
        """
        pictures = self.pictures(decoded)
        figures = {"psnr_decoded_raw": _mean(psnr(a, b) for a, b in zip(pictures, self._raw, strict=True))}
        if self._raw_to_photo is not None:
            to_photo = _to_photos(pictures, self._photos)
            assert to_photo is not None
            figures |= {"psnr": to_photo, "psnr_raw": self._raw_to_photo, "db_lost": self._raw_to_photo - to_photo}
        return figures


def photo_figures(gaussians: Gaussians, cameras: Sequence[Camera], photos: Sequence[NDArray], threads: int) -> Figures:
    """`psnr` against photos; empty where there are none."""
    renderer = Renderer(gaussians, threads, **DEFINITION)
    value = _to_photos([renderer.render(camera) for camera in cameras], photos) if cameras else None
    return {} if value is None else {"psnr": value}


def pixel_errors(image: NDArray, truth: NDArray) -> Figures:
    """Errors of pixel values in [0, 1] against float64: the median, the 99.9 % quantile, the largest, and the share
    that rounding of a threshold or of a depth order has moved by more than 1e-4."""
    error = np.abs(image.astype(np.float64) - truth).max(axis=-1)
    return {
        "median_error": float(np.median(error)),
        "error_999": float(np.quantile(error, 0.999)),
        "max_error": float(error.max()),
        "share_above_1e-4": float((error > 1e-4).mean()),
    }


def _to_photos(pictures: Sequence[NDArray], photos: Sequence[NDArray | None]) -> float | None:
    pairs = [(picture, photo) for picture, photo in zip(pictures, photos, strict=True) if photo is not None]
    return _mean(psnr(picture, photo) for picture, photo in pairs) if pairs else None


def _mean(values: object) -> float:
    listed = list(values)  # type: ignore[call-overload]
    return math.fsum(listed) / len(listed)
