"""HEIC photos, an iPhone's default, through the package pillow-heif (extra `heic`).

The primary picture alone is decoded, turned as its container says: depth, gain maps and thumbnails beside it are
others' concern, and Exif's orientation repeats the container's.

Trust boundary: libheif, behind its own limits, after the size was read from the header.
"""

from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .colours import HLG, PQ, Colours, of_code_points, of_icc

SUFFIXES = (".heic", ".heif", ".hif")

INSTALL = 'pip install "tinysplat[heic]"'

_FAULTS = (ValueError, EOFError, SyntaxError, RuntimeError, OSError, IndexError)  # of the package, on damaged files

_BRANDS = (b"heic", b"heix", b"hevc", b"heim", b"heis", b"hevm", b"hevs", b"mif1", b"msf1")


def is_heic(data: bytes) -> bool:
    """Whether a file begins as HEIC's do."""
    return data[4:8] == b"ftyp" and data[8:12] in _BRANDS


def is_installed() -> bool:
    """Whether HEIC photos can be read here."""
    return find_spec("pillow_heif") is not None


def opened(data: bytes) -> Any:
    """A file's primary picture, not yet decoded, whose `size` is (width, height) as it is seen.

    Raises:
        InputError: the package is missing, or the file is damaged.
    """
    try:
        import pillow_heif
    except ImportError:
        raise InputError(f"a HEIC photo; {INSTALL} reads it") from None
    try:
        file = pillow_heif.open_heif(data, convert_hdr_to_8bit=False)
        return file[file.primary_index]
    except _FAULTS as error:
        raise InputError(f"damaged HEIC ({' '.join(str(error).split())[:80]})") from None


def decoded(picture: Any) -> tuple[NDArray, Colours | None]:
    """A picture of `opened`: (H, W, 3 or 4) uint8 or uint16 of their type's whole range, and colours unless sRGB's.

    Raises:
        InputError: the file is damaged.
    """
    try:
        pixels = np.asarray(picture)
    except _FAULTS as error:
        raise InputError(f"damaged HEIC ({' '.join(str(error).split())[:80]})") from None
    stated = picture.info.get("nclx_profile") or {}
    primaries, transfer = (int(stated.get(name, 2)) for name in ("color_primaries", "transfer_characteristics"))
    profile = picture.info.get("icc_profile")
    colours = of_icc(profile) if profile and transfer not in (PQ, HLG) else of_code_points(primaries, transfer)
    return (np.repeat(pixels[..., None], 3, axis=2) if pixels.ndim == 2 else pixels), colours
