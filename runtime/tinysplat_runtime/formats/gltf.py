"""Points in glTF 2.0 with the extension KHR_gaussian_splatting, as `.glb` and `.gltf`.

A primitive of mode POINTS with an attribute per coefficient: POSITION, ROTATION (xyzw), SCALE (linear), OPACITY and
SH_DEGREE_l_COEF_n, the last four with the extension's prefix. y is up (`axes`). What is written keeps the scene's
cameras as glTF cameras, its origin as the node's translation, and its notes in `asset`; a picture's principal point
and skew, which glTF has no room for, are in a camera's extras. Source: the extension's README, github.com/KhronosGroup.

Written here and not by a package because those at hand check no length before they take memory. `gltf_reader` reads.
"""

import base64
import json
import math
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian.gaussians import Gaussians
from ..gaussian.notes import Notes
from ..gaussian.quaternions import normalize_quats
from ..gaussian.sh import C0
from ..scene.cameras import Camera
from ..scene.colours import decoded_srgb
from ..system.jsonfields import JsonObject
from .assembly import WriteOptions, cut_degree_note
from .axes import HALF_TURN, QUAT_SIGNS, sh_signs

EXTENSION = "KHR_gaussian_splatting"
MAX_GLTF_DEGREE = 3
COLOUR_SPACE = "srgb_rec709_display"
GLB_MAGIC, JSON_CHUNK, BINARY_CHUNK = b"glTF", 0x4E4F534A, 0x004E4942

FRAME = np.diag([1.0, -1.0, -1.0, 1.0])
"""The half turn of world and camera axes alike."""

_FLOAT, _UNSIGNED_SHORT, _ARRAY_BUFFER = 5126, 5123, 34962
_KERNEL = {
    "kernel": "ellipse",
    "colorSpace": COLOUR_SPACE,
    "projection": "perspective",
    "sortingMethod": "cameraDistance",
}


def write_gltf(path: Path, gaussians: Gaussians, _: WriteOptions) -> list[str]:
    """Write Gaussians as `.glb`, or as `.gltf` with its buffer inside.

    Args:
        path: its suffix chooses.
        gaussians: of any shape; SH above degree 3 is left out.

    Returns:
        What readers may not see, one line each.

    Raises:
        InputError: more than a .glb can hold.
    """
    gaussians = gaussians.flat()
    cameras = gaussians.viewpoints
    arrays = _attributes(gaussians)
    document = _document(gaussians, arrays, cameras)
    if path.suffix.lower() == ".gltf":
        data = b"".join(map(_padded, arrays.values()))
        uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
        document["buffers"] = [{"byteLength": len(data), "uri": uri}]
        path.write_text(json.dumps(document), encoding="utf-8")
    else:
        _write_glb(path, document, tuple(arrays.values()))
    return cut_degree_note(gaussians, MAX_GLTF_DEGREE, EXTENSION) + _losses(gaussians, cameras)


def _accessors(arrays: Mapping[str, NDArray]) -> list[JsonObject]:
    """What JSON says of arrays, a buffer view each."""
    accessors = []
    for i, (name, array) in enumerate(arrays.items()):
        accessor: JsonObject = {"bufferView": i, "count": len(array), "componentType": _FLOAT}
        accessor["type"] = "SCALAR" if array.ndim == 1 else f"VEC{array.shape[1]}"
        if name == "POSITION":
            accessor |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        if array.dtype == np.uint16:
            accessor |= {"componentType": _UNSIGNED_SHORT, "normalized": True}
        accessors.append(accessor)
    return accessors


def sh_names(degree: int) -> list[str]:
    """Attributes of the SH coefficients up to a degree."""
    return [f"{EXTENSION}:SH_DEGREE_{band}_COEF_{n}" for band in range(degree + 1) for n in range(2 * band + 1)]


def _attributes(gaussians: Gaussians) -> dict[str, NDArray]:
    """Arrays by the name of their attribute, in the extension's axes."""
    degree = min(gaussians.degree, MAX_GLTF_DEGREE)
    quats = normalize_quats(gaussians.quats.astype(np.float64)) * QUAT_SIGNS
    sh = gaussians.sh[:, : (degree + 1) ** 2] * sh_signs(degree)[:, None]  # (N, B, 3)
    colour = (0.5 + C0 * gaussians.sh[:, 0]).clip(0, 1)
    fallback = np.concatenate([decoded_srgb(colour), gaussians.opacities[:, None]], axis=1)
    arrays = {
        "POSITION": gaussians.means * HALF_TURN,
        f"{EXTENSION}:ROTATION": np.roll(quats, -1, axis=1),
        f"{EXTENSION}:SCALE": gaussians.scales,
        f"{EXTENSION}:OPACITY": gaussians.opacities,
    }
    arrays |= {name: sh[:, i] for i, name in enumerate(sh_names(degree))}
    arrays = {name: np.ascontiguousarray(array, "<f4") for name, array in arrays.items()}
    return {**arrays, "COLOR_0": np.rint(fallback * 65535).astype("<u2")}


def _document(gaussians: Gaussians, arrays: Mapping[str, NDArray], cameras: Sequence[Camera]) -> JsonObject:
    """The JSON, but for a buffer's address."""
    views: list[JsonObject] = []
    offset = 0
    for chunk in arrays.values():
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": chunk.nbytes, "target": _ARRAY_BUFFER})
        offset += -(-chunk.nbytes // 4) * 4
    primitive = {
        "attributes": {name: i for i, name in enumerate(arrays)},
        "mode": 0,
        "extensions": {EXTENSION: _KERNEL},
    }
    nodes: list[JsonObject] = [{"name": "gaussians", "mesh": 0}]
    if gaussians.origin.any():
        nodes[0]["translation"] = (gaussians.origin * HALF_TURN).tolist()
    nodes += [_camera_node(v, camera) for v, camera in enumerate(cameras)]
    document: JsonObject = {
        "asset": _asset(gaussians.notes),
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": list(range(len(nodes)))}],
        "nodes": nodes,
        "meshes": [{"primitives": [primitive]}],
        "accessors": _accessors(arrays),
        "bufferViews": views,
        "buffers": [{"byteLength": offset}],
    }
    if cameras:
        document["cameras"] = [_perspective(camera) for camera in cameras]
    return document


def _asset(notes: Notes) -> JsonObject:
    asset: JsonObject = {"version": "2.0", "generator": "tinysplat"}
    said = [text for text in (notes.attribution, notes.licence) if text]
    if said:
        asset["copyright"] = "; ".join(said)
    return {**asset, "extras": notes.given()} if notes else asset


def _camera_node(v: int, camera: Camera) -> JsonObject:
    """glTF's cameras look along −z with y up, which is the half turn of OpenCV's, as the world's is."""
    matrix = FRAME @ camera.c2w @ FRAME
    return {"name": f"view {v}", "camera": v, "matrix": matrix.T.ravel().tolist()}  # column by column


def _perspective(camera: Camera) -> JsonObject:
    fx, fy = float(camera.K[0, 0]), float(camera.K[1, 1])
    perspective = {
        "yfov": 2 * math.atan(camera.height / (2 * fy)),
        "aspectRatio": camera.width * fy / (camera.height * fx),
        "znear": 0.01,
    }
    extras = {"K": camera.K.tolist(), "width": camera.width, "height": camera.height}
    return {"type": "perspective", "perspective": perspective, "extras": extras}


def _write_glb(path: Path, document: JsonObject, chunks: Sequence[NDArray]) -> None:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    size = sum(-(-chunk.nbytes // 4) * 4 for chunk in chunks)
    total = 12 + 8 + len(text) + 8 + size
    if total >= 1 << 32:
        raise InputError(f"{total} bytes, .glb holds less than {1 << 32}")
    with path.open("wb") as file:
        file.write(GLB_MAGIC + struct.pack("<II", 2, total))
        file.write(struct.pack("<II", len(text), JSON_CHUNK) + text + struct.pack("<II", size, BINARY_CHUNK))
        for chunk in chunks:
            file.write(_padded(chunk))


def _padded(array: NDArray) -> bytes:
    data = array.tobytes()
    return data + bytes(-len(data) % 4)


def _losses(gaussians: Gaussians, cameras: Sequence[Camera]) -> list[str]:
    notes = []
    if gaussians.notes.unit not in ("", "metre", "meter", "m"):
        notes.append(f"lengths are in {gaussians.notes.unit}, which glTF takes for metres; --scale converts them")
    off = [np.abs(camera.K[:2, 2] - np.array([camera.width, camera.height]) / 2).max() for camera in cameras]
    shifted = sum(far > 0.5 or camera.K[0, 1] != 0 for far, camera in zip(off, cameras, strict=True))
    if shifted:
        notes.append(f"{shifted} cameras look beside the middle of their picture: kept in extras alone")
    return notes
