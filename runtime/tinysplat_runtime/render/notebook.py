"""How Gaussians show themselves in a notebook: a picture from their first camera, and a few figures beside it."""

import base64
from html import escape

from ..gaussian.gaussians import Gaussians
from ..scene.pictures import png_bytes
from .renderer import render

LONGEST_SIDE = 384
"""Pixels; a notebook keeps every picture it shows."""


def png(gaussians: Gaussians) -> bytes | None:
    """The first view or photo as a PNG file's bytes; None for Gaussians without cameras."""
    cameras = gaussians.cameras or gaussians.viewpoints
    if not cameras:
        return None
    camera = cameras[0]
    scale = min(LONGEST_SIDE / max(camera.width, camera.height), 1.0)
    size = max(round(camera.height * scale), 1), max(round(camera.width * scale), 1)
    return png_bytes(render(gaussians, camera, size))


def html(gaussians: Gaussians) -> str:
    """A table of what the Gaussians are, and the first view where there is one."""
    rows = {
        "Gaussians": f"{gaussians.count:,}",
        "SH degree": str(gaussians.degree),
        "layers": " + ".join("x".join(map(str, layer.opacities.shape)) for layer in gaussians.layers),
        "memory": f"{gaussians.nbytes / 1e6:.1f} MB",
    }
    table = "".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows.items())
    picture = png(gaussians)
    image = f'<img alt="view 0" src="data:image/png;base64,{base64.b64encode(picture).decode()}">' if picture else ""
    return f'<div style="display:flex;gap:1em;align-items:start">{image}<table>{table}</table></div>'
