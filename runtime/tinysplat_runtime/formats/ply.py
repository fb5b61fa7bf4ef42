"""Points in the .ply layout of 3D Gaussian Splatting, through the package plyfile; compressed ones are read too.

Names and order: x y z, nx ny nz (zero), f_dc_0…2, f_rest_* with all higher SH coefficients of red, then of green, then
of blue, opacity (logit), scale_0…2 (natural logarithm), rot_0…3 (wxyz). Source: Kerbl et al. 2023, the reference code's
`save_ply`.

Other trainers' properties: Mip-Splatting's `filter_3D` is applied; `red green blue` stand for f_dc (nerfstudio's
`--ply-color-mode rgb`); without scale_2, Gaussians are the discs of 2D Gaussian Splatting. What is ignored is named.

Trust boundary: `system.ply` holds a header's counts against the file's length before memory is taken.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, warn
from ..gaussian.gaussians import Gaussians
from ..gaussian.quaternions import normalize_quats
from ..gaussian.sh import C0
from ..system.files import parsing
from ..system.ply import ply_elements
from .assembly import Contents, PointCloud, WriteOptions, cut_degree_note
from .compressed_ply import compressed_arrays, is_compressed
from .ply_notes import ply_comments, ply_notes

MAX_PLY_DEGREE = 3
"""The highest SH degree that the layout's readers know."""

_MEANS, _CONSTANT, _OPACITY = ("x", "y", "z"), ("f_dc_0", "f_dc_1", "f_dc_2"), ("opacity",)
_SCALES, _QUATS = ("scale_0", "scale_1", "scale_2"), ("rot_0", "rot_1", "rot_2", "rot_3")
_REST = re.compile(r"f_rest_\d{1,3}")

_COLOURS, _FILTER = (("red", "green", "blue"), ("r", "g", "b")), "filter_3D"
_UNSHOWN = {"nx", "ny", "nz", "red", "green", "blue", "alpha"}
"""Properties that change nothing where there are coefficients."""

_MEANINGS = (
    (
        r"t|time|scale_t|motion_\w+|trbf_\w+|omega_\w+|rot_[4-9]|\w*velocity\w*",
        "this cloud moves, and Gaussians of all its moments are shown at once",
    ),
    (r"beta|sb_params_\w+", "its kernels are no Gaussians, and are drawn as such"),
    (r".*", "no property of 3D Gaussian Splatting, so this may look otherwise than where it was trained"),
)
"""What it means that a property is ignored, by its name; the first that fits."""

_TELLING = 16  # points from which on values of all of them tell something
_MAX_LOGIT = 40.0  # no trainer's
_MAX_COLOUR = 4.0  # f_dc of a colour a little over twice white
_OPACITY_MARGIN = 2.0**-24  # logits within ±16.6; what it moves is less than float32's step at 1


def read_ply(path: Path, max_bytes: int) -> Contents:
    """Read means (N, 3), quats (N, 4), scales (N, 3), opacities (N,) and sh (N, B, 3), linear, in floating point.

    Positions stored as double stay float64. Notes are those of the header's comments.

    Raises:
        InputError: damaged, of another layout, or larger than `max_bytes`.
        ImportError: plyfile is not installed.
    """
    elements = ply_elements(path, max_bytes)
    if is_compressed(elements):
        return compressed_arrays(elements), ply_notes(path)
    vertex: NDArray = elements.get("vertex", np.zeros(0))
    if "vertex" in elements and not len(vertex):
        raise InputError("no vertices, expected one for each Gaussian")
    names = [name for name in vertex.dtype.names or () if vertex.dtype[name].kind in "fiu"]  # lists are objects
    rest = [f"f_rest_{i}" for i in range(sum(_REST.fullmatch(name) is not None for name in names))]
    scales = _SCALES[:2] if {*_SCALES} - {*names} == {"scale_2"} else _SCALES
    colours = next((c for c in _COLOURS if {*c} <= {*names}), ()) if not {*_CONSTANT} & {*names} else ()
    wanted = [*_MEANS, *(colours or _CONSTANT), *rest, *_OPACITY, *scales, *_QUATS]
    missing = [name for name in wanted if name not in names]
    if missing or len(rest) % 3:
        fault = f"lacks {', '.join(missing[:6])}" if missing else f"{len(rest)} f_rest properties"
        raise InputError(f"{fault}, expected vertices in the layout of 3D Gaussian Splatting")
    ignored = [name for name in names if name not in {*wanted, *_UNSHOWN, _FILTER}]
    for line in [*_doubts(vertex, bool(colours)), *_meanings(ignored, is_flat=scales != _SCALES)]:
        warn(f"{path}: {line}")
    with parsing(".ply file"), np.errstate(over="ignore", invalid="ignore"):
        higher = _columns(vertex, rest).reshape(len(vertex), 3, -1).swapaxes(1, 2)  # (N, B − 1, 3)
        constant = (_unit_colours(vertex, colours) - 0.5) / C0 if colours else _columns(vertex, _CONSTANT)
        arrays = {
            "means": _columns(vertex, _MEANS),
            "quats": _columns(vertex, _QUATS),
            "scales": np.exp(_columns(vertex, scales).astype(np.float64)),
            "opacities": 1 / (1 + np.exp(-_columns(vertex, _OPACITY)[:, 0].astype(np.float64))),
            "sh": np.concatenate([constant[:, None], higher], axis=1),
        }
        arrays["scales"] = np.pad(arrays["scales"], ((0, 0), (0, 3 - len(scales))))
        if _FILTER in names:
            arrays = _filtered(arrays, vertex[_FILTER].astype(np.float64))
        return arrays, ply_notes(path)


def _filtered(arrays: dict[str, NDArray], width: NDArray) -> dict[str, NDArray]:
    """Arrays of Gaussians seen through their own low-pass filters, of a standard deviation (N,) each.

    Source: Yu et al. 2024, "Mip-Splatting", section 5.1: covariances grow by the filter's, and opacities shrink by the
    root of the determinants' ratio, so that each Gaussian keeps its mass.
    """
    wide = np.sqrt(arrays["scales"] ** 2 + width[:, None] ** 2)
    shrunk = np.divide(arrays["scales"], wide, out=np.ones_like(wide), where=wide != 0).prod(axis=1)
    return {**arrays, "scales": wide, "opacities": arrays["opacities"] * shrunk}


def _unit_colours(vertex: NDArray, names: Sequence[str]) -> NDArray:
    """(N, 3) float64 colours, 1 being white, of whole numbers of their type's range, or of floating-point ones."""
    colours = _columns(vertex, names)
    if colours.dtype.kind in "iu":
        return colours / float(np.iinfo(colours.dtype).max)
    return colours.astype(np.float64) / (255 if colours.max(initial=0) > _MAX_COLOUR else 1)


def _meanings(ignored: Sequence[str], *, is_flat: bool) -> list[str]:
    """What it means that properties are ignored or lacking, a line each."""
    lines = ["scale_0 and scale_1 alone: discs of 2D Gaussian Splatting, of no thickness"] if is_flat else []
    by_meaning: dict[str, list[str]] = {}
    for name in ignored:
        meaning = next(meaning for pattern, meaning in _MEANINGS if re.fullmatch(pattern, name))
        by_meaning.setdefault(meaning, []).append(name)
    for meaning, names in by_meaning.items():
        lines.append(f"ignores {', '.join(names[:4])}{', …' if len(names) > 4 else ''}: {meaning}")
    return lines


def save_ply(path: Path, gaussians: Gaussians, _: WriteOptions) -> list[str]:
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
    columns = {name: column for names, block in blocks for name, column in zip(names, block.T, strict=True)}
    doubles = _MEANS if points.is_far else ()
    _write(path, columns, {name: np.dtype(float if name in doubles else np.float32) for name in columns}, gaussians)
    return notes


def write_points(path: Path, gaussians: Gaussians) -> None:
    """Write means and colours of degree 0 as a plain point cloud, as MeshLab, CloudCompare and Blender open it.

    Positions are double where float would lose digits of them.
    """
    from ..scene.pictures import to_uint8  # which loads av

    points = PointCloud.of(gaussians)
    means = points.means if points.is_far else points.means.astype(np.float32)
    colours = to_uint8(0.5 + C0 * points.gaussians.sh[:, 0])
    columns = dict(zip((*_MEANS, *_COLOURS[0]), (*means.T, *colours.T), strict=True))
    _write(path, columns, {name: column.dtype for name, column in columns.items()}, gaussians)


def _write(path: Path, columns: Mapping[str, NDArray], types: Mapping[str, np.dtype], gaussians: Gaussians) -> None:
    """Write vertices of columns (N,) by name, and what the Gaussians' notes say."""
    import plyfile

    vertex = np.empty(len(columns["x"]), [*types.items()])
    for name, column in columns.items():
        vertex[name] = column
    elements = [plyfile.PlyElement.describe(vertex, "vertex")]
    plyfile.PlyData(elements, byte_order="<", comments=ply_comments(gaussians.notes)).write(str(path))


def _columns(vertex: NDArray, names: Sequence[str]) -> NDArray:
    """(N, names) of one floating-point type."""
    return np.stack([vertex[name] for name in names], axis=-1) if names else np.zeros((len(vertex), 0), np.float32)


def _doubts(vertex: NDArray, are_colours: bool) -> list[str]:
    """What points to values that are not as the layout has them, a line each; `activation` looks at the others."""
    if len(vertex) < _TELLING:
        return []
    names = [_OPACITY] if are_colours else [_OPACITY, _CONSTANT]
    with np.errstate(over="ignore", invalid="ignore"):
        blocks = [_columns(vertex, block).astype(np.float64) for block in names]
    opacity, *colours = (block[np.isfinite(block).all(axis=1)] for block in blocks)
    doubts = []
    if opacity.size and opacity.min() >= 0 and opacity.max() > _MAX_LOGIT:
        doubts.append("opacity holds no value below 0: linear values of 0 to 255, where logits are expected?")
    for block in colours:
        if block.size and 0 <= block.min() < block.max() and not _MAX_COLOUR >= block.max() > 1:
            kind = "0 to 1" if block.max() <= 1 else "0 to 255"
            doubts.append(f"f_dc_0…2 hold no value below 0: colours of {kind}, where SH coefficients are expected?")
    return doubts
