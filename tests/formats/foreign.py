"""Gaussian files read and written by gaussforge, which is built on the formats' own libraries.

from formats.foreign import foreign_arrays, foreign_bytes, on_order_of
"""

import contextlib
import json
import os
import struct
from collections.abc import Iterator
from typing import Any

import gaussforge
import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.gaussian.quaternions import normalize_quats


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """gaussforge prints on the process' standard output."""
    saved, sink = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, 1)
    try:
        yield
    finally:
        os.dup2(saved, 1)
        os.close(saved)
        os.close(sink)


def foreign_model(data: bytes, kind: str) -> dict[str, NDArray]:
    """The arrays that gaussforge finds in a file, by its own names; `sh` with degree 0 in front."""
    with quiet():
        model = gaussforge.GaussForge().read(data, kind)["data"]
    widths = {"positions": 3, "scales": 3, "rotations": 4, "alphas": 1, "colors": 3}
    arrays = {name: np.frombuffer(model[name], np.float32).reshape(-1, width) for name, width in widths.items()}
    higher = np.frombuffer(model["sh"] or b"", np.float32).reshape(model["numPoints"], -1, 3)
    return {**arrays, "sh": np.concatenate([arrays["colors"][:, None], higher], axis=1)}


def foreign_arrays(data: bytes, kind: str) -> dict[str, NDArray]:
    """Fields of `Gaussians` that gaussforge finds in a file of the .ply family of axes."""
    model = foreign_model(data, kind)
    return {
        "means": model["positions"],
        "quats": model["rotations"],
        "scales": np.exp(model["scales"]),
        "opacities": 1 / (1 + np.exp(-model["alphas"][:, 0].astype(np.float64))),
        "sh": model["sh"],
    }


def foreign_bytes(gaussians: Gaussians, kind: str, **options: Any) -> bytes:
    """A file of (N,) Gaussians by gaussforge, opacities strictly between 0 and 1."""

    def octets(array: NDArray) -> bytes:
        return np.ascontiguousarray(array, np.float32).tobytes()

    model: dict[str, Any] = {
        "numPoints": len(gaussians.means),
        "positions": octets(gaussians.means),
        "scales": octets(np.log(gaussians.scales)),
        "rotations": octets(normalize_quats(gaussians.quats)),
        "alphas": octets(np.log(gaussians.opacities / (1 - gaussians.opacities))),
        "colors": octets(gaussians.sh[:, 0]),
        "sh": octets(gaussians.sh[:, 1:]),
        "extras": {},
        "meta": {"shDegree": gaussians.degree, "sourceFormat": "ply"},
    }
    with quiet():
        return bytes(gaussforge.GaussForge().write(model, kind, **options)["data"])


def on_order_of(made: Gaussians, read: Gaussians) -> Gaussians:
    """The Gaussians of `made` in the order of `read`, by the nearest mean: files may change the order."""
    index = ((read.means[:, None] - made.means) ** 2).sum(axis=2).argmin(axis=1)
    assert len(set(index)) == len(made.means)
    return Gaussians(**{name: getattr(made, name)[index] for name in FIELDS})


def glb_of_spz(spz: bytes, count: int, translation: tuple[float, ...] = (0, 0, 0), **asset: Any) -> bytes:
    """A .glb with a file of so many Gaussians inside, by the draft KHR_gaussian_splatting_compression_spz_2."""
    names = ["KHR_gaussian_splatting", "KHR_gaussian_splatting_compression_spz_2"]
    inside = {"kernel": "ellipse", "colorSpace": "srgb_rec709_display", "extensions": {names[1]: {"bufferView": 0}}}
    primitive = {"mode": 0, "attributes": {"POSITION": 0}, "extensions": {names[0]: inside}}
    document = {
        "asset": {"version": "2.0", **asset},
        "extensionsUsed": names,
        "extensionsRequired": names,
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "translation": translation}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": [{"componentType": 5126, "count": count, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": len(spz)}],
        "buffers": [{"byteLength": len(spz)}],
    }
    text = json.dumps(document).encode()
    text, spz = text + b" " * (-len(text) % 4), spz + bytes(-len(spz) % 4)
    head = struct.pack("<4sIIII", b"glTF", 2, 28 + len(text) + len(spz), len(text), 0x4E4F534A)
    return head + text + struct.pack("<II", len(spz), 0x004E4942) + spz
