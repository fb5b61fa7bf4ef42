"""Archiving: planes as float16, bit for bit.

The guarantee: every sample of the planes named in `exact_planes` comes back as the same 16 bits, and a reader checks
that against their SHA-256. Depth is the sum of two float16, since one alone would swap the order of neighbours; the
rest are one each. And what was decoded comes to the same bytes again: float16 are chosen such that the float32
arithmetic of decoding and projecting, whose noise is far below their steps, leads back to them (`_settled_*`).

Samples are predicted from their neighbours and what is left goes through zlib, which measured
8 to 17 % smaller than FFV1 and a quarter smaller than libx265's lossless mode on the bytes (docs/MODES.md).
"""

import zlib
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from ..container.exact import ExactLayer
from ..errors import FormatError, NumericError
from ..gaussian.gaussians import Gaussians
from ..gaussian.planes import GEOMETRY_CHANNELS, PlaneClass
from ..graphs.inference import GraphStore
from ..system.threads import Crew
from .analysis import project_layer

GEOMETRY_PLANES = GEOMETRY_CHANNELS + 1
"""−1/z in two parts, then the other channels of `planes.GEOMETRY` in their order."""

_LEVEL = 9

_TILT = np.array([0.017, 0.029, 0.041, 0.059])
"""Keeps a coarse mean rotation off right angles with quaternions of round numbers."""


def exact_planes(
    store: GraphStore, layer: Gaussians, drop_invalid: bool, where: str
) -> tuple[NDArray, tuple[float, float]]:
    """(V, 12 + 3B, H, W) float16: −1/z, what float16 leaves of it, offset, ŝ, camera-frame rotation, opacity, SH
    coefficients (RGB last); and the smallest and largest z.
    """
    projected = project_layer(store, layer, drop_invalid=drop_invalid, where=where)
    sh = np.moveaxis(layer.sh.reshape(*layer.opacities.shape, -1), -1, 1)
    inverse = _settled_inverse(-1 / projected.planes(PlaneClass.DEPTH).astype(np.float64))
    offset = _settled_offset(projected.planes(PlaneClass.OFFSET), max(layer.opacities.shape[1:]))
    quats = _settled_quats(projected.planes(PlaneClass.ROTATION), projected.reference_quats)
    with np.errstate(over="ignore"):
        first = inverse.astype(np.float16)
        second = (inverse - first.astype(np.float64)).astype(np.float16)
        scale, opacity = projected.planes(PlaneClass.SCALE), projected.planes(PlaneClass.OPACITY)
        parts = (first, second, offset, scale, quats, opacity, sh)
        planes = np.concatenate([part.astype(np.float16) for part in parts], axis=1)
    if not (np.isfinite(planes).all() and planes[:, 0].all()):
        raise NumericError("values beyond float16 (±65504; depths up to 2²⁴), which --lossless stores", where=where)
    stored = -1 / (planes[:, 0].astype(np.float64) + planes[:, 1])
    return planes, (float(stored.min()), float(stored.max()))


def _settled_inverse(inverse: NDArray) -> NDArray:
    """−1/z to 19 significant bits: means are float32, of which a far camera leaves little more."""
    step = np.exp2(np.floor(np.log2(np.abs(inverse))) - 18)
    return np.rint(inverse / step) * step


def _settled_offset(offset: NDArray, pixels: int) -> NDArray:
    """Offsets in px to 2⁻²⁰ of the picture's side, rounded up to a power of two: what is finer is float32's noise."""
    step = 2.0 ** (np.ceil(np.log2(pixels)) - 20)
    return np.rint(offset / step) * step + 0.0  # no −0, whose sign would be noise


def _settled_quats(quats: NDArray, reference: NDArray) -> NDArray:
    """Quaternions (V, 4, H, W) at the length that makes their largest component 1, to 2⁻¹⁹.

    Decoding makes the length 1: of a unit quaternion, rounded, the four nearest float16 would be others the next time.
    The sign is the one nearer to the view's mean rotation (V, 4), taken so coarsely that rounding
    does not change it.
    """
    towards = np.rint(8 * reference) + _TILT
    sign = np.where(np.einsum("vc,vchw->vhw", towards, quats) < 0, -1.0, 1.0)[:, None]
    return np.rint(quats * sign / np.abs(quats).max(axis=1, keepdims=True) * 2.0**19) / 2.0**19 + 0.0


def decode_exact(layer: ExactLayer, crew: Crew) -> tuple[NDArray, NDArray]:
    """Geometry (V, 11, H, W) float64 with −1/z for depth, and SH coefficients (V, H, W, B, 3) float32.

    Raises:
        FormatError: the planes are not those that were written.
    """
    views, count = len(layer.cameras), layer.planes
    shape = layer.height, layer.width

    def decode(number: int) -> NDArray:
        view, plane = divmod(number, count)
        return unpack(layer.payload(view, plane), shape, f"exact plane {plane}, view {view}")

    planes = np.stack(crew.map(decode, range(views * count))).reshape(views, count, *shape)
    if sha256(planes.tobytes()).digest() != layer.sha256:
        raise FormatError("SHA-256 of the planes differs: they are not those that were written", where="exact planes")
    if not np.isfinite(planes).all():
        raise FormatError("holds NaN or infinity", where="exact planes")
    geometry = planes[:, 1:GEOMETRY_PLANES].astype(np.float64)
    geometry[:, 0] += planes[:, 0]
    sh = np.moveaxis(planes[:, GEOMETRY_PLANES:].astype(np.float32), 1, -1)
    return geometry, np.ascontiguousarray(sh).reshape(views, *shape, -1, 3)


def pack(plane: NDArray) -> bytes:
    """One float16 plane (H, W) as bytes; see docs/FORMAT.md, "Exact planes"."""
    ordered = _ordered(plane.view(np.uint16))
    rest = (ordered - _predict(ordered)).view(np.int16)
    folded = ((rest << 1) ^ (rest >> 15)).view(np.uint16)
    return zlib.compress(folded.astype("<u2").view(np.uint8).reshape(-1, 2).T.tobytes(), _LEVEL)


def unpack(data: bytes | memoryview, shape: tuple[int, int], where: str) -> NDArray:
    """The float16 plane (h, w) of `pack`; FormatError if the bytes do not come to exactly one."""
    wanted = 2 * shape[0] * shape[1]
    stream = zlib.decompressobj()
    try:
        raw = stream.decompress(data, wanted)
        is_whole = len(raw) == wanted and not stream.decompress(stream.unconsumed_tail, 1)
        is_whole = is_whole and stream.eof and not stream.unused_data
    except zlib.error as error:
        raise FormatError(f"zlib: {error}", where=where) from None
    if not is_whole:
        raise FormatError(f"does not come to {wanted} bytes", where=where)
    folded = np.frombuffer(raw, np.uint8).reshape(2, -1).T.copy().view("<u2").astype(np.uint16).reshape(shape)
    rest = (folded >> 1) ^ (0 - (folded & 1)).astype(np.uint16)
    return _ordered_back(_unpredict(rest)).view(np.float16)


def _ordered(bits: NDArray) -> NDArray:
    """Bits of float16 as integers that rise with the value."""
    return np.where(bits & 0x8000, ~bits, bits | 0x8000).astype(np.uint16)


def _ordered_back(ordered: NDArray) -> NDArray:
    return np.where(ordered & 0x8000, ordered & 0x7FFF, ~ordered).astype(np.uint16)


def _median(left: NDArray, above: NDArray, corner: NDArray) -> NDArray:
    """The middle one of left, above and left + above − corner (ITU-T T.87, annex A.4.1), int32."""
    return np.clip(left + above - corner, np.minimum(left, above), np.maximum(left, above))


def _predict(plane: NDArray) -> NDArray:
    """Every sample's prediction from those before it; outside the plane the first row repeats its left neighbour."""
    wide = plane.astype(np.int32)
    left, above, corner = (np.zeros_like(wide) for _ in range(3))
    left[:, 1:], above[1:], corner[1:, 1:] = wide[:, :-1], wide[:-1], wide[:-1, :-1]
    left[1:, 0] = corner[1:, 0] = above[1:, 0]
    above[0] = corner[0] = left[0]
    return _median(left, above, corner).astype(np.uint16)


def _unpredict(rest: NDArray) -> NDArray:
    """Inverse of subtracting `_predict`: along anti-diagonals, whose samples depend on earlier ones alone."""
    height, width = rest.shape
    # A frame of one row above and one column to the left, filled as the first samples demand.
    out = np.zeros((height + 1, width + 1), np.int32)
    for diagonal in range(height + width - 1):
        rows = np.arange(max(0, diagonal - width + 1), min(height, diagonal + 1))
        columns = diagonal - rows
        left, above, corner = out[rows + 1, columns], out[rows, columns + 1], out[rows, columns]
        above = np.where(rows == 0, left, above)
        corner = np.where(rows == 0, left, corner)
        left = np.where((columns == 0) & (rows > 0), above, left)
        corner = np.where((columns == 0) & (rows > 0), above, corner)
        out[rows + 1, columns + 1] = (_median(left, above, corner) + rest[rows, columns]) & 0xFFFF
    return out[1:, 1:].astype(np.uint16)
