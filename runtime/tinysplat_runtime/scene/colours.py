"""What a picture's numbers mean: HDR video and wide gamuts of photos, brought to sRGB.

Videos state it by code points (ITU-T H.273), photos by an ICC profile (ICC.1:2022, of matrix and curves). Light is
linear in between, and 1 is white. HDR becomes what a player shows beside SDR: white is 203 cd/m² of BT.2100's PQ and
75 % of its HLG (BT.2408), whose system gamma is 1 on a display as bright as SDR's. Brighter light rolls off within the
last levels below white. Colours outside BT.709's primaries are clipped.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

PQ, HLG, LINEAR = 16, 18, 8
"""Transfer characteristics that are not taken for sRGB's: SMPTE ST 2084, ARIB STD-B67, and none."""

REFERENCE_WHITE = 203.0
"""cd/m² of a white sheet in HDR (BT.2408)."""

KNEE = 0.95
"""Of white: light up to here is as it was, brighter light rolls off."""

_VALUES = 1 << 16
_BAND = 1 << 20  # pixels that are converted at a time
_SAME = 2  # levels of sRGB: a profile that changes no colour by more is sRGB's own
_MOST_TAGS = 100
_PARAMETERS = (1, 3, 4, 5, 7)  # of parametric curves of kinds 0 to 4
_D65 = (0.3127, 0.3290)
_SRGB_PRIMARIES = ((0.64, 0.33), (0.30, 0.60), (0.15, 0.06))
_UNSPECIFIED, _BT2020, _P3_D65 = 2, 9, 12
_PRIMARIES = {
    _BT2020: ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046)),
    _P3_D65: ((0.68, 0.32), (0.265, 0.69), (0.15, 0.06)),
}
_ADOBE_RGB = ((0.64, 0.33), (0.21, 0.71), (0.15, 0.06)), 563 / 256
_SRGB_D50 = ((0.4360, 0.3851, 0.1431), (0.2225, 0.7169, 0.0606), (0.0139, 0.0971, 0.7141))  # of sRGB's ICC profile


@dataclass(frozen=True, eq=False)
class Colours:
    """How RGB values become linear sRGB.

    Attributes:
        curves: (3, 65536) float32 linear light of each channel's values, evenly spaced from 0 to the largest.
        matrix: (3, 3) float32 from the picture's primaries to sRGB's.
        is_hdr: whether light is brighter than white, and rolls off.
    """

    curves: NDArray
    matrix: NDArray
    is_hdr: bool = False


@lru_cache(maxsize=8)
def of_code_points(primaries: int, transfer: int) -> Colours | None:
    """Colours by their code points (ITU-T H.273, tables 2 and 3); None for those that are shown as sRGB."""
    is_hdr = transfer in (PQ, HLG)
    if not is_hdr and transfer != LINEAR and primaries not in _PRIMARIES:
        return None
    values = np.linspace(0, 1, _VALUES)
    curve = _CURVES.get(transfer, decoded_srgb)(values)
    meant = _BT2020 if is_hdr and primaries == _UNSPECIFIED else primaries
    matrix = _between(_PRIMARIES.get(meant, _SRGB_PRIMARIES))
    return Colours(np.tile(curve.astype(np.float32), (3, 1)), matrix, is_hdr)


@lru_cache(maxsize=1)
def adobe_rgb() -> Colours:
    """Adobe RGB (1998), which cameras name in Exif without a profile."""
    primaries, gamma = _ADOBE_RGB
    curve = np.linspace(0, 1, _VALUES) ** gamma
    return Colours(np.tile(curve.astype(np.float32), (3, 1)), _between(primaries))


@lru_cache(maxsize=8)
def of_icc(profile: bytes) -> Colours | None:
    """Colours of an ICC profile; None for sRGB, for one that has no matrix of RGB, and for a damaged one."""
    try:
        if profile[16:24] != b"RGB XYZ " or profile[36:40] != b"acsp":
            return None
        (count,) = struct.unpack_from(">I", profile, 128)
        tags = {}
        for n in range(min(count, _MOST_TAGS)):
            name, offset, size = struct.unpack_from(">4sII", profile, 132 + 12 * n)
            tags[name] = profile[offset : offset + size]
        colorants = (
            np.array([struct.unpack_from(">3i", tags[name], 8) for name in (b"rXYZ", b"gXYZ", b"bXYZ")]).T / 65536
        )
        curves = np.stack([_icc_curve(tags[name]) for name in (b"rTRC", b"gTRC", b"bTRC")])
        colours = Colours(curves.astype(np.float32), np.linalg.solve(_SRGB_D50, colorants).astype(np.float32))
    except (struct.error, KeyError, ValueError):
        return None
    grid = np.stack(np.meshgrid(*[np.arange(0, 256, 51, dtype=np.uint8)] * 3), axis=-1)  # (6, 6, 6, 3)
    changed = np.abs(to_srgb(grid.reshape(1, -1, 3), colours).astype(int) - grid.reshape(1, -1, 3))
    return None if not np.isfinite(colours.curves).all() or changed.max() <= _SAME else colours


def to_srgb(pixels: NDArray, colours: Colours) -> NDArray:
    """Pixels (H, W, 3) uint8 or uint16, of the whole range of their type, as (H, W, 3) uint8 of sRGB."""
    curves = colours.curves if pixels.dtype == np.uint16 else colours.curves[:, :: _VALUES // 255]
    converted = np.empty(pixels.shape, np.uint8)
    rows = max(_BAND // pixels.shape[1], 1)
    for start in range(0, len(pixels), rows):
        band = pixels[start : start + rows]
        light = np.stack([curve[band[..., c]] for c, curve in enumerate(curves)], axis=-1) @ colours.matrix.T
        if colours.is_hdr:
            above = np.maximum(light - np.float32(KNEE), 0) / np.float32(1 - KNEE)
            light = np.minimum(light, np.float32(KNEE)) + np.float32(1 - KNEE) * above / (1 + above)
        np.clip(light, 0, 1, out=light)
        converted[start : start + rows] = _encoded()[np.rint(light * np.float32(_VALUES - 1)).astype(np.uint16)]
    return converted


@lru_cache(maxsize=1)
def _encoded() -> NDArray:
    """(65536,) uint8 sRGB of evenly spaced linear light."""
    return np.rint(255 * encoded_srgb(np.linspace(0, 1, _VALUES))).astype(np.uint8)


def encoded_srgb(light: NDArray) -> NDArray:
    """sRGB values of linear light, 0 or more (IEC 61966-2-1)."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def decoded_srgb(values: NDArray) -> NDArray:
    """Linear light of sRGB values."""
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def _pq(values: NDArray) -> NDArray:
    """Light of PQ values (BT.2100, table 4), white 1."""
    m1, m2, c1, c2, c3 = 2610 / 16384, 2523 / 32, 3424 / 4096, 2413 / 128, 2392 / 128
    root = values ** (1 / m2)
    return (np.maximum(root - c1, 0) / (c2 - c3 * root)) ** (1 / m1) * (10000 / REFERENCE_WHITE)


def _hlg(values: NDArray) -> NDArray:
    """Light of HLG values (BT.2100, table 5), white 1."""
    a, b, c = 0.17883277, 0.28466892, 0.55991073

    def light(value: ArrayLike) -> NDArray:
        signal = np.asarray(value, np.float64)
        return np.where(signal <= 0.5, signal**2 / 3, (np.exp((signal - c) / a) + b) / 12)

    return light(values) / light(0.75)


_CURVES: dict[int, Callable[[NDArray], NDArray]] = {PQ: _pq, HLG: _hlg, LINEAR: np.asarray}


def _between(primaries: ArrayLike) -> NDArray:
    """(3, 3) float32 from linear RGB of primaries (3, 2) xy and white D65 to linear sRGB."""
    return np.linalg.solve(_to_xyz(_SRGB_PRIMARIES), _to_xyz(primaries)).astype(np.float32)


def _to_xyz(primaries: ArrayLike) -> NDArray:
    """(3, 3) from linear RGB of primaries (3, 2) xy and white D65 to XYZ."""
    xyz = np.array([(x / y, 1, (1 - x - y) / y) for x, y in [*np.asarray(primaries), _D65]]).T  # (3, 4)
    return xyz[:, :3] * np.linalg.solve(xyz[:, :3], xyz[:, 3])


def _icc_curve(tag: bytes) -> NDArray:
    """(65536,) linear light of a curve tag (ICC.1:2022, 10.6 and 10.18).

    Raises:
        ValueError: it is of another kind, or no curve.
    """
    values = np.linspace(0, 1, _VALUES)
    if tag[:4] == b"curv":
        (count,) = struct.unpack_from(">I", tag, 8)
        if count > _VALUES or len(tag) < 12 + 2 * count:
            raise ValueError("a curve cut short")
        table = np.frombuffer(tag, ">u2", count, 12)
        if count == 1:
            return values ** (int(table[0]) / 256)
        return np.interp(values, np.linspace(0, 1, count), table / 65535) if count else values
    if tag[:4] != b"para":
        raise ValueError("no curve")
    (kind,) = struct.unpack_from(">H", tag, 8)
    if kind >= len(_PARAMETERS):
        raise ValueError("a curve of another kind")
    g, *more = (np.array(struct.unpack_from(f">{_PARAMETERS[kind]}i", tag, 12)) / 65536).tolist()
    a, b, c, d, e, f = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0  # (a X + b)^g + e from d on, c X + f below it
    match more:
        case [a, b]:
            d = -b / a if a else 0.0
        case [a, b, e]:
            d, f = -b / a if a else 0.0, e
        case [a, b, c, d]:
            pass
        case [a, b, c, d, e, f]:
            pass
    with np.errstate(all="ignore"):
        light = np.where(values >= d, np.maximum(a * values + b, 0) ** g + e, c * values + f)
    return light.clip(0, 1)
