"""Pinhole cameras: intrinsics in pixels, poses as camera-to-world, OpenCV axes (x right, y down, z forward)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..system.blas import product

ROTATION_TOLERANCE = 1e-3
"""Largest |R Rᵀ − 1| that passes as a rotation written with few digits; anything above is a shear or a scale."""

_POLAR_STEPS = 5

MAX_IMAGE_SIDE = 1 << 16

MIN_FOCAL_PX, MAX_INTRINSIC_PX = 1e-6, 1e9
"""Least focal length, and largest magnitude of any entry of K: products of two stay well inside float32."""

MAX_DEPTH = 1e30
"""Depths in float32, and what they are multiplied with, stay finite below it."""

MAX_POSITION = 1e15
"""Largest magnitude of a coordinate of a camera or an origin; float64 cannot tell tenths of a unit apart beyond it."""


def check_depth(value: float, where: str) -> None:
    """InputError where a depth is none that can be drawn."""
    if not 1 / MAX_DEPTH < value < MAX_DEPTH:
        raise InputError(f"{value:g}, expected a depth from {1 / MAX_DEPTH:g} to {MAX_DEPTH:g}", where=where)


def finite_array(name: str, value: ArrayLike, shape: tuple[int, ...]) -> NDArray:
    """A read-only float64 array of finite numbers, of any size where `shape` has -1; InputError says what is not."""
    try:
        array = np.array(value, np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"not a {shape} array of numbers", where=name) from None
    if array.ndim != len(shape) or any(
        wanted not in (-1, side) for side, wanted in zip(array.shape, shape, strict=True)
    ):
        raise InputError(f"shape {array.shape}, expected {shape}", where=name)
    if not np.isfinite(array).all():
        raise InputError("holds NaN or infinity, expected finite numbers", where=name)
    array.setflags(write=False)
    return array


def intrinsics(fx: float, fy: float, cx: float, cy: float) -> NDArray:
    """K (3, 3) float64 of focal lengths and principal point in pixels."""
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], np.float64)


def posed(rotation: NDArray, centre: NDArray) -> NDArray:
    """(4, 4) float64 of a rotation (3, 3) and a translation (3,): camera to world of the camera's axes and centre."""
    c2w = np.eye(4)
    c2w[:3, :3], c2w[:3, 3] = rotation, centre
    return c2w


UNIT_FOCAL_BELOW = 4.0
"""Pixels; real focal lengths below it see more than 126° of a picture 16 pixels wide."""


@dataclass(frozen=True, eq=False)
class Camera:
    """One calibrated view.

    Attributes:
        K: (3, 3) float64, pixels; the centre of the top-left pixel lies at (0.5, 0.5). Skew is allowed.
        c2w: (4, 4) float64, camera to world, scene units.
        width, height: of the image, pixels.

    Raises:
        InputError: K is singular or has a focal length below MIN_FOCAL_PX, c2w's rotation is none, the size is none,
            or a number is not finite or beyond MAX_INTRINSIC_PX and MAX_POSITION.
    """

    K: NDArray
    c2w: NDArray
    width: int
    height: int

    def __post_init__(self) -> None:
        K, c2w = finite_array("K", self.K, (3, 3)), finite_array("c2w", self.c2w, (4, 4))
        for name in ("width", "height"):
            value = getattr(self, name)
            is_whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
            if not is_whole or not 1 <= value <= MAX_IMAGE_SIDE:
                raise InputError(f"{value}, expected a whole number from 1 to {MAX_IMAGE_SIDE}", where=name)
            object.__setattr__(self, name, int(value))
        for axis, name in enumerate(("fx", "fy")):
            if not K[axis, axis] >= MIN_FOCAL_PX:
                fault = f"focal length {name} = {K[axis, axis]:g} px, expected {MIN_FOCAL_PX:g} or more"
                raise InputError(fault, where="K")
        for name, array, bound in (("K", K, MAX_INTRINSIC_PX), ("c2w", c2w[:3, 3], MAX_POSITION)):
            if np.abs(array).max() > bound:
                raise InputError(f"holds {np.abs(array).max():g}, expected at most {bound:g}", where=name)
        if K[1, 0] != 0 or (K[2] != (0, 0, 1)).any():
            raise InputError(f"{K.tolist()}, expected [[fx, skew, cx], [0, fy, cy], [0, 0, 1]]", where="K")
        R = c2w[:3, :3].clip(-2, 2)  # no rotation has larger entries, and squares of them might overflow
        deviation = float(np.abs(R @ R.T - np.eye(3)).max())
        if deviation > ROTATION_TOLERANCE or np.linalg.det(R) < 0:
            fault = "a mirrored rotation" if deviation <= ROTATION_TOLERANCE else f"|R Rᵀ − 1| = {deviation:.3g}"
            raise InputError(f"no rotation in the upper left ({fault}), expected orthonormal with det +1", where="c2w")
        if (c2w[3] != (0, 0, 0, 1)).any():
            raise InputError(f"last row {c2w[3].tolist()}, expected [0, 0, 0, 1]", where="c2w")
        object.__setattr__(self, "K", K)
        object.__setattr__(self, "c2w", c2w)

    @cached_property
    def rotation(self) -> NDArray:
        """(3, 3) float64 world-to-camera rotation: the exact rotation nearest to the transpose of c2w's."""
        R = self.c2w[:3, :3].T
        # Newton's iteration for the polar factor; each step squares the error, which `ROTATION_TOLERANCE` bounds.
        for _ in range(_POLAR_STEPS):
            R = 1.5 * R - 0.5 * product(R, product(R.T, R))
        return R

    @property
    def centre(self) -> NDArray:
        """(3,) float64 camera centre in the world."""
        return self.c2w[:3, 3]

    @property
    def w2c(self) -> NDArray:
        """(4, 4) float64 world to camera."""
        return posed(self.rotation, -product(self.rotation, self.centre[:, None])[:, 0])

    @property
    def K_unit(self) -> NDArray:
        """(3, 3) float64: K divided by width and height, as networks take it."""
        return self.K / np.array([[self.width], [self.height], [1.0]])

    @property
    def focal(self) -> float:
        """f = √(fx·fy) in pixels."""
        return float(np.sqrt(self.K[0, 0] * self.K[1, 1]))

    def resized(self, height: int, width: int) -> Camera:
        """The camera of the image scaled to cover height × width and cropped to it around its centre.

        The crop begins at a whole pixel, so that a photo that needs no scaling is copied, not resampled.
        """
        scale = max(height / self.height, width / self.width)
        K = self.K.copy()
        K[:2] *= scale
        # The margin is for a scaled side that misses a whole number by rounding.
        K[0, 2] -= np.floor((self.width * scale - width) / 2 + 1e-9)
        K[1, 2] -= np.floor((self.height * scale - height) / 2 + 1e-9)
        return Camera(K, self.c2w, width, height)


def check_is_in_pixels(camera: Camera, where: str) -> None:
    """InputError where a camera's K was in all likelihood divided by the size of its image."""
    if camera.focal < UNIT_FOCAL_BELOW <= min(camera.height, camera.width) / 4:
        fault = f"focal length {camera.focal:.3g} px for an image of {camera.width}x{camera.height}"
        raise InputError(f"{fault}, expected pixels (is K divided by the image's size?)", where=where)
