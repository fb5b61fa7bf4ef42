"""Lens distortion: photos and cameras turned into those of a pinhole, through the package pycolmap.

Models are COLMAP's, by name and order of parameters. A pinhole needs no package; any other model is undistorted with
pycolmap (extra `poses`) as `colmap image_undistorter` does: the largest picture without blank pixels.
"""

from __future__ import annotations

import math
import signal
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from .cameras import MAX_IMAGE_SIDE, Camera, intrinsics

PINHOLES = {"PINHOLE": 4, "SIMPLE_PINHOLE": 3}
"""Models without distortion, and how many parameters they have."""

_SAME_PIXELS = 0.1

INSTALL = 'pip install "tinysplat[poses]"'

_SIGNALS_TAKEN = ("SIGTERM", "SIGABRT", "SIGSEGV", "SIGILL", "SIGFPE", "SIGBUS")


@dataclass(frozen=True)
class Lens:
    """A photo's intrinsics as the camera took it.

    Attributes:
        model: COLMAP's name, such as OPENCV.
        params: the model's parameters in COLMAP's order, pixels where they are lengths.
        width, height: of the photo, pixels.
        shear: pixels by which each row lies farther to the right than the one above it.
    """

    model: str
    params: tuple[float, ...]
    width: int
    height: int
    shear: float = 0.0

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            value = getattr(self, name)
            if not isinstance(value, int) or not 1 <= value <= MAX_IMAGE_SIDE:
                raise InputError(f"{value}, expected a whole number from 1 to {MAX_IMAGE_SIDE}", where=name)
        if not np.isfinite(self.params).all():
            raise InputError("holds NaN or infinity, expected finite numbers", where="intrinsics")

    @property
    def is_pinhole(self) -> bool:
        """Whether photos can be used as they are."""
        return self.model in PINHOLES and not self.shear

    def camera(self, c2w: ArrayLike) -> Camera:
        """The pinhole camera at pose `c2w` of photos that went through `undistort`.

        Raises:
            InputError: no camera, an unknown model, or distortion and no pycolmap.
        """
        K, width, height = self._pinhole
        return Camera(K, np.asarray(c2w, np.float64), width, height)

    def undistort(self, photo: NDArray) -> NDArray:
        """The photo (H, W, 3) uint8 as a pinhole camera would have taken it; of another size unless `is_pinhole`."""
        if self.shear:
            photo = _unsheared(photo, self.shear, self.params[-2 if self.model == "SIMPLE_PINHOLE" else 3])
        if self.model in PINHOLES:
            return photo
        pycolmap = _pycolmap(self.model)
        bitmap, _ = pycolmap.undistort_image(
            pycolmap.UndistortCameraOptions(), pycolmap.Bitmap.from_array(photo), self._distorted
        )
        return np.ascontiguousarray(bitmap.to_array())

    def scaled(self, width: int, height: int) -> Lens:
        """The lens of the same photo at another size."""
        x, y = width / self.width, height / self.height
        is_one = self.model.startswith("SIMPLE_") or self.model in ("RADIAL", "RADIAL_FISHEYE")
        factors = ((x + y) / 2, x, y) if is_one else (x, y, x, y)
        rest = (1.0,) * (len(self.params) - len(factors))
        params = tuple(value * factor for value, factor in zip(self.params, (*factors, *rest), strict=False))
        return Lens(self.model, params, width, height, self.shear * x / y)

    @cached_property
    def _distorted(self) -> Any:
        """The camera as pycolmap's, checked."""
        pycolmap = _pycolmap(self.model)
        if self.model not in pycolmap.CameraModelId.__members__:
            raise InputError(f"unknown model '{self.model[:40]}', expected one of COLMAP's", where="camera")
        camera = pycolmap.Camera(model=self.model, width=self.width, height=self.height, params=list(self.params))
        if not camera.verify_params() or camera.is_spherical() or camera.mean_focal_length() <= 0:
            raise InputError(f"no usable camera of the model {self.model} with {list(self.params)}", where="camera")
        return camera

    @cached_property
    def _pinhole(self) -> tuple[NDArray, int, int]:
        """K, width and height of undistorted photos."""
        if self.model in PINHOLES:
            if len(self.params) != PINHOLES[self.model]:
                raise InputError(f"{len(self.params)} parameters for the model {self.model}", where="camera")
            fx, fy, cx, cy = self.params if self.model == "PINHOLE" else (self.params[0], *self.params)
            return intrinsics(fx, fy, cx, cy), self.width, self.height
        pycolmap = _pycolmap(self.model)
        try:
            camera = pycolmap.undistort_camera(pycolmap.UndistortCameraOptions(), self._distorted)
        except ValueError as error:
            said = " ".join(str(error).split())[:120]
            raise InputError(f"cannot be undistorted ({said})", where="camera") from None
        return np.array(camera.calibration_matrix()), int(camera.width), int(camera.height)


def _unsheared(photo: NDArray, shear: float, middle: float) -> NDArray:
    """The photo (H, W, 3) uint8 with each row moved to where it lies without shear, in linear interpolation; pixels at
    the border are repeated. `middle` is the row that stays.
    """
    width = photo.shape[1]
    moved = np.empty_like(photo)
    for row, pixels in enumerate(photo):
        at = np.clip(np.arange(width) + shear * (row + 0.5 - middle), 0, width - 1)
        left = np.minimum(at.astype(int), max(width - 2, 0))
        share = (at - left)[:, None]
        beside = pixels[np.minimum(left + 1, width - 1)]
        moved[row] = np.rint(pixels[left] * (1 - share) + beside * share)
    return moved


def opencv_lens(
    focal: Sequence[float],
    centre: Sequence[float],
    distortion: Sequence[float],
    size: tuple[int, int],
    *,
    fisheye: bool,
) -> Lens:
    """A lens of OpenCV's polynomial.

    Args:
        focal: fx, fy in pixels.
        centre: cx, cy in pixels.
        distortion: k1 to k6 and p1, p2, as OpenCV numbers them; a fisheye has k1 to k4 alone.
        size: (height, width) of the photo.
        fisheye: whether angles, not tangents, are what is distorted.
    """
    k1, k2, k3, k4, k5, k6, p1, p2 = distortion
    height, width = size
    base = (*focal, *centre)
    if fisheye:
        for name, value in {"p1": p1, "p2": p2, "k5": k5, "k6": k6}.items():
            if value:
                raise InputError(f"{name} {value:g}, expected 0 in a fisheye camera", where=name)
        return Lens("OPENCV_FISHEYE", (*base, k1, k2, k3, k4), width, height)
    if k3 or k4 or k5 or k6:
        return Lens("FULL_OPENCV", (*base, k1, k2, p1, p2, k3, k4, k5, k6), width, height)
    if k1 or k2 or p1 or p2:
        return Lens("OPENCV", (*base, k1, k2, p1, p2), width, height)
    return Lens("PINHOLE", base, width, height)


def brown_lens(
    focal: Sequence[float],
    centre: Sequence[float],
    radial: Sequence[float],
    tangential: Sequence[float],
    size: tuple[int, int],
) -> Lens:
    """A lens of Brown's polynomial 1 + k1 r² + … + k4 r⁸, of which OpenCV's has no k4: then a fraction of OpenCV's that
    is the same within a tenth of a pixel.

    Args:
        focal, centre, size: see `opencv_lens`.
        radial: k1 to k4.
        tangential: p1 and p2 in OpenCV's order.

    Raises:
        InputError: no such fraction is.
    """
    *terms, k4 = radial
    if k4:
        reach = 1.2 * math.hypot(*(max(c, side - c) / f for c, side, f in zip(centre, size[::-1], focal, strict=True)))
        square = np.linspace(0, reach, 200) ** 2
        wanted = np.polynomial.Polynomial([1, *radial])(square)
        powers = square[:, None] ** np.arange(1, 4)
        sides, *_ = np.linalg.lstsq(np.hstack([powers, -wanted[:, None] * powers]), wanted - 1, rcond=None)
        found = (1 + powers @ sides[:3]) / (1 + powers @ sides[3:])
        if not np.abs((found - wanted) * np.sqrt(square)).max() * max(focal) < _SAME_PIXELS:
            raise InputError(f"{k4:g}, a term of r⁸, which no camera here has: calibrate without it", where="k4")
        terms = [float(value) for value in sides]
    return opencv_lens(focal, centre, [*terms, *[0.0] * (6 - len(terms)), *tangential], size, fisheye=False)


def load_pycolmap() -> ModuleType:
    """The package pycolmap, silent, and the process's signals as they were: it has them end in a dump of its stacks.

    Raises:
        ImportError: it is not installed.
    """
    import pycolmap

    pycolmap.logging.minloglevel = pycolmap.logging.FATAL.value  # what goes wrong comes as an exception
    if threading.current_thread() is threading.main_thread():
        for name in _SIGNALS_TAKEN:
            if number := getattr(signal, name, None):
                signal.signal(number, signal.getsignal(number))  # what Python knows, which saw none of it
    return pycolmap


def _pycolmap(model: str) -> Any:
    try:
        return load_pycolmap()
    except ImportError:
        fault = f"a {model} camera has lens distortion"
        raise InputError(f"{fault}; {INSTALL} to undistort, or undistort the photos first") from None
