"""`.npz` and `.safetensors`: everything that Gaussians have, exactly.

Arrays `means quats scales opacities sh` of one leading shape, (V, H, W) or (N,), and `K` (V, 3, 3) in pixels and `c2w`
(V, 4, 4) where there is one Gaussian per pixel; `origin` (3,) where means are relative to one. Layer n > 0 has the
arrays `layer{n}_means` and so on with its own `layer{n}_K`; it shares the views' `c2w` unless there is a
`layer{n}_c2w`. Of a list, `viewpoint_K`, `viewpoint_c2w` and `viewpoint_size` (P, 2), width and height, are the cameras
of its photos, where they are known. Numbers of any real type are taken; other arrays are ignored.

Trust boundary: shapes, types and total size come from headers and are checked before memory is taken; nothing is
unpickled.
"""

import json
import math
import re
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, within
from ..gaussian.gaussians import FIELDS, Gaussians
from ..gaussian.notes import MAX_BYTES, known_notes
from ..scene.cameras import Camera
from ..system.files import parsing
from ..system.jsonfields import parse_object
from .assembly import Contents, WriteOptions

MAX_EXPANSION = 100
"""Most bytes of array per byte of a compressed file beyond MIN_BUDGET. Real Gaussians reach 2, bombs 1,000."""

MIN_BUDGET = 256 << 20

NOTES = "notes"
_MAX_NOTES_BYTES = 6 * sum(MAX_BYTES.values())  # JSON's escapes take up to six bytes for one

_ARRAY_NAME = re.compile(
    r"(?:layer[1-9]\d{0,3}_)?(?:means|quats|scales|opacities|sh|K|c2w)|origin|viewpoint_(?:K|c2w|size)"
)

_Header = tuple[str, tuple[int, ...], int]
"""Of an array that a file announces: its type in words, its shape, and bytes of a number, 0 of what is none."""


def _check_headers(headers: Mapping[str, _Header], budget: int) -> None:
    for name, (kind, shape, size) in headers.items():
        if not size:
            raise InputError(f"of type {kind}, expected float16, float32 or float64", where=name)
        if len(shape) > 8 or any(n < 0 for n in shape):
            raise InputError(f"of shape {str(shape)[:60]}", where=name)
    total = sum(math.prod(shape) * size for _, shape, size in headers.values())
    if total > budget:
        raise InputError(f"arrays of {total} bytes in all, expected at most {budget} of this file")


def read_npz(path: Path, max_bytes: int) -> Contents:
    """Arrays of an .npz file, any shape and dtype, and its notes, the UTF-8 bytes of a JSON object.

    Raises:
        InputError: damaged, announcing more than `max_bytes`, or notes that are none.
    """
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
        name = f"{NOTES}.npy"
        if name not in archive.namelist():
            return arrays, {}
        if archive.getinfo(name).file_size > _MAX_NOTES_BYTES:
            raise InputError(f"more than {_MAX_NOTES_BYTES} bytes", where=NOTES)
        with archive.open(name) as member, within(NOTES):
            text = np.lib.format.read_array(member, allow_pickle=False).tobytes()
            return arrays, known_notes(parse_object(text))


def _npy_header(member: Any) -> _Header:
    version = np.lib.format.read_magic(member)
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in readers:
        raise InputError(f"array format {version}, expected 1.0 or 2.0")
    shape, _, dtype = readers[version](member)
    is_real = dtype.kind in "fiu" and dtype.itemsize <= 8
    return str(dtype), shape, dtype.itemsize if is_real else 0


def read_safetensors(path: Path, max_bytes: int) -> Contents:
    """As `read_npz`, of a .safetensors file, whose notes are metadata; ImportError if safetensors is not installed."""
    import safetensors

    with parsing(".safetensors file"), safetensors.safe_open(str(path), framework="numpy") as file:
        headers = {}
        for name in filter(_ARRAY_NAME.fullmatch, file.keys()):
            tensor = file.get_slice(name)
            dtype = tensor.get_dtype()
            bits = re.fullmatch(r"[FIU](8|16|32|64)", dtype)
            headers[name] = dtype, tuple(tensor.get_shape()), int(bits[1]) // 8 if bits else 0
        _check_headers(headers, max_bytes)
        return {name: file.get_tensor(name) for name in headers}, known_notes(file.metadata() or {})


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
    return {**arrays, **viewpoint_arrays(gaussians.viewpoints), "origin": gaussians.origin}


def viewpoint_arrays(cameras: Sequence[Camera]) -> dict[str, NDArray]:
    """P cameras of a list's photos as float64 `viewpoint_K` (P, 3, 3), `viewpoint_c2w` (P, 4, 4) and `viewpoint_size`
    (P, 2), width and height; nothing of none.
    """
    if not cameras:
        return {}
    return {
        "viewpoint_K": np.stack([camera.K for camera in cameras]),
        "viewpoint_c2w": np.stack([camera.c2w for camera in cameras]),
        "viewpoint_size": np.array([(camera.width, camera.height) for camera in cameras], np.float64),
    }


def write_npz(path: Path, gaussians: Gaussians, _: WriteOptions) -> list[str]:
    """Write all layers, cameras and notes; nothing is lost, so the list is empty."""
    arrays = _arrays(gaussians)
    if gaussians.notes:
        arrays[NOTES] = np.frombuffer(json.dumps(gaussians.notes.given()).encode(), np.uint8)
    # As numpy.savez does, whose older versions leave the archive open when the disk is full.
    with zipfile.ZipFile(path, "w") as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)
    return []


def write_safetensors(path: Path, gaussians: Gaussians, _: WriteOptions) -> list[str]:
    """As `write_npz`; ImportError if safetensors is not installed."""
    from safetensors.numpy import save_file

    save_file(_arrays(gaussians), str(path), metadata=gaussians.notes.given() or None)
    return []
