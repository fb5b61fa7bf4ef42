"""gsplat's definition as a peer of the rasteriser: its torch projection and colours on the CPU, blended densely here.

gsplat's own blending exists as a CUDA kernel alone, so its alphas are blended by plain torch: every Gaussian at every
pixel, sorted by depth, with 3DGS's thresholds. Slow, and a second opinion on projection, conics, SH and blending.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import DEFINITION, Renderer
from tinysplat_runtime.scene.cameras import Camera

from ..reference.pixels import ALPHA_MAX, ALPHA_MIN, TRANSMITTANCE_MIN, choose_pixels, render_pixels
from .judge import pixel_errors
from .rasteriser import LEAST_PIXELS, PIXEL_SHARE
from .timing import Effort, Figures, Row, Stage, Variant, measure

STAGE = "torch rasteriser"

_CHUNK = 512


def torch_peer_rows(gaussians: Gaussians, size: int, threads: int, effort: Effort) -> list[Row]:
    """Ours and gsplat's at one size, both against float64; a row that says so where gsplat is missing."""
    camera = gaussians.cameras[0].resized(size, size)
    case = f"{gaussians.count:,} Gaussians at {size}×{size}"
    pixels = choose_pixels(size, size, PIXEL_SHARE, LEAST_PIXELS)
    truth = render_pixels(gaussians, camera, pixels).clip(0, 1)

    def figures(image: NDArray) -> Figures:
        return pixel_errors(image.reshape(-1, 3)[pixels], truth)

    renderer = Renderer(gaussians, threads, **DEFINITION)
    variants = [Variant("ours, exact", lambda: renderer.render(camera), figures, threads=threads)]
    missing = []
    name = "gsplat's projection and SH, dense blending"
    try:
        variants.append(Variant(name, gsplat_frame(gaussians, camera, threads), figures, threads=threads))
    except ImportError as error:
        missing = [Row(STAGE, case, name, threads, note=f"no {error.name}: pip install gsplat")]
    return [*measure(Stage(STAGE, case, variants), effort), *missing]


def gsplat_frame(gaussians: Gaussians, camera: Camera, threads: int) -> Callable[[], NDArray]:
    """A call that renders a frame (H, W, 3) with gsplat's torch functions; ImportError where it is not installed."""
    import torch

    impl: Any = importlib.import_module("gsplat.cuda._torch_impl")
    flat = gaussians.flat()
    means, quats, scales, opacities, sh = (
        torch.from_numpy(np.ascontiguousarray(array))
        for array in (flat.means + np.float32(flat.origin), flat.quats, flat.scales, flat.opacities, flat.sh)
    )
    view = torch.from_numpy(camera.w2c.astype(np.float32))[None]
    K = torch.from_numpy(camera.K.astype(np.float32))[None]
    centre = torch.from_numpy(camera.centre.astype(np.float32))

    def frame() -> NDArray:
        torch.set_num_threads(threads)
        with torch.inference_mode():
            covariances, _ = impl._quat_scale_to_covar_preci(quats, scales, True, False)
            radii, centres, depths, conics, _ = impl._fully_fused_projection(
                means, covariances, view, K, camera.width, camera.height
            )
            colours = (impl._spherical_harmonics(flat.degree, means - centre, sh) + 0.5).clamp_min(0)
            order = torch.argsort(torch.where(radii[0].amin(dim=-1) > 0, depths[0], torch.inf), stable=True)
            order = order[radii[0].amin(dim=-1)[order] > 0]
            picture = _blend(centres[0, order], conics[0, order], opacities[order], colours[order], camera)
        return picture.clamp(0, 1).numpy()

    return frame


def _blend(centres: Any, conics: Any, opacities: Any, colours: Any, camera: Camera) -> Any:
    """(H, W, 3) of Gaussians in depth order, every one at every pixel."""
    import torch

    x, y = torch.meshgrid(torch.arange(camera.width) + 0.5, torch.arange(camera.height) + 0.5, indexing="xy")
    pixels = torch.stack([x, y], dim=-1).reshape(-1, 2)
    rows = []
    for part in pixels.split(_CHUNK):
        d = part[:, None] - centres[None]  # (P, N, 2)
        power = 0.5 * (conics[:, 0] * d[..., 0] ** 2 + conics[:, 2] * d[..., 1] ** 2) + conics[:, 1] * d.prod(dim=-1)
        alpha = (opacities * torch.exp(-power)).clamp_max(ALPHA_MAX)
        alpha = torch.where((power >= 0) & (alpha >= ALPHA_MIN), alpha, 0.0)
        left = torch.cumprod(1 - alpha, dim=1)
        before = torch.cat([torch.ones_like(left[:, :1]), left[:, :-1]], dim=1)
        weights = torch.where(left >= TRANSMITTANCE_MIN, alpha * before, 0.0)
        rows.append(weights @ colours)
    return torch.cat(rows).reshape(camera.height, camera.width, 3)
