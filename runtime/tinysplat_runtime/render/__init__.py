"""Gaussians and a camera to a picture: exact EWA splatting in numpy alone, and camera paths to render along.

    image = render(gaussians, camera, size=(256, 256))
    renderer = Renderer(gaussians)                         # many frames of the same Gaussians
    frames = [renderer.render(c) for c in between(cameras, 60)]

What flows where: `prepare` (blocks of Gaussians) → `project` (what shows, 3-D to 2-D, colours) → band by band `tiles`
(who covers which 4×4 pixels, in depth order) → `composite` (front to back); or, with numba, `prepare` → `compiled`.
`near` says what of near views is drawn before everything else.
"""

from __future__ import annotations

from .paths import between, orbit
from .renderer import DEFINITION, Renderer, render

__all__ = ["DEFINITION", "Renderer", "between", "orbit", "render"]
