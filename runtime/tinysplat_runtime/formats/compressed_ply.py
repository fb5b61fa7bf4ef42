"""Points in SuperSplat's compressed .ply: chunks of 256 with their ranges, four 32-bit words a Gaussian, SH as bytes.

Positions and logarithms of scales are 11, 10 and 11 bits of their chunk's range, colours and opacities 8, rotations the
three smallest components of wxyz in 10 bits each behind the largest one's index. SH of degree 1 to 3 lie channel by
channel as bytes of the range −4 to 4. Source: github.com/playcanvas/splat-transform.

Writers differ in what a byte of SH stands for: splat-transform cuts value / 8 + 1/2 into 256 intervals and its reader
gives back their middles, but for the outermost two; so does this one.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian.curve import morton_order
from ..gaussian.gaussians import Gaussians
from ..gaussian.quaternions import from_smallest_three, normalize_quats, smallest_three
from ..gaussian.sh import C0
from .assembly import PointCloud, WriteOptions, cut_degree_note, far_note
from .ply_notes import ply_comments

CHUNK = 256
MAX_DEGREE = 3

_AXES, _RGB = ("x", "y", "z"), ("r", "g", "b")
_RANGES = [
    *(f"{end}_{axis}" for end in ("min", "max") for axis in _AXES),
    *(f"{end}_scale_{axis}" for end in ("min", "max") for axis in _AXES),
    *(f"{end}_{channel}" for end in ("min", "max") for channel in _RGB),
]
_WORDS = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
_LOG_SCALE_LIMIT = 20.0
_SH_COUNTS = (0, 9, 24, 45)  # of degrees 0 to 3, without the first band


def save_compressed_ply(path: Path, gaussians: Gaussians, _: WriteOptions) -> list[str]:
    """Write Gaussians of any shape as points in Morton order, SH up to degree MAX_DEGREE; what is lost, one line each.

    Raises:
        ImportError: plyfile is not installed.
    """
    import plyfile

    points = PointCloud.of(gaussians)
    listed, means = points.gaussians, points.means
    order = morton_order(means)
    count, chunks = len(order), -(-len(order) // CHUNK)
    padded = np.concatenate([order, np.full(chunks * CHUNK - count, order[-1])])
    sh = listed.sh[:, : (MAX_DEGREE + 1) ** 2]
    log_scales = np.log(listed.scales.clip(np.finfo(np.float32).tiny)).clip(-_LOG_SCALE_LIMIT, _LOG_SCALE_LIMIT)
    columns, words = [], []
    for values, bits in ((means, (11, 10, 11)), (log_scales, (11, 10, 11)), (0.5 + C0 * sh[:, 0], (8, 8, 8))):
        low, high, codes = _in_chunks(values[padded].reshape(chunks, CHUNK, 3), bits)
        columns += [low, high]
        words.append(codes.reshape(-1, 3)[:count])
    opacity = np.rint(listed.opacities[order] * 255.0).astype(np.uint32)
    packed = [
        _joined(words[0], (11, 10, 11)),
        _packed_rotation(listed.quats[order]),
        _joined(words[1], (11, 10, 11)),
        _joined(np.concatenate([words[2], opacity[:, None]], axis=1), (8, 8, 8, 8)),
    ]
    elements = [
        _element("chunk", _RANGES, np.concatenate(columns, axis=1), np.dtype(np.float32)),
        _element("vertex", _WORDS, np.stack(packed, axis=1), np.dtype(np.uint32)),
    ]
    if sh.shape[1] > 1:
        higher = sh[order, 1:].swapaxes(1, 2).reshape(count, -1)
        codes = np.floor((higher / 8 + 0.5) * 256).clip(0, 255)
        names = [f"f_rest_{i}" for i in range(higher.shape[1])]
        elements.append(_element("sh", names, codes, np.dtype(np.uint8)))
    plyfile.PlyData(elements, byte_order="<", comments=ply_comments(gaussians.notes)).write(str(path))
    return [*cut_degree_note(gaussians, MAX_DEGREE, ".compressed.ply"), *far_note(points)]


def is_compressed(elements: Mapping[str, NDArray]) -> bool:
    """Whether the elements of a .ply by name are of this layout."""
    return "chunk" in elements and "vertex" in elements and _WORDS[0] in (elements["vertex"].dtype.names or ())


def compressed_arrays(elements: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """Means (N, 3), quats (N, 4), scales (N, 3), opacities (N,), sh (N, B, 3), linear, float64, of such elements.

    Raises:
        InputError: columns are missing, or counts do not fit each other.
    """
    chunk, vertex = elements["chunk"], elements["vertex"]
    ranges = _RANGES if "min_r" in (chunk.dtype.names or ()) else _RANGES[:12]
    words = _columns(vertex, _WORDS, "vertex", "iu").astype(np.uint32)
    bounds = _columns(chunk, ranges, "chunk")
    if not len(words) or len(bounds) != -(-len(words) // CHUNK):
        raise InputError(f"{len(bounds)} chunks for {len(words)} Gaussians, expected one for {CHUNK}")
    if not np.isfinite(bounds).all():
        raise InputError("a range that is not finite", where="chunk")
    rows = np.repeat(bounds.astype(np.float64), CHUNK, axis=0)[: len(words)]
    low_high = rows.reshape(len(words), -1, 3)  # of each attribute in turn
    position, scale = _split(words[:, 0], (11, 10, 11)), _split(words[:, 2], (11, 10, 11))
    colour = _split(words[:, 3], (8, 8, 8, 8))
    has_colours = low_high.shape[1] == 6
    rgb = _between(low_high[:, 4], low_high[:, 5], colour[:, :3]) if has_colours else colour[:, :3]
    with np.errstate(over="ignore"):  # Gaussians will name what is not finite
        return {
            "means": _between(low_high[:, 0], low_high[:, 1], position),
            "quats": _unpacked_rotation(words[:, 1]),
            "scales": np.exp(_between(low_high[:, 2], low_high[:, 3], scale)),
            "opacities": colour[:, 3],
            "sh": np.concatenate([((rgb - 0.5) / C0)[:, None], _higher(elements, len(words))], axis=1),
        }


def _higher(elements: Mapping[str, NDArray], count: int) -> NDArray:
    """(N, B − 1, 3)."""
    if "sh" not in elements:
        return np.zeros((count, 0, 3))
    data = elements["sh"]
    names = [f"f_rest_{i}" for i in range(len(data.dtype.names or ()))]
    if len(names) not in _SH_COUNTS or len(data) != count:
        raise InputError(f"{len(data)} rows of {len(names)} SH values for {count} Gaussians")
    codes = _columns(data, names, "sh", "iu").astype(np.float64)
    middles = np.where(codes <= 0, 0, np.where(codes >= 255, 1, (codes + 0.5) / 256))
    return ((middles - 0.5) * 8).reshape(count, 3, -1).swapaxes(1, 2)


def _in_chunks(values: NDArray, bits: Sequence[int]) -> tuple[NDArray, NDArray, NDArray]:
    """Lowest and highest (C, 3) of each chunk as float32, and codes (C, CHUNK, 3) between them."""
    low, high = values.min(axis=1).astype(np.float32), values.max(axis=1).astype(np.float32)
    span = (high.astype(np.float64) - low)[:, None]
    share = np.divide(values - low[:, None], span, out=np.zeros(values.shape), where=span > 0)
    steps = np.array([(1 << n) - 1 for n in bits])
    return low, high, np.rint(share.clip(0, 1) * steps).astype(np.uint32)


def _between(low: NDArray, high: NDArray, share: NDArray) -> NDArray:
    return low * (1 - share) + high * share


def _joined(codes: NDArray, bits: Sequence[int]) -> NDArray:
    word = np.zeros(len(codes), np.uint32)
    for column, n in zip(codes.T.astype(np.uint32), bits, strict=True):
        word = word << np.uint32(n) | column
    return word


def _split(words: NDArray, bits: Sequence[int]) -> NDArray:
    """(N, len(bits)) shares 0 to 1."""
    shares = np.empty((len(words), len(bits)))
    for i in reversed(range(len(bits))):
        mask = (1 << bits[i]) - 1
        shares[:, i] = (words & np.uint32(mask)) / mask
        words = words >> np.uint32(bits[i])
    return shares


def _packed_rotation(quats: NDArray) -> NDArray:
    largest, three = smallest_three(normalize_quats(quats.astype(np.float64)))
    codes = np.rint((three * np.sqrt(0.5) + 0.5) * 1023).clip(0, 1023)
    return _joined(np.column_stack([largest, codes]), (2, 10, 10, 10))


def _unpacked_rotation(words: NDArray) -> NDArray:
    three = (_split(words & np.uint32((1 << 30) - 1), (10, 10, 10)) - 0.5) * np.sqrt(2)
    return from_smallest_three((words >> np.uint32(30)).astype(np.int64), three)


def _element(name: str, names: Sequence[str], values: NDArray, kind: np.dtype) -> Any:
    import plyfile

    rows = np.ascontiguousarray(values, kind)
    return plyfile.PlyElement.describe(rows.view([(column, kind) for column in names])[:, 0], name)


def _columns(data: NDArray, names: Sequence[str], element: str, kinds: str = "fiu") -> NDArray:
    held = {name for name in data.dtype.names or () if data.dtype[name].kind in kinds}
    missing = [name for name in names if name not in held]
    if missing:
        raise InputError(f"lacks {', '.join(missing[:4])}", where=element)
    return np.stack([data[name] for name in names], axis=-1) if names else np.zeros((len(data), 0))
