"""Gaussian files of other tools: .npz, .safetensors, 3DGS .ply, .spz, and what splat-transform converts (.sog).

`.npz` and `.safetensors` hold the arrays `means quats scales opacities sh` of one leading shape, (V, H, W) or (N,),
and `K` (V, 3, 3) in pixels and `c2w` (V, 4, 4) where there is one Gaussian per pixel; `origin` (3,) where means are
relative to one. Layer n > 0 has the arrays `layer{n}_means` and so on with its own `layer{n}_K`; it shares the views'
`c2w` unless there is a `layer{n}_c2w`. Numbers of any real type are taken; other arrays are ignored.

`.ply` is the layout of 3D Gaussian Splatting: opacities as logits, scales as logarithms, quaternions wxyz, `f_rest`
channel by channel. Neither it nor .spz and .sog know pixels or layers: all layers become one list of points, and a list
of points becomes a grid again where its order is given.

float64 means may not fit float32. Where rounding would move any Gaussian by more than ORIGIN_TOLERANCE of its distance
to the nearest camera (without cameras: of the cloud's size), the mean camera centre (the mean of the means) becomes
the `origin` that they are stored relative to. float32 means are taken as they are.

Trust boundary: shapes, types and total size come from headers and are checked before memory is taken; nothing is
unpickled.
"""

from __future__ import annotations

import math
import re
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian.gaussians import FIELDS, Gaussians
from ..gaussian.sh import C0
from ..scene.cameras import Camera
from ..scene.images import to_uint8
from ..system.files import StrPath, atomic_path, check_readable, parsing
from .file_notes import KEEPS, NPZ_ARRAY, npz_array, ply_comments, read_notes
from .ply import MAX_PLY_DEGREE, read_ply, write_ply, write_points
from .splat_transform import READS, read_foreign, write_sog
from .spz import SH_BITS, SPZ_VERSION, read_spz, write_spz

MAX_BYTES = 8 << 30
"""Most memory that the arrays of one file may take: 24 million Gaussians of SH degree 4."""

MAX_EXPANSION = 100
"""Most bytes of array per byte of a compressed file beyond MIN_BUDGET. Real Gaussians reach 2, bombs 1,000."""

MIN_BUDGET = 256 << 20

ORIGIN_TOLERANCE = 1e-6
"""Largest rounding of means, relative to the distance from the nearest camera, that needs no origin."""

_ARRAY_NAME = re.compile(r"(?:(?:layer[1-9]\d{0,3}_)?(?:means|quats|scales|opacities|sh|K|c2w)|origin)")

_UNIT_FOCAL_BELOW = 4.0  # pixels; real focal lengths below it see more than 126° of a picture 16 pixels wide

_INSTALL = 'needs a package that is not installed: pip install "tinysplat[io]"'


def load_gaussians(
    path: StrPath,
    grid: tuple[int, int, int] | None = None,
    cameras: Sequence[Camera] | None = None,
    max_bytes: int = MAX_BYTES,
) -> Gaussians:
    """Read a Gaussian file.

    Args:
        path: .npz, .safetensors, .ply or .spz; .sog, .splat and .ksplat with the program splat-transform.
        grid: (V, H, W) that a flat list of points is the pixels of, in C order.
        cameras: one per view, for files that hold none; they state the grid as well.
        max_bytes: most memory that the file's arrays may take.

    Raises:
        InputError: names the file and the array: missing, damaged, too large, of another shape, out of range.
    """
    readers = {".npz": _npz_arrays, ".safetensors": _safetensors_arrays, ".ply": read_ply, ".spz": read_spz}
    readers |= dict.fromkeys(READS, read_foreign)
    read = _by_suffix(path, readers)
    check_readable(path)
    if cameras and grid is None:
        grid = (len(cameras), cameras[0].height, cameras[0].width)
    if grid is not None and (len(grid) != 3 or min(grid) < 1):
        raise InputError(f"{tuple(grid)}, expected (V, H, W), each at least 1", where="grid")
    try:
        gaussians = _assemble(read(Path(path), max_bytes), grid, cameras)
        return gaussians.with_notes(read_notes(Path(path)))
    except ImportError:
        raise InputError(f"{Path(path).suffix} {_INSTALL}", where=str(path)) from None
    except InputError as error:
        raise error.within(str(path)) from None


def save_gaussians(
    path: StrPath, gaussians: Gaussians, sh_bits: tuple[int, int] = SH_BITS, spz_version: int = SPZ_VERSION
) -> list[str]:
    """Write a Gaussian file, atomically.

    .npz and .safetensors keep everything and read back exactly.

    Args:
        path: .npz, .safetensors, .ply or .spz; .sog with the program splat-transform.
        gaussians: any, with any number of layers.
        sh_bits: for .spz, bits kept of SH coefficients of degree 1 and of higher ones, 1 to 8.
        spz_version: 2, 3 or 4; 4 takes zstandard here and zstd in readers, and keeps SH degree 4.

    Returns:
        What the format could not keep or other readers may not expect, one line each; empty when there is nothing.

    Raises:
        InputError: another suffix, or the package or program for the format is missing.
        OSError: the file cannot be written.
    """
    if not all(1 <= bits <= 8 for bits in sh_bits):
        raise InputError(f"{sh_bits}, expected two numbers of 1 to 8", where="SH bits")
    writers = {
        ".npz": _save_npz,
        ".safetensors": _save_safetensors,
        ".ply": _save_ply,
        ".spz": partial(_save_spz, sh_bits=sh_bits, version=spz_version),
        ".sog": _save_sog,
    }
    write = _by_suffix(path, writers)
    try:
        with atomic_path(path) as temporary:
            return [*write(temporary, gaussians), *_lost_notes(path, gaussians)]
    except ImportError:
        raise InputError(f"{Path(path).suffix} {_INSTALL}", where=str(path)) from None
    except InputError as error:
        raise error if error.where and error.where.startswith(str(path)) else error.within(str(path)) from None


def save_points(path: StrPath, gaussians: Gaussians) -> None:
    """Write means and view-independent colours as a plain point cloud (.ply), atomically.

    Raises:
        InputError: another suffix, or plyfile is missing.
    """
    _by_suffix(path, {".ply": write_points})
    flat = gaussians.flat()
    means = flat.means.astype(np.float64) + flat.origin
    far = flat.origin.any() and _loses_digits(means, _centres(gaussians.cameras))
    try:
        with atomic_path(path) as temporary:
            positions, comments = means if far else means.astype(np.float32), ply_comments(gaussians.notes)
            write_points(temporary, positions, to_uint8(0.5 + C0 * flat.sh[:, 0]), comments)
    except ImportError:
        raise InputError(f".ply {_INSTALL}", where=str(path)) from None


def _by_suffix(path: StrPath, choices: Mapping[str, Any]) -> Any:
    suffix = Path(path).suffix.lower()
    if suffix not in choices:
        raise InputError(f"suffix '{suffix}', expected {', '.join(choices)}", where=str(path))
    return choices[suffix]


# ---- arrays out of .npz and .safetensors -------------------------------------------------------------------------


@dataclass(frozen=True)
class _Header:
    """An array that a file announces."""

    dtype: str
    shape: tuple[int, ...]
    itemsize: int
    is_real: bool


def _check_headers(headers: Mapping[str, _Header], budget: int) -> None:
    for name, header in headers.items():
        if not header.is_real:
            raise InputError(f"of type {header.dtype}, expected float16, float32 or float64", where=name)
        if len(header.shape) > 8 or any(n < 0 for n in header.shape):
            raise InputError(f"of shape {str(header.shape)[:60]}", where=name)
    total = sum(math.prod(header.shape) * header.itemsize for header in headers.values())
    if total > budget:
        raise InputError(f"arrays of {total} bytes in all, expected at most {budget} of this file")


def _npz_arrays(path: Path, max_bytes: int) -> dict[str, NDArray]:
    budget = min(max_bytes, max(MIN_BUDGET, MAX_EXPANSION * path.stat().st_size))
    with parsing(".npz file"), zipfile.ZipFile(path) as archive:
        members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
        members = {name: info for name, info in members.items() if _ARRAY_NAME.fullmatch(name)}
        headers = {}
        for name, info in members.items():
            if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise InputError("compressed by another method than numpy's", where=name)
            with archive.open(info) as member:
                headers[name] = _npy_header(member)
        _check_headers(headers, budget)
        arrays = {}
        for name, info in members.items():
            with archive.open(info) as member:
                arrays[name] = np.lib.format.read_array(member, allow_pickle=False)
                if member.read(1):  # at the end zipfile compares the checksum
                    raise InputError("longer than its shape says", where=name)
        return arrays


def _npy_header(member: Any) -> _Header:
    version = np.lib.format.read_magic(member)
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in readers:
        raise InputError(f"array format {version}, expected 1.0 or 2.0")
    shape, _, dtype = readers[version](member)
    return _Header(str(dtype), shape, dtype.itemsize, dtype.kind in "fiu" and dtype.itemsize <= 8)


def _safetensors_arrays(path: Path, max_bytes: int) -> dict[str, NDArray]:
    import safetensors

    with parsing(".safetensors file"), safetensors.safe_open(str(path), framework="numpy") as file:
        headers = {}
        for name in filter(_ARRAY_NAME.fullmatch, file.keys()):
            tensor = file.get_slice(name)
            dtype, shape = tensor.get_dtype(), tuple(tensor.get_shape())
            is_real = re.fullmatch(r"[FIU](8|16|32|64)", dtype) is not None
            headers[name] = _Header(dtype, shape, int(dtype[1:]) // 8 if is_real else 0, is_real)
        _check_headers(headers, max_bytes)
        return {name: file.get_tensor(name) for name in headers}


# ---- arrays to Gaussians and back --------------------------------------------------------------------------------


def _assemble(
    arrays: Mapping[str, NDArray], grid: tuple[int, int, int] | None, cameras: Sequence[Camera] | None
) -> Gaussians:
    prefixes = [""]
    while f"layer{len(prefixes)}_means" in arrays:
        prefixes.append(f"layer{len(prefixes)}_")
    layers = [_layer_fields(arrays, prefix) for prefix in prefixes]
    if grid:
        layers[0] = _on_grid(layers[0], grid)
    views = [
        _layer_cameras(arrays, prefix, fields["opacities"].shape)
        for prefix, fields in zip(prefixes, layers, strict=True)
    ]
    views[0] = views[0] or tuple(cameras or ())
    origin = arrays.get("origin", np.zeros(3)).astype(np.float64)
    if origin.shape != (3,):
        raise InputError(f"shape {origin.shape}, expected (3,)", where="origin")
    means, origin = _place_means([fields["means"] for fields in layers], _centres(views[0]), origin)

    def build(n: int, extra_layers: tuple[Gaussians, ...] = ()) -> Gaussians:
        fields: dict[str, Any] = {**layers[n], "means": means[n]}
        try:
            return Gaussians(**fields, cameras=views[n], origin=origin, extra_layers=extra_layers)
        except InputError as error:
            where = f"{prefixes[n]}{error.where}" if error.where else prefixes[n].rstrip("_") or None
            raise InputError(error.message, where=where) from None

    return build(0, tuple(build(n) for n in range(1, len(layers))))


def _layer_fields(arrays: Mapping[str, NDArray], prefix: str) -> dict[str, NDArray]:
    missing = [prefix + name for name in FIELDS if prefix + name not in arrays]
    if missing:
        raise InputError(f"lacks {', '.join(missing)}; expected {', '.join(prefix + name for name in FIELDS)}")
    lead = arrays[f"{prefix}opacities"].shape
    if len(lead) not in (1, 3):
        raise InputError(f"shape {lead}, expected (V, H, W) or (N,)", where=f"{prefix}opacities")
    return {name: arrays[prefix + name] for name in FIELDS}


def _on_grid(fields: Mapping[str, NDArray], grid: tuple[int, int, int]) -> dict[str, NDArray]:
    """Arrays (N, …) as (V, H, W, …); those that already are pass as they are."""
    lead = fields["opacities"].shape
    if lead == tuple(grid):
        return dict(fields)
    if lead != (math.prod(grid),) or any(array.shape[:1] != lead for array in fields.values()):
        raise InputError(f"Gaussians of shape {lead} are not the pixels of a {'x'.join(map(str, grid))} grid")
    return {name: array.reshape(*grid, *array.shape[1:]) for name, array in fields.items()}


def _layer_cameras(arrays: Mapping[str, NDArray], prefix: str, lead: tuple[int, ...]) -> tuple[Camera, ...]:
    """The cameras of a layer of leading shape (V, H, W); () where the file holds none."""
    K, c2w = arrays.get(f"{prefix}K"), arrays.get(f"{prefix}c2w", arrays.get("c2w"))
    if K is None and (c2w is None or prefix):
        return ()
    if K is None or c2w is None:
        raise InputError("c2w without K, expected both or neither" if K is None else f"{prefix}K without c2w")
    if len(lead) != 3:
        raise InputError(f"{prefix}K and c2w, but Gaussians of shape {lead}; give their pixels with --grid V,H,W")
    for name, array, shape in ((f"{prefix}K", K, (lead[0], 3, 3)), (f"{prefix}c2w", c2w, (lead[0], 4, 4))):
        if array.shape != shape:
            raise InputError(f"shape {array.shape}, expected {shape}", where=name)
    return tuple(_camera(prefix, v, K[v], c2w[v], lead) for v in range(lead[0]))


def _camera(prefix: str, v: int, K: NDArray, c2w: NDArray, lead: tuple[int, ...]) -> Camera:
    try:
        camera = Camera(K, c2w, width=lead[2], height=lead[1])
    except InputError as error:
        raise InputError(error.message, where=f"{prefix}{error.where}[{v}]") from None
    if camera.focal < _UNIT_FOCAL_BELOW <= min(lead[1:]) / 4:
        found = f"focal length {camera.focal:.3g} px for an image of {lead[2]}x{lead[1]}"
        raise InputError(f"{found}, expected pixels (is K divided by the image's size?)", where=f"{prefix}K[{v}]")
    return camera


def _centres(cameras: Sequence[Camera]) -> NDArray:
    return np.array([camera.centre for camera in cameras]).reshape(-1, 3)


def _place_means(means: Sequence[NDArray], centres: NDArray, origin: NDArray) -> tuple[list[NDArray], NDArray]:
    """Means of all layers as float32 relative to the origin returned, which moves only where digits would be lost."""
    points = [array.reshape(-1, array.shape[-1] if array.ndim else 1) for array in means]
    shift = np.zeros(3)
    with np.errstate(over="ignore", invalid="ignore"):  # Gaussians will name what is not finite
        if all(p.shape[1] == 3 and p.size for p in points) and any(
            array.dtype == np.float64 and _loses_digits(p, centres - origin)
            for array, p in zip(means, points, strict=True)
        ):
            shift = np.mean(centres, axis=0) - origin if len(centres) else np.mean(points[0], axis=0, dtype=np.float64)
        if shift.any() and np.isfinite(shift).all():
            means, origin = [array - shift for array in means], origin + shift
        return [array.astype(np.float32) for array in means], origin


def _loses_digits(points: NDArray, centres: NDArray) -> bool:
    """Whether float32 moves one of (N, 3) float64 points too far to pass; centres (V, 3) in the same frame."""
    moved = np.abs(points - points.astype(np.float32)).max(axis=1)
    if len(centres):
        reach = np.min([np.linalg.norm(points - centre, axis=1) for centre in centres], axis=0)
    else:
        reach = np.linalg.norm(points - points.mean(axis=0), axis=1).max()
    return bool((moved > ORIGIN_TOLERANCE * reach).any())


def _arrays(gaussians: Gaussians) -> dict[str, NDArray]:
    arrays: dict[str, NDArray] = {}
    for n, layer in enumerate(gaussians.layers):
        prefix = f"layer{n}_" if n else ""
        arrays.update({prefix + name: getattr(layer, name) for name in FIELDS})
        if layer.cameras:
            c2w = np.stack([camera.c2w for camera in layer.cameras])
            arrays[f"{prefix}K"] = np.stack([camera.K for camera in layer.cameras])
            if not n or (c2w != arrays["c2w"]).any():
                arrays[f"{prefix}c2w"] = c2w
    arrays["origin"] = gaussians.origin
    return arrays


def _save_npz(path: Path, gaussians: Gaussians) -> list[str]:
    arrays = _arrays(gaussians)
    if gaussians.notes:
        arrays[NPZ_ARRAY] = npz_array(gaussians.notes)
    # As numpy.savez does, whose older versions leave the archive open when the disk is full.
    with zipfile.ZipFile(path, "w") as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)
    return []


def _save_safetensors(path: Path, gaussians: Gaussians) -> list[str]:
    from safetensors.numpy import save_file

    save_file(_arrays(gaussians), str(path), metadata=gaussians.notes.given() or None)
    return []


def _save_ply(path: Path, gaussians: Gaussians) -> list[str]:
    flat, notes = gaussians.flat(), _cut_notes(gaussians, ".ply")
    comments = ply_comments(gaussians.notes)
    means = flat.means.astype(np.float64) + flat.origin
    if flat.origin.any() and _loses_digits(means, _centres(gaussians.cameras)):
        notes.append("x, y, z written as double: too far from the world's origin for float")
        write_ply(path, flat, means, comments)
    else:
        write_ply(path, flat, means.astype(np.float32), comments)
    return notes


def _save_spz(path: Path, gaussians: Gaussians, sh_bits: tuple[int, int], version: int) -> list[str]:
    flat = gaussians.flat()
    return write_spz(path, flat, flat.means.astype(np.float64) + flat.origin, sh_bits, version)


def _save_sog(path: Path, gaussians: Gaussians) -> list[str]:
    flat, notes = gaussians.flat(), _cut_notes(gaussians, ".sog")
    means = flat.means.astype(np.float64) + flat.origin
    if flat.origin.any() and _loses_digits(means, _centres(gaussians.cameras)):
        notes.append("positions lose digits: too far from the world's origin for float; bring the scene nearer first")
    write_sog(path, flat, means.astype(np.float32))
    return notes


def _lost_notes(path: StrPath, gaussians: Gaussians) -> list[str]:
    suffix, given = Path(path).suffix.lower(), gaussians.notes.given()
    return [f"{' and '.join(given)} left out, {suffix} has no room for text"] if given and suffix not in KEEPS else []


def _cut_notes(gaussians: Gaussians, suffix: str) -> list[str]:
    degree = max(layer.degree for layer in gaussians.layers)
    if degree <= MAX_PLY_DEGREE:
        return []
    return [f"SH of degree {degree} cut to {MAX_PLY_DEGREE}, the highest that readers of {suffix} know"]
