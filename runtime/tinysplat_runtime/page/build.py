"""Gaussians, cameras and photos as one self-contained HTML page.

The page keeps the world's axes. Its origin is the mean camera centre, and its unit makes the median depth DEPTH, so
that what splats.js does in float32 does not depend on where a scene lies and how large it is.
"""

from __future__ import annotations

import base64
import html
import importlib.resources
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..gaussian.gaussians import Gaussians
from ..render.paths import outside
from ..render.renderer import NEAR_PLANE
from ..scene.cameras import Camera
from ..scene.images import jpeg_bytes
from .bundle import bundle
from .columns import OTHER_LAYERS, Cloud, pack

DEPTH = 4.0
"""Median depth of a page's scene, page units."""

KNEE = DEPTH / 16
"""Within this distance of the page's origin a mean's step is constant."""

HELP = (
    "Drag to look around, two fingers or the right button to slide, wheel or pinch to come closer. Keys: arrows, plus, "
    "minus, Home to return. A double click leads back. Going anywhere: W A S D Q E walk, and a double click says where "
    "to turn about."
)


@dataclass(frozen=True)
class Page:
    """A page's text but for the Gaussians, and those.

    Attributes:
        template: page.html.
        fields: what stands in its places but for the data.
        data: the packed Gaussians, which a server gives as `data` beside the page.
    """

    template: Template
    fields: dict[str, str]
    data: bytes

    def served(self) -> str:
        """HTML that fetches `data` from beside it."""
        return self.template.substitute(self.fields, data="")

    def whole(self) -> str:
        """HTML that loads nothing from anywhere."""
        return self.template.substitute(self.fields, data=base64.b64encode(self.data).decode())


def build_page(
    gaussians: Gaussians,
    cameras: Sequence[Camera],
    *,
    title: str,
    caption: str = "",
    summary: str = "",
    bytes_by_class: Mapping[str, int] | None = None,
    photos: Mapping[int, NDArray] | None = None,
) -> Page:
    """The page of a scene.

    Args:
        gaussians: any; all layers are shown.
        cameras: input views; without any the page has no views to choose from and opens in front of the scene.
        title: heading, plain text.
        caption: a few words beside it, plain text.
        summary: a line among the details, plain text.
        bytes_by_class: what a .tsplat file spends on what; shown when there is any.
        photos: (H, W, 3) in [0, 1] or uint8, by index into `cameras`.
    """
    views = list(cameras) or [outside(gaussians)]
    flat, centre = gaussians.flat(), np.mean([camera.centre for camera in views], axis=0)
    means = flat.means.astype(np.float64) + (flat.origin - centre)
    depths = (means - (views[0].centre - centre)) @ views[0].rotation[2]
    seen = depths[(depths > 0) & (flat.opacities > 0.1)]
    scale = DEPTH / float(np.median(seen)) if seen.size else 1.0
    described, data = pack(Cloud(flat, means * scale, scale, KNEE, *_seen_by_own(gaussians, scale)))
    up = -np.mean([camera.rotation[1] for camera in views], axis=0)
    scene = {
        **described,
        "caption": caption,
        "summary": summary,
        "bytes": dict(bytes_by_class or {}),
        "hasCameras": bool(cameras),
        "views": [_view(camera, centre, scale, (photos or {}).get(i)) for i, camera in enumerate(views)],
        "up": (up / max(float(np.linalg.norm(up)), 1e-9)).tolist(),
        "reach": DEPTH,
        "nearPlane": NEAR_PLANE * scale,
    }
    fields = {
        "title": html.escape(title),
        "style": _text("style.css"),
        "scene": json.dumps(scene).replace("<", "\\u003c"),  # so that no text can end the script element
        "help": html.escape(HELP),
        "scripts": bundle("page.js", _text),
    }
    return Page(Template(_text("page.html")), fields, data)


def _seen_by_own(gaussians: Gaussians, scale: float) -> tuple[NDArray | None, NDArray | None]:
    """Each Gaussian's view (N,), and its mean's pixel and depth there (N, 3), in `flat`'s order; None without views."""
    if not gaussians.is_per_pixel or len(gaussians.cameras) > OTHER_LAYERS:
        return None, None
    views, local = [], []
    for n, layer in enumerate(gaussians.layers):
        for v, camera in enumerate(gaussians.cameras):
            rays = layer.means[v].reshape(-1, 3).astype(np.float64) + (layer.origin - camera.centre)
            point = rays @ (camera.K @ camera.rotation).T
            with np.errstate(divide="ignore", invalid="ignore"):
                local.append(np.column_stack([point[:, :2] / point[:, 2:], scale * point[:, 2]]))
            views.append(np.full(len(rays), v + (OTHER_LAYERS if n else 0)))
    return np.concatenate(views), np.concatenate(local)


def _view(camera: Camera, centre: NDArray, scale: float, photo: NDArray | None) -> dict[str, Any]:
    """A camera as the page takes it: page units, rows of its rotation right, down and forward."""
    K = camera.K
    entry: dict[str, Any] = {
        "width": camera.width,
        "height": camera.height,
        "K": [K[0, 0], K[0, 1], K[1, 1], K[0, 2], K[1, 2]],
        "rotation": camera.rotation.tolist(),
        "position": (scale * (camera.centre - centre)).tolist(),
    }
    if photo is not None:
        entry["photo"] = "data:image/jpeg;base64," + base64.b64encode(jpeg_bytes(photo)).decode()
    return entry


def _text(name: str) -> str:
    return (importlib.resources.files(__package__) / name).read_text("utf-8")
