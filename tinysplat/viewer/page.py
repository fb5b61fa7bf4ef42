"""Gaussians, cameras and photos as one self-contained HTML page.

The page holds the Gaussians as columns of the 3DGS .ply layout, positions in float32 and the rest in half precision,
as byte planes under gzip; its script makes a .ply of them in memory, which Spark draws with SH up to degree 3. The
world is turned and scaled so that the mean camera stands upright at the origin and the median depth is DEPTH.
"""

from __future__ import annotations

import base64
import gzip
import html
import importlib.resources
import json
from collections.abc import Mapping, Sequence
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.editing import cut_degree, similarity
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.quaternions import matrices_to_quats, normalize_quats, quats_to_matrices
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.images import png_bytes

DEPTH = 4.0
"""Median depth of a page's scene: sizes of controls and camera signs then suit any scene."""

_OPENGL = np.diag([1.0, -1.0, -1.0])
_MAX_DEGREE = 3  # what Spark draws
_LOGIT_MARGIN = 1e-4


def build_page(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    *,
    title: str,
    summary: str = "",
    bytes_by_class: Mapping[str, int] | None = None,
    photos: Mapping[int, NDArray] | None = None,
) -> str:
    """The page's text.

    Args:
        gaussians: any; all layers are shown.
        cameras: input views, at least one; the page opens at the first.
        title: heading, plain text.
        summary: a line under it, plain text.
        bytes_by_class: what a .tsplat file spends on what; shown when there is any.
        photos: (H, W, 3) in [0, 1] or uint8, by index into `cameras`.

    Returns:
        HTML that loads nothing from anywhere.

    Raises:
        InputError: the viewer's libraries have not been built.
    """
    moved, views = _upright(gaussians, cameras)
    columns = _columns(moved)
    packed = b"".join(_byte_planes(column) for column in columns.values())
    scene = {
        "summary": summary,
        "count": len(moved.means),
        "degree": moved.degree,
        "columns": [[name, column.itemsize] for name, column in columns.items()],
        "bytes": dict(bytes_by_class or {}),
        "target": DEPTH,
        "cameras": [_camera(camera, (photos or {}).get(i)) for i, camera in enumerate(views)],
    }
    return Template(_text("viewer.html")).substitute(
        title=html.escape(title),
        scene=json.dumps(scene).replace("<", "\\u003c"),  # so that no text can end the script element
        arrays=base64.b64encode(gzip.compress(packed, mtime=0)).decode(),
        libraries=base64.b64encode(libraries()).decode(),
        viewer=_text("viewer.js"),
    )


def libraries() -> bytes:
    """The gzipped script with three.js and Spark that every page carries.

    Raises:
        InputError: it has not been built; a source tree does not carry a megabyte of other people's code.
    """
    path = importlib.resources.files(__package__) / "libraries.js.gz"
    if not path.is_file():
        raise InputError("not built in this installation; `make viewer` builds it, with node and npm", where=str(path))
    return path.read_bytes()


def _upright(gaussians: Gaussians, cameras: Sequence[Camera]) -> tuple[Gaussians, list[Camera]]:
    """Gaussians (N,) and cameras in the page's world: y up, the mean camera at the origin looking along −z."""
    quats = matrices_to_quats(np.stack([camera.rotation.T for camera in cameras]))
    mean = quats_to_matrices(np.linalg.eigh(quats.T @ quats)[1][:, -1])  # columns are the mean camera's axes
    centre = np.mean([camera.centre for camera in cameras], axis=0)
    flat = gaussians.flat()
    z = (flat.means.astype(np.float64) + flat.origin - centre) @ mean[:, 2]
    scale = DEPTH / float(np.median(z[z > 0])) if (z > 0).any() else 1.0
    rotation = _OPENGL @ mean.T
    near_origin = Gaussians.unchecked(
        **{name: getattr(flat, name) for name in ("quats", "scales", "opacities", "sh")},
        means=(flat.means.astype(np.float64) + (flat.origin - centre)).astype(np.float32),
    )
    moved = similarity(cut_degree(near_origin, min(flat.degree, _MAX_DEGREE)), rotation, scale)
    return moved, [_moved(camera, rotation, scale, centre) for camera in cameras]


def _moved(camera: Camera, rotation: NDArray, scale: float, centre: NDArray) -> Camera:
    c2w = np.eye(4)
    c2w[:3, :3] = rotation @ camera.rotation.T
    c2w[:3, 3] = scale * rotation @ (camera.centre - centre)
    return Camera(camera.K, c2w, camera.width, camera.height)


def _camera(camera: Camera, photo: NDArray | None) -> dict[str, Any]:
    """A camera as the page takes it: OpenGL axes, skew left out."""
    pose = camera.c2w.copy()
    pose[:3, :3] = pose[:3, :3] @ _OPENGL
    K = camera.K
    entry: dict[str, Any] = {
        "width": camera.width,
        "height": camera.height,
        "intrinsics": [K[0, 0], K[1, 1], K[0, 2], K[1, 2]],
        "pose": pose.tolist(),
    }
    if photo is not None:
        entry["photo"] = "data:image/png;base64," + base64.b64encode(png_bytes(photo)).decode()
    return entry


def _columns(gaussians: Gaussians) -> dict[str, NDArray]:
    """Columns (N,) of the 3DGS .ply layout by name."""
    opacities = gaussians.opacities.clip(_LOGIT_MARGIN, 1 - _LOGIT_MARGIN).astype(np.float64)
    higher = gaussians.sh[:, 1:].swapaxes(1, 2).reshape(len(gaussians.sh), -1)
    half = {
        **{f"f_dc_{i}": gaussians.sh[:, 0, i] for i in range(3)},
        **{f"f_rest_{i}": higher[:, i] for i in range(higher.shape[1])},
        "opacity": np.log(opacities / (1 - opacities)),
        **{f"scale_{i}": np.log(np.maximum(gaussians.scales[:, i], 1e-20)) for i in range(3)},
        **{f"rot_{i}": column for i, column in enumerate(normalize_quats(gaussians.quats).T)},
    }
    positions = {axis: np.ascontiguousarray(gaussians.means[:, i], "<f4") for i, axis in enumerate("xyz")}
    return {**positions, **{name: column.clip(-6e4, 6e4).astype("<f2") for name, column in half.items()}}


def _byte_planes(column: NDArray) -> bytes:
    """All first bytes, then all second ones and so on: equal exponents stand together, which gzip likes."""
    return np.ascontiguousarray(column.view(np.uint8).reshape(len(column), -1).T).tobytes()


def _text(name: str) -> str:
    return (importlib.resources.files(__package__) / name).read_text("utf-8")
