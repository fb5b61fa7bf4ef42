"""Points in the .ply layout of 3D Gaussian Splatting, through the package plyfile; compressed ones are read too.

Names and order: x y z, nx ny nz (zero), f_dc_0…2, f_rest_* with all higher SH coefficients of red, then of green, then
of blue, opacity (logit), scale_0…2 (natural logarithm), rot_0…3 (wxyz). Source: Kerbl et al. 2023, the reference code's
`save_ply`.

Trust boundary: a header's counts are held against the file's length before memory is taken.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, warn
from ..gaussian.gaussians import Gaussians
from ..gaussian.quaternions import normalize_quats
from ..gaussian.sh import C0
from ..system.files import parsing
from .assembly import PointCloud, cut_degree_note
from .compressed_ply import compressed_arrays, is_compressed
from .file_notes import ply_comments

MAX_PLY_DEGREE = 3
"""The highest SH degree that the layout's readers know."""

_MEANS, _CONSTANT, _OPACITY = ("x", "y", "z"), ("f_dc_0", "f_dc_1", "f_dc_2"), ("opacity",)
_SCALES, _QUATS = ("scale_0", "scale_1", "scale_2"), ("rot_0", "rot_1", "rot_2", "rot_3")
_REST = re.compile(r"f_rest_\d{1,3}")

_MAX_HEADER_BYTES = 1 << 16
_TELLING = 16  # points from which on values of all of them tell something
_WIDE = 0.2  # of the points' extent, which no real scene's median Gaussian reaches
_MAX_COLOUR = 4.0  # f_dc of a colour a little over twice white
_BYTES = {"char": 1, "uchar": 1, "int8": 1, "uint8": 1, "short": 2, "ushort": 2, "int16": 2, "uint16": 2}
_BYTES |= {"double": 8, "float64": 8}
_OPACITY_MARGIN = 2.0**-24  # logits within ±16.6; what it moves is less than float32's step at 1


def read_ply(path: Path, max_bytes: int) -> dict[str, NDArray]:
    """Read means (N, 3), quats (N, 4), scales (N, 3), opacities (N,) and sh (N, B, 3), linear, in floating point.

    Positions stored as double stay float64.

    Raises:
        InputError: damaged, of another layout, or larger than `max_bytes`.
        ImportError: plyfile is not installed.
    """
    import plyfile

    _check_header(path, max_bytes)
    with parsing(".ply file"):
        elements = {element.name: element for element in plyfile.PlyData.read(str(path))}
    if is_compressed(elements):
        return compressed_arrays(elements)
    with parsing(".ply file"):
        vertex: NDArray[Any] = elements["vertex"].data if "vertex" in elements else np.zeros(0)
    if "vertex" in elements and not len(vertex):
        raise InputError("no vertices, expected one for each Gaussian")
    names = [name for name in vertex.dtype.names or () if vertex.dtype[name].kind in "fiu"]  # lists are objects
    rest = [f"f_rest_{i}" for i in range(sum(_REST.fullmatch(name) is not None for name in names))]
    missing = [name for name in (*_MEANS, *_CONSTANT, *rest, *_OPACITY, *_SCALES, *_QUATS) if name not in names]
    if missing or len(rest) % 3:
        fault = f"lacks {', '.join(missing[:6])}" if missing else f"{len(rest)} f_rest properties"
        raise InputError(f"{fault}, expected vertices in the layout of 3D Gaussian Splatting")
    for doubt in _doubts(vertex):
        warn(f"{path}: {doubt}")
    with parsing(".ply file"), np.errstate(over="ignore", invalid="ignore"):
        higher = _columns(vertex, rest).reshape(len(vertex), 3, -1).swapaxes(1, 2)  # (N, B − 1, 3)
        return {
            "means": _columns(vertex, _MEANS),
            "quats": _columns(vertex, _QUATS),
            "scales": np.exp(_columns(vertex, _SCALES).astype(np.float64)),
            "opacities": 1 / (1 + np.exp(-_columns(vertex, _OPACITY)[:, 0].astype(np.float64))),
            "sh": np.concatenate([_columns(vertex, _CONSTANT)[:, None], higher], axis=1),
        }


def save_ply(path: Path, gaussians: Gaussians) -> list[str]:
    """Write Gaussians of any shape as points; what is lost or unusual, one line each.

    SH above degree MAX_PLY_DEGREE is left out, opacities 0 and 1 and scales 0 move by less than 1e-7. Positions are
    double where float would lose digits of them.
    """
    points, notes = PointCloud.of(gaussians), cut_degree_note(gaussians, MAX_PLY_DEGREE, ".ply")
    if points.is_far:
        notes.append("x, y, z written as double: too far from the world's origin for float")
    means, listed = points.means if points.is_far else points.means.astype(np.float32), points.gaussians
    sh = listed.sh[:, : (MAX_PLY_DEGREE + 1) ** 2]  # (N, B, 3)
    opacities = listed.opacities.astype(np.float64).clip(_OPACITY_MARGIN, 1 - _OPACITY_MARGIN)
    higher = sh[:, 1:].swapaxes(1, 2).reshape(len(sh), -1)
    blocks: list[tuple[Sequence[str], NDArray]] = [
        (_MEANS, means),
        (("nx", "ny", "nz"), np.zeros_like(means)),
        (_CONSTANT, sh[:, 0]),
        ([f"f_rest_{i}" for i in range(higher.shape[1])], higher),
        (_OPACITY, (np.log(opacities) - np.log1p(-opacities))[:, None]),
        (_SCALES, np.log(listed.scales.clip(np.finfo(np.float32).tiny))),
        (_QUATS, normalize_quats(listed.quats)),
    ]
    types = [(name, means.dtype if block is means else np.float32) for names, block in blocks for name in names]
    vertex = np.empty(len(means), types)
    for names, block in blocks:
        for name, column in zip(names, block.T, strict=True):
            vertex[name] = column
    _write(path, vertex, ply_comments(gaussians.notes))
    return notes


def write_points(path: Path, gaussians: Gaussians) -> None:
    """Write means and colours of degree 0 as a plain point cloud, as MeshLab, CloudCompare and Blender open it.

    Positions are double where float would lose digits of them.
    """
    from ..scene.pictures import to_uint8  # which loads av

    points = PointCloud.of(gaussians)
    means = points.means if points.is_far else points.means.astype(np.float32)
    colours = to_uint8(0.5 + C0 * points.gaussians.sh[:, 0])
    types = [(axis, means.dtype) for axis in "xyz"] + [(name, np.uint8) for name in ("red", "green", "blue")]
    vertex = np.empty(len(means), types)
    for name, column in zip(vertex.dtype.names or (), (*means.T, *colours.T), strict=True):
        vertex[name] = column
    _write(path, vertex, ply_comments(gaussians.notes))


def _write(path: Path, vertex: NDArray, comments: Sequence[str]) -> None:
    import plyfile

    elements = [plyfile.PlyElement.describe(vertex, "vertex")]
    plyfile.PlyData(elements, byte_order="<", comments=list(comments)).write(str(path))


def _columns(vertex: NDArray, names: Sequence[str]) -> NDArray:
    """(N, names) of one floating-point type."""
    return np.stack([vertex[name] for name in names], axis=-1) if names else np.zeros((len(vertex), 0), np.float32)


def _doubts(vertex: NDArray) -> list[str]:
    """What points to values that are not as the layout has them, a line each."""
    if len(vertex) < _TELLING:
        return []
    with np.errstate(over="ignore", invalid="ignore"):
        blocks = [_columns(vertex, names).astype(np.float64) for names in (_MEANS, _SCALES, _OPACITY, _CONSTANT)]
    means, scales, opacity, colours = (block[np.isfinite(block).all(axis=1)] for block in blocks)
    doubts = []
    if means.size and scales.size and scales.min() >= 0:
        low, high = np.percentile(means, (5, 95), axis=0)
        if np.exp(np.median(scales)) > _WIDE * (high - low).max():
            doubts.append("scale_0…2 hold no value below 0: linear scales, where their logarithms are expected?")
    if opacity.size and 0 <= opacity.min() < opacity.max() <= 1:
        doubts.append("opacity lies within 0 and 1 everywhere: linear values, where logits are expected?")
    if colours.size and 0 <= colours.min() < colours.max() and not _MAX_COLOUR >= colours.max() > 1:
        kind = "0 to 1" if colours.max() <= 1 else "0 to 255"
        doubts.append(f"f_dc_0…2 hold no value below 0: colours of {kind}, where SH coefficients are expected?")
    return doubts


def _check_header(path: Path, max_bytes: int) -> None:
    """Refuse counts that the file is too short for: a value takes at least a byte in each of PLY's encodings."""
    with path.open("rb") as file:
        head, end, _ = file.read(_MAX_HEADER_BYTES).partition(b"end_header")
    if not head.startswith(b"ply") or not end:
        raise InputError("does not start with a PLY header")
    values, length = 0, len(head) + len(b"end_header\n")
    for element in re.split(rb"[\r\n]\s*element\s", head)[1:]:
        count = re.match(rb"\s*\S+\s+(\d{1,18})\s", element)
        if count is None:
            raise InputError("damaged PLY header")
        kinds = re.findall(rb"[\r\n]\s*property\s+(\S+)", element)
        values += int(count[1]) * max(len(kinds), 1)
        length += int(count[1]) * sum(_BYTES.get(kind.decode("ascii", "replace"), 4) for kind in kinds)
    size = path.stat().st_size
    if b"format binary" in head and b"property list" not in head and length > size:
        raise InputError(f"cut short: {size} bytes of the {length} that its header announces")
    if values > min(size, max_bytes // 8):
        raise InputError(f"announces {values} values, which neither the file nor {max_bytes} bytes can hold")
