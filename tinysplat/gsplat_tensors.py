"""Gaussians and cameras as the tensors that gsplat's `rasterization()` takes."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.scene.cameras import Camera

try:
    import torch
except ImportError as error:
    raise ImportError('needs torch; pip install "tinysplat[torch]" brings it', name="torch") from error


def to_gsplat(
    gaussians: Gaussians, cameras: Sequence[Camera] | None = None, device: str | torch.device = "cpu"
) -> dict[str, Any]:
    """Keyword arguments for `gsplat.rasterization(**to_gsplat(gaussians))`.

    Args:
        gaussians: any; all layers become one list.
        cameras: where to render from, all of one size; None for the Gaussians' own.
        device: of the tensors.

    Returns:
        `means` (N, 3), `quats` (N, 4) wxyz of unit length, `scales` (N, 3), `opacities` (N,), `colors` (N, B, 3) SH
        coefficients with `sh_degree`, `viewmats` (C, 4, 4) world to camera, `Ks` (C, 3, 3), `width`, `height`; float32.
        Positions and cameras are relative to `Gaussians.origin`.

    Raises:
        InputError: no cameras, or cameras of several sizes.
    """
    cameras = gaussians.cameras if cameras is None else cameras
    sizes = {(camera.width, camera.height) for camera in cameras}
    if len(sizes) != 1:
        raise InputError(f"{len(cameras)} of {len(sizes)} sizes, expected at least one, of one size", where="cameras")
    flat = gaussians.flat()
    viewmats = []
    for camera in cameras:
        w2c = camera.w2c
        w2c[:3, 3] = -camera.rotation @ (camera.centre - gaussians.origin)
        viewmats.append(w2c)

    def tensor(array: object) -> torch.Tensor:
        return torch.from_numpy(np.array(array, np.float32)).to(device)

    width, height = sizes.pop()
    return {
        "means": tensor(flat.means),
        "quats": torch.nn.functional.normalize(tensor(flat.quats), dim=-1),
        "scales": tensor(flat.scales),
        "opacities": tensor(flat.opacities),
        "colors": tensor(flat.sh),
        "sh_degree": flat.degree,
        "viewmats": tensor(viewmats),
        "Ks": tensor([camera.K for camera in cameras]),
        "width": width,
        "height": height,
    }
