"""Points in the SPZ format, versions 1 to 4 in, 3 and 4 out.

Attribute by attribute: positions as 24-bit fixed point (version 1: float16), opacities and colours as bytes, logarithms
of scales as bytes, rotations as the three smallest components (versions 1 and 2: x, y, z as bytes), and higher SH
coefficients as bytes. How the bytes lie in a file is in `spz_streams`. Source: `load-spz.cc` of
github.com/nianticlabs/spz.

SPZ's axes are x right, y up, z backward (`axes`).

Written here in numpy and not by a package because those at hand end their process on damaged files, print on standard
output, and fix positions to 1/4096 of a unit; here the fixed point follows the scene's size.
"""

from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian.gaussians import Gaussians
from ..gaussian.notes import YES
from ..gaussian.quaternions import from_smallest_three, normalize_quats, smallest_three
from . import SPZ_VERSIONS
from .assembly import Contents, PointCloud, WriteOptions, cut_degree_note
from .axes import HALF_TURN, QUAT_SIGNS, SPZ_AXES, from_spz_system, half_turned, sh_signs
from .spz_streams import MAX_DEGREE, MAX_FRACTIONAL_BITS, SpzHeader, pack_blocks, read_blocks

_MAX_DEGREE = {3: 3, 4: MAX_DEGREE}
"""The highest SH degree that readers of a version know."""

_COLOUR_SCALE = 0.15
_LOG_SCALE_OFFSET, _LOG_SCALE_STEPS = 10.0, 16.0
_FIXED_LIMIT = (1 << 23) - 1
_COMPONENT_BITS, _COMPONENT_MASK = 10, (1 << 9) - 1


def write_spz(path: Path, gaussians: Gaussians, options: WriteOptions) -> list[str]:
    """Write Gaussians of any shape as points; what the format could not keep, one line each.

    Raises:
        InputError: another version than those of SPZ_VERSIONS, or positions too far away for the format.
        ImportError: version 4, and zstandard is not installed.
    """
    version, cloud = options.spz_version, PointCloud.of(gaussians)
    if version not in SPZ_VERSIONS:
        raise InputError(f"{version}, expected {', '.join(map(str, SPZ_VERSIONS))}", where="SPZ version")
    gaussians = cloud.gaussians
    degree = min(gaussians.degree, _MAX_DEGREE[version])
    notes = cut_degree_note(gaussians, _MAX_DEGREE[version], f".spz version {version}")
    points = cloud.means * HALF_TURN
    fixed, bits = fixed_points(points)
    notes += _position_notes(points, bits, gaussians.scales)
    log_scales = np.log(np.maximum(gaussians.scales, 1e-30))
    scale_codes = (log_scales + _LOG_SCALE_OFFSET) * _LOG_SCALE_STEPS
    outside = int(((scale_codes < -0.5) | (scale_codes > 255.5)).any(axis=1).sum())
    if outside:
        notes.append(f"scales of {outside} Gaussians outside e^-10 to e^5.9 clamped")
    quats = normalize_quats(gaussians.quats.astype(np.float64)) * QUAT_SIGNS
    sh = gaussians.sh[:, : (degree + 1) ** 2].astype(np.float64)
    colour = sh[:, 0] * (_COLOUR_SCALE * 255) + 127.5
    clamped = int(((colour < -0.5) | (colour > 255.5)).any(axis=1).sum())
    if clamped:
        notes.append(f"colours of {clamped} Gaussians clamped to what .spz can hold")
    blocks = [
        fixed.astype("<i4")[..., None].view(np.uint8)[..., :3].reshape(len(points), 9),
        _bytes(gaussians.opacities.astype(np.float64) * 255)[:, None],
        _bytes(colour),
        _bytes(scale_codes),
        _pack_smallest_three(quats),
        _quantise_sh(sh[:, 1:] * sh_signs(degree)[1:, None], options.sh_bits).reshape(len(points), -1),
    ]
    header = SpzHeader(version, len(points), degree, bits, bool(gaussians.notes.antialiased))
    path.write_bytes(pack_blocks(header, blocks))
    return notes


def fixed_points(points: NDArray) -> tuple[NDArray, int]:
    """Positions as a file keeps them.

    Args:
        points: (N, 3) in SPZ's axes.

    Returns:
        (N, 3) int32 of 24 bits, and how many of them are the fraction: all that the positions leave.

    Raises:
        InputError: positions too far away for the format.
    """
    reach = float(np.abs(points).max())
    if reach >= _FIXED_LIMIT:
        raise InputError(f"positions reach {reach:.3g} units, .spz holds {_FIXED_LIMIT}; bring the scene nearer first")
    bits = int(np.clip(np.floor(np.log2(_FIXED_LIMIT / max(reach, 1e-30))), 0, MAX_FRACTIONAL_BITS))
    return np.rint(np.ldexp(points, bits)).clip(-_FIXED_LIMIT, _FIXED_LIMIT).astype(np.int32), bits


def read_spz(path: Path, max_bytes: int) -> Contents:
    """Read means (N, 3), quats (N, 4), scales (N, 3), opacities (N,) and sh (N, B, 3), linear, in floating point, and
    the one note that a header has room for.

    Raises:
        InputError: damaged, of another version, or larger than `max_bytes`.
        ImportError: version 4, and zstandard is not installed.
    """
    with path.open("rb") as file:
        header, arrays = decode_spz(file, max_bytes)
    return half_turned(arrays), {"antialiased": YES} if header.antialiased else {}


def decode_spz(file: BinaryIO, max_bytes: int) -> tuple[SpzHeader, dict[str, NDArray]]:
    """The header, and arrays as `read_spz` has them, in SPZ's own axes."""
    header, (positions, alphas, colours, scales, rotations, higher) = read_blocks(file, max_bytes)
    functions = (header.degree + 1) ** 2
    rest = (higher.reshape(header.count, functions - 1, 3) - 128.0) / 128
    quats = _unpack_smallest_three(rotations) if header.version >= 3 else _unpack_first_three(rotations)
    with np.errstate(invalid="ignore"):  # NaN among version 1's positions: Gaussians will name it
        arrays = {
            "means": _positions(positions, header),
            "quats": quats,
            "scales": np.exp(scales / _LOG_SCALE_STEPS - _LOG_SCALE_OFFSET),
            "opacities": alphas[:, 0] / 255.0,
            "sh": np.concatenate([((colours - 127.5) / (_COLOUR_SCALE * 255))[:, None], rest], axis=1),
        }
        return header, arrays if header.axes == SPZ_AXES else from_spz_system(arrays, header.axes)


def _positions(octets: NDArray, header: SpzHeader) -> NDArray:
    """(N, 3) float64 in SPZ's axes."""
    if header.version == 1:
        return np.ascontiguousarray(octets).view("<f2").astype(np.float64)
    padded = np.zeros((len(octets), 3, 4), np.uint8)
    padded[..., 1:] = octets.reshape(-1, 3, 3)
    fixed = padded.view("<i4")[..., 0] >> 8  # the shift brings the sign along
    return np.ldexp(fixed.astype(np.float64), -header.fractional_bits)


def _position_notes(points: NDArray, bits: int, scales: NDArray) -> list[str]:
    """Said where rounding positions could show: where it exceeds a quarter of the typical Gaussian's size."""
    step, size = 2.0**-bits, float(np.median(scales.max(axis=-1)))
    if step / 2 <= size / 4:
        return []
    reach = float(np.abs(points).max())
    return [f"positions rounded to {step:.3g} units, as the scene reaches {reach:.3g} from its origin"]


def _bytes(values: NDArray) -> NDArray:
    return np.rint(values).clip(0, 255).astype(np.uint8)


def _pack_smallest_three(quats: NDArray) -> NDArray:
    """(N, 4) bytes of unit quaternions wxyz: the largest component's index in x, y, z, w, then sign and 9 bits each."""
    largest, three = smallest_three(np.roll(quats, -1, axis=1))
    magnitudes = np.rint(np.abs(three) * np.sqrt(2) * _COMPONENT_MASK).clip(0, _COMPONENT_MASK).astype(np.uint32)
    packed = largest.astype(np.uint32)
    for code in ((three < 0).astype(np.uint32) << 9 | magnitudes).T:
        packed = packed << _COMPONENT_BITS | code
    return packed.astype("<u4")[:, None].view(np.uint8)


def _unpack_smallest_three(octets: NDArray) -> NDArray:
    packed = np.ascontiguousarray(octets).view("<u4").astype(np.int64)  # (N, 1)
    codes = packed >> _COMPONENT_BITS * np.array([2, 1, 0])  # (N, 3)
    values = (codes & _COMPONENT_MASK) / _COMPONENT_MASK / np.sqrt(2)
    three = np.where(codes >> 9 & 1, -values, values)
    return np.roll(from_smallest_three(packed[:, 0] >> 30, three), 1, axis=1)


def _unpack_first_three(octets: NDArray) -> NDArray:
    """Quaternions wxyz of (N, 3) bytes: x, y, z where w is positive."""
    xyz = octets / 127.5 - 1
    w = np.sqrt(np.maximum(1 - (xyz**2).sum(axis=1, keepdims=True), 0))
    return np.concatenate([w, xyz], axis=1)


def _quantise_sh(sh: NDArray, bits: tuple[int, int]) -> NDArray:
    """(N, B − 1, 3) bytes, rounded to multiples of 2^(8 − bits)."""
    steps = np.where(np.arange(sh.shape[1]) < 3, 1 << (8 - bits[0]), 1 << (8 - bits[1]))[:, None]
    codes = np.rint(sh * 128) + 128
    return ((codes + steps // 2) // steps * steps).clip(0, 255).astype(np.uint8)
