"""WebP and TIFF photos, through the package Pillow (extra `io`).

Trust boundary: Pillow's own readers of these two kinds alone, after the size was read from the header.
"""

import io
import logging
import warnings
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .colours import Colours, of_icc

SUFFIXES = (".webp", ".tif", ".tiff")

INSTALL = 'pip install "tinysplat[io]"'

_ORIENTATION, _DNG_VERSION = 0x0112, 0xC612
_FAULTS = (OSError, ValueError, SyntaxError, EOFError, KeyError, IndexError, TypeError, RuntimeError)
"""What Pillow raises of damaged files."""


def is_read(data: bytes) -> bool:
    """Whether a file begins as these do."""
    return data.startswith((b"II*\0", b"MM\0*")) or (data[:4] == b"RIFF" and data[8:12] == b"WEBP")


def is_installed() -> bool:
    """Whether they can be read here."""
    return find_spec("PIL") is not None


def opened(data: bytes) -> tuple[Any, int]:
    """A picture, not yet decoded, whose `size` is (width, height), and its Exif orientation; Pillow turns TIFFs itself.

    Raises:
        InputError: the package is missing, or the file is damaged or of a kind that it does not read.
    """
    try:
        from PIL import Image
    except ImportError:
        raise InputError(f"a WebP or TIFF photo; {INSTALL} reads it") from None
    logging.getLogger("PIL").setLevel(logging.CRITICAL)  # what it says of damage comes as an error of ours
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of damage, which decoding finds
            picture = Image.open(io.BytesIO(data), formats=("WEBP", "TIFF"))
            turned = picture.getexif().get(_ORIENTATION, 1) if picture.format == "WEBP" else 1
    except (*_FAULTS, Image.DecompressionBombError) as error:
        raise _damaged(error) from None
    if _DNG_VERSION in getattr(picture, "tag_v2", ()):  # of which this would be a thumbnail
        raise InputError("raw data of a camera (DNG), expected a photo: develop it to JPEG first")
    return picture, turned if turned in range(1, 9) else 1


def decoded(picture: Any) -> tuple[NDArray, Colours | None]:
    """A picture of `opened`: (H, W, 3 or 4) uint8 or uint16 as stored, and its colours unless they are sRGB.

    Raises:
        InputError: the file is damaged, or its samples are of a kind that is not read.
    """
    profile = picture.info.get("icc_profile")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            pixels = _samples(picture)
    except _FAULTS as error:
        raise _damaged(error) from None
    return pixels, of_icc(profile) if profile else None


def _samples(picture: Any) -> NDArray:
    """(H, W, 3 or 4) uint8 or uint16."""
    if picture.mode.startswith("I;16"):
        return np.repeat(np.asarray(picture).astype(np.uint16)[..., None], 3, axis=2)
    if picture.mode in ("1", "L", "LA", "P", "PA", "RGB", "RGBA"):
        is_opaque = picture.mode in ("1", "L", "RGB") and "transparency" not in picture.info
        return np.asarray(picture.convert("RGB" if is_opaque else "RGBA"))
    raise InputError(f"samples of the kind {picture.mode}, expected grey or RGB; convert it to PNG first")


def _damaged(error: Exception) -> InputError:
    return InputError(f"damaged WebP or TIFF ({' '.join(str(error).split())[:80]})")
