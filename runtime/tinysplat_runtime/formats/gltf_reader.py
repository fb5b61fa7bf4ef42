"""Read the points of glTF 2.0 files with the extension KHR_gaussian_splatting: bytes in, arrays out.

All splat primitives of the file's scene become one list, each where its nodes put it; quantised accessors are read,
and SPZ files by the draft KHR_gaussian_splatting_compression_spz_2. Linear colours become sRGB ones; other
kernels, projections, orders and colour spaces are refused, and so is an extension that the file requires and nobody
here knows. What is written, and the source, stand in `gltf`.

Trust boundary: accessors are held against their buffers, and these against the file, before memory is taken; buffers
lie in the file itself or beside it in its folder, never elsewhere.
"""

import base64
import binascii
import io
import operator
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, warn, within
from ..gaussian.notes import known_notes
from ..gaussian.quaternions import normalize_quats, quats_to_matrices
from ..gaussian.sh import C0, sh_basis, sh_degree, spread_directions
from ..scene.cameras import Camera
from ..scene.colours import encoded_srgb
from ..system.files import parsing, read_limited
from ..system.jsonfields import JsonObject, parse_object
from .arrays import viewpoint_arrays
from .assembly import Contents, joined
from .axes import half_turned, placed
from .gltf import BINARY_CHUNK, EXTENSION, FRAME, GLB_MAGIC, JSON_CHUNK, sh_names
from .spz import decode_spz

SRGB, LINEAR = "srgb_rec709_display", "lin_rec709_display"

_MAX_JSON_BYTES = 16 << 20
_MAX_NODES, _MAX_DEPTH = 10_000, 64
_MAX_STRIDE = 252
_MAX_NAME = 200  # letters of a buffer's file name
_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_ACCEPTED = {
    "kernel": ("ellipse",),
    "colorSpace": (SRGB, LINEAR),
    "projection": ("perspective",),
    "sortingMethod": ("cameraDistance",),
}
"""What the extension's fields may say; files by its drafts lack some."""

SPZ_EXTENSION = "KHR_gaussian_splatting_compression_spz_2"
"""A draft, by which an SPZ file in a buffer view stands in place of accessors. It speaks of other axes for what SPZ's
library unpacks; we do as CesiumJS does: SPZ's numbers are glTF's."""

_VISIBILITY = "KHR_node_visibility"
_NEEDED = re.compile(
    rf"{EXTENSION}|{SPZ_EXTENSION}|{_VISIBILITY}|KHR_mesh_quantization|(KHR|EXT)_(materials|lights|texture|xmp)_\w+"
)
"""Extensions that a file may require: known here, or of no concern to Gaussians."""

_ARRAYS: dict[str, tuple[str, tuple[int, ...]]] = {
    "POSITION": ("means", (3,)),
    f"{EXTENSION}:ROTATION": ("quats", (4,)),
    f"{EXTENSION}:SCALE": ("scales", (3,)),
    f"{EXTENSION}:OPACITY": ("opacities", ()),
}
"""Attributes beside coefficients: what they become, and a value's shape."""

_SH = re.compile(rf"{EXTENSION}:SH_DEGREE_([0-3])_COEF_([0-6])")


def read_gltf(path: Path, max_bytes: int) -> Contents:
    """Read the Gaussians of a file's scene, all of its splat primitives as one list.

    Returns:
        means (N, 3), quats (N, 4), scales (N, 3), opacities (N,) and sh (N, B, 3), linear; means float64 where a node
        moves them; of photos' cameras, as they are written, what `arrays` says; and what `asset` says about the scene.

    Raises:
        InputError: damaged, without Gaussians, compressed by another extension, turned by a node in a way that no
            Gaussian can follow, larger than `max_bytes`, or with a buffer outside its folder.
    """
    file = _File(path, max_bytes)
    meshes: dict[int, list[dict[str, NDArray]]] = {}
    parts, taken, views = [], 0, []
    for node, matrix in _nodes(file.document):
        if "camera" in node:
            views += _photo_cameras(file, node["camera"], matrix)
        if "mesh" not in node:
            continue
        index = node["mesh"]
        mesh = file.entry("meshes", index)
        if index not in meshes:
            meshes[index] = list(_mesh_parts(file, mesh))
        taken += sum(array.nbytes for arrays in meshes[index] for array in arrays.values())
        if taken > max_bytes:
            raise InputError(f"its nodes show more Gaussians than {max_bytes} bytes can hold")
        parts += [placed(arrays, matrix) for arrays in meshes[index]]
    if not parts:
        raise InputError(f"no primitive with {EXTENSION} in its visible nodes")
    return {**half_turned(joined(parts)), **viewpoint_arrays(views)}, _notes(_object(file.document.get("asset")))


def _notes(asset: JsonObject) -> JsonObject:
    known = known_notes(_object(asset.get("extras")))
    return known or ({"attribution": asset["copyright"]} if isinstance(asset.get("copyright"), str) else {})


def _object(value: object) -> JsonObject:
    return value if isinstance(value, dict) else {}


class _File:
    """A glTF document and its buffers, each read once it is asked for."""

    def __init__(self, path: Path, max_bytes: int) -> None:
        self.path, self.max_bytes = path, max_bytes
        self._buffers: dict[object, bytes] = {}
        with path.open("rb") as file:
            head = file.read(20)
            if head[:4] == GLB_MAGIC:
                if len(head) < 20:
                    raise InputError("ends within its header")
                _, version, total, length, kind = struct.unpack("<5I", head)
                size = path.stat().st_size
                if version != 2 or kind != JSON_CHUNK or total > size or length > min(size - 20, _MAX_JSON_BYTES):
                    raise InputError(f"damaged .glb header (version {version}, {total} bytes of {size})")
                text = file.read(length)
                self._binary_at: int | None = 20 + length
            else:
                text = read_limited(path, max(max_bytes, _MAX_JSON_BYTES))
                self._binary_at = None
        self.document = parse_object(text)
        required = self.document.get("extensionsRequired", [])
        for name in required if isinstance(required, list) else [required]:
            if not isinstance(name, str) or not _NEEDED.fullmatch(name):
                raise InputError(f"{ascii(name)[:60]}, which is not known here", where="extensionsRequired")

    def entry(self, kind: str, index: object) -> JsonObject:
        """Element `index` of the list `kind`."""
        entries = self.document.get(kind)
        if not isinstance(entries, list) or type(index) is not int or not 0 <= index < len(entries):
            raise InputError(f"no {kind}[{str(index)[:20]}]")
        if not isinstance(entries[index], dict):
            raise InputError("no object", where=f"{kind}[{index}]")
        return dict(entries[index])

    def accessor(self, index: object, name: str) -> NDArray:
        """(N, width) float64 values of an accessor, (N,) of a scalar one; normalised integers as glTF has them."""
        accessor = self.entry("accessors", index)
        if "sparse" in accessor or "bufferView" not in accessor:
            raise InputError("a sparse accessor, expected one with a buffer view", where=name)
        view, data = self.view(accessor["bufferView"], name)
        with within(name), parsing("accessor"), np.errstate(invalid="ignore"):  # Gaussians will name what is not finite
            kind, width = np.dtype(_TYPES[accessor["componentType"]]), _WIDTHS[accessor["type"]]
            count, start = operator.index(accessor["count"]), accessor.get("byteOffset", 0)
            stride = view.get("byteStride", kind.itemsize * width)
            if count < 1 or not kind.itemsize * width <= stride <= _MAX_STRIDE:
                raise InputError(f"{count} values, {stride} bytes apart")
            if count * width * 8 > self.max_bytes:
                raise InputError(f"{count} values, more than {self.max_bytes} bytes can hold")
            stored: NDArray = np.ndarray((count, width), kind, data, start, (stride, kind.itemsize))
            values = stored.astype(np.float64)
        if accessor.get("normalized") is True and kind.kind != "f":
            values = np.maximum(values / np.iinfo(kind).max, -1)
        return values[:, 0] if width == 1 else values

    def view(self, index: object, name: str) -> tuple[JsonObject, memoryview]:
        """A buffer view, and its bytes."""
        view = self.entry("bufferViews", index)
        if view.get("extensions"):
            raise InputError(f"compressed by {ascii(view['extensions'])[:80]}, expected plain values", where=name)
        data = self._buffer(view.get("buffer"))
        with within(name), parsing("buffer view"):
            first, length = operator.index(view.get("byteOffset", 0)), operator.index(view["byteLength"])
            if first < 0 or not 0 <= length <= len(data) - first:
                raise InputError("a buffer view beyond its buffer")
        return view, memoryview(data)[first : first + length]

    def _buffer(self, index: object) -> bytes:
        entry = self.entry("buffers", index)
        if index not in self._buffers:
            self._buffers[index] = self._embedded() if "uri" not in entry else self._at(entry["uri"])
        return self._buffers[index]

    def _embedded(self) -> bytes:
        if self._binary_at is None:
            raise InputError("a buffer without an address")
        with self.path.open("rb") as file:
            file.seek(self._binary_at)
            head = file.read(8)
            left = self.path.stat().st_size - self._binary_at - 8
            length, kind = struct.unpack("<II", head) if len(head) == 8 else (0, 0)
            if kind != BINARY_CHUNK or length > left or length > self.max_bytes:
                raise InputError("no whole binary chunk")
            return file.read(length)

    def _at(self, uri: object) -> bytes:
        if not isinstance(uri, str):
            raise InputError("a buffer's address is no text")
        if uri.startswith("data:"):
            try:
                return base64.b64decode(uri.partition(",")[2], validate=True)
            except (binascii.Error, ValueError):
                raise InputError("a buffer's base64 is damaged") from None
        name = unquote(uri)
        target = self.path.parent / name
        odd = ":" in name or name.startswith(("/", "\\")) or not name.isprintable() or len(name) > _MAX_NAME
        if odd or not target.resolve().is_relative_to(self.path.parent.resolve()):
            raise InputError(f"buffer {ascii(uri)[:60]}, expected a file in the folder of the .gltf")
        return read_limited(target, self.max_bytes)


def _photo_cameras(file: _File, index: object, matrix: NDArray) -> list[Camera]:
    """The camera of a photo at a node that stands so (4, 4) in the world; none where it is another kind of camera."""
    photo = _object(file.entry("cameras", index).get("extras"))
    if not {"K", "width", "height"} <= photo.keys():
        return []
    try:
        with np.errstate(all="ignore"):  # no camera is made of what is not finite
            lengths = np.linalg.norm(matrix[:3, :3], axis=0)
            c2w = FRAME @ (matrix / np.append(lengths, 1)) @ FRAME
        return [Camera(np.array(photo["K"], np.float64), c2w, photo["width"], photo["height"])]
    except (InputError, TypeError, ValueError, OverflowError):
        return []


def _nodes(document: JsonObject) -> Iterator[tuple[JsonObject, NDArray]]:
    """Every visible node of the scene, and where it stands in the world (4, 4)."""
    nodes, scenes = document.get("nodes"), document.get("scenes")
    if not isinstance(nodes, list) or not nodes:
        raise InputError("a glTF document without nodes, so that it shows nothing")
    if len(nodes) > _MAX_NODES:
        raise InputError(f"{len(nodes)} nodes, expected at most {_MAX_NODES}")
    with parsing("glTF scene"):
        index = document.get("scene", 0)
        roots = scenes[index]["nodes"] if scenes else range(len(nodes))
        todo = [(int(root), np.eye(4), 0) for root in roots]
        visits = 0
        while todo:
            i, parent, depth = todo.pop(0)
            visits += 1
            if visits > _MAX_NODES or depth > _MAX_DEPTH:
                raise InputError("its nodes have no end")
            extensions = _object(nodes[i].get("extensions"))
            if _object(extensions.get(_VISIBILITY)).get("visible") is False:  # nor what is below it
                continue
            matrix = parent @ _local_matrix(nodes[i])
            todo += [(int(child), matrix, depth + 1) for child in nodes[i].get("children", ())]
            yield nodes[i], matrix


def _local_matrix(node: JsonObject) -> NDArray:
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    x, y, z, w = np.array(node.get("rotation", (0, 0, 0, 1)), np.float64)
    matrix[:3, :3] = quats_to_matrices(normalize_quats(np.array([w, x, y, z]))) * np.array(
        node.get("scale", (1, 1, 1)), np.float64
    )
    matrix[:3, 3] = node.get("translation", (0, 0, 0))
    return matrix


def _mesh_parts(file: _File, mesh: JsonObject) -> Iterator[dict[str, NDArray]]:
    primitives = mesh.get("primitives")
    for primitive in primitives if isinstance(primitives, list) else ():
        extensions = _object(_object(primitive).get("extensions"))
        if EXTENSION not in extensions:
            continue
        stated = _object(extensions[EXTENSION])
        for field, accepted in _ACCEPTED.items():
            if (said := stated.get(field, accepted[0])) not in accepted:
                fault = f"{ascii(said)[:60]}, expected {' or '.join(accepted)}"
                raise InputError(fault, where=f"{EXTENSION}.{field}")
        inner = stated.get("extensions")
        if isinstance(inner, dict) and list(inner) == [SPZ_EXTENSION]:
            arrays = _spz_arrays(file, primitive, _object(inner[SPZ_EXTENSION]).get("bufferView"))
        elif inner:
            raise InputError(f"compressed by {ascii(inner)[:80]}, expected plain {EXTENSION} or {SPZ_EXTENSION}")
        else:
            arrays = _primitive_arrays(file, _object(primitive.get("attributes")))
        if stated.get("colorSpace") == LINEAR:
            text = "colours become sRGB's; translucent Gaussians blend otherwise than in linear light"
            warn(f"{file.path}: {LINEAR}: {text}")
            arrays["sh"] = srgb_of_linear(arrays["sh"])
        yield arrays


def _spz_arrays(file: _File, primitive: JsonObject, view: object) -> dict[str, NDArray]:
    _, arrays = decode_spz(io.BytesIO(file.view(view, SPZ_EXTENSION)[1]), file.max_bytes)
    index = _object(primitive.get("attributes")).get("POSITION")
    stated = file.entry("accessors", index).get("count")
    if stated != len(arrays["means"]):
        raise InputError(f"{str(stated)[:20]} positions, but {len(arrays['means'])} in its SPZ", where="POSITION")
    return arrays


def _primitive_arrays(file: _File, attributes: JsonObject) -> dict[str, NDArray]:
    degree = max((int(match[1]) for match in map(_SH.fullmatch, attributes) if match), default=0)
    terms = sh_names(degree)
    if lacking := [name for name in (*_ARRAYS, *terms) if name not in attributes]:
        raise InputError(f"lacks {', '.join(lacking[:5])}")
    columns: dict[str, NDArray] = {}
    for name in (*_ARRAYS, *terms):
        array = columns[name] = file.accessor(attributes[name], name)
        _, shape = _ARRAYS.get(name, ("", (3,)))
        if array.shape != (count := len(columns["POSITION"]), *shape):
            raise InputError(f"shape {array.shape} beside {count} positions", where=name)
    arrays = {field: columns[name] for name, (field, _) in _ARRAYS.items()}
    arrays["quats"] = np.roll(arrays["quats"], 1, axis=1)  # xyzw to wxyz
    return {**arrays, "sh": np.stack([columns[name] for name in terms], axis=1)}


_DIRECTIONS = 64  # of degree 3 and below, well spread ones tell all
_ROWS = 1 << 14  # Gaussians at a time


def srgb_of_linear(sh: NDArray) -> NDArray:
    """Coefficients (N, B, 3) float64 whose colours are about those of linear BT.709 ones, encoded as sRGB.

    Exact at degree 0. Above, they are fitted to the encoded colours of many directions, which are no polynomial.
    """
    sh = sh.astype(np.float64)
    if sh.shape[1] == 1:
        return (encoded_srgb((0.5 + C0 * sh).clip(0)) - 0.5) / C0
    basis = sh_basis(spread_directions(_DIRECTIONS), sh_degree(sh.shape[1]))
    back = np.linalg.pinv(basis)
    fitted = np.empty_like(sh)
    for start in range(0, len(sh), _ROWS):
        rows = slice(start, start + _ROWS)
        fitted[rows] = back @ (encoded_srgb((0.5 + basis @ sh[rows]).clip(0)) - 0.5)
    return fitted
