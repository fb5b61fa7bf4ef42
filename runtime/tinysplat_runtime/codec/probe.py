"""What an error in depth does to the picture, measured on the scene itself.

Depth is the one class whose price depends on the scene: its errors show where neighbours change places, which is a
matter of how surfaces lie and overlap. A few stripes are rendered from midway between the input views, once from the
Gaussians as they are and once with their depths changed; the mean squared difference is what the error costs. Only
Gaussians that reach a stripe take part, and their colours are evaluated for its camera once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..cameras import Camera
from ..gaussians import Gaussians
from ..render import Renderer, between
from ..render.prepare import ALPHA_MIN
from ..sh import C0, sh_basis
from ..threads import Crew

STRIPE_ROWS = 32
"""Rows of a stripe, which is as wide as the picture; fewer where the picture has fewer."""

_REACH = 3.0  # standard deviations beyond which a Gaussian's part in a stripe is not worth the look
_DILATION_PX = 3.0
_LEAST_DEPTH = 1e-6
_GOLDEN = 0.6180339887498949


class DepthProbe:
    """Measures errors of the depths of a scene's layers.

    Args:
        layers: each with cameras.
        inverse: (V, H, W) −1/z of each layer.
        stripes: how many.
        threads: stripes rendered at a time; never changes a result.
    """

    def __init__(self, layers: Sequence[Gaussians], inverse: Sequence[NDArray], stripes: int, threads: int) -> None:
        self._run = Crew(threads).map
        cameras = _stripes(layers[0].cameras, stripes)
        with np.errstate(all="ignore"):  # numbers at float32's end are no reason to fail: what is not one shows as 0
            self._shots = self._run(lambda camera: _Shot(layers, inverse, camera), cameras)

    def damage(self, errors: Sequence[NDArray]) -> float:
        """Mean squared difference of the pictures when `errors` (V, H, W) are added to −1/z of every layer."""
        with np.errstate(all="ignore"):
            return sum(self._run(lambda shot: shot.damage(errors), self._shots)) / len(self._shots)


@dataclass(frozen=True, eq=False)
class _Selection:
    """Gaussians of one layer that reach a stripe.

    Attributes:
        at: view, row and column of each, three arrays (n,).
        inverse: (n,) −1/z.
        limits: least and largest −1/z of the layer, which decoders hold depths to.
        centres: (n, 3) of their own views' cameras, relative to the layer's origin.
        arrays: themselves, (n, …) by field, with the colours that the stripe's camera sees at degree 0.
    """

    at: tuple[NDArray, ...]
    inverse: NDArray
    limits: tuple[float, float]
    centres: NDArray
    arrays: Mapping[str, NDArray]

    def moved(self, errors: NDArray) -> dict[str, NDArray]:
        """The same with errors (V, H, W) added to −1/z: places and sizes follow along the pixels' rays."""
        changed = np.clip(self.inverse + errors[self.at], *self.limits)
        ratio = (self.inverse / changed)[:, None]
        means = self.centres + (self.arrays["means"] - self.centres) * ratio
        return {**self.arrays, "means": means, "scales": self.arrays["scales"] * ratio}


class _Shot:
    """A stripe with the Gaussians that reach it, and its picture."""

    def __init__(self, layers: Sequence[Gaussians], inverse: Sequence[NDArray], camera: Camera) -> None:
        self._camera, self._origin = camera, layers[0].origin
        self._chosen = [_select(*pair, camera) for pair in zip(layers, inverse, strict=True)]
        self._picture = self._render([chosen.arrays for chosen in self._chosen])

    def damage(self, errors: Sequence[NDArray]) -> float:
        """See `DepthProbe.damage`."""
        moved = [chosen.moved(error) for chosen, error in zip(self._chosen, errors, strict=True)]
        return float(np.square(self._render(moved) - self._picture).mean(dtype=np.float64))

    def _render(self, layers: Sequence[Mapping[str, NDArray]]) -> NDArray:
        arrays = {name: np.concatenate([layer[name] for layer in layers]) for name in layers[0]}
        # Never compiled: a file's bytes are not to depend on whether numba is installed.
        renderer = Renderer(Gaussians.unchecked(**arrays, origin=self._origin), 1, compiled=False)
        return np.clip(np.nan_to_num(renderer.render(self._camera)), 0, 1)


def _stripes(cameras: Sequence[Camera], count: int) -> list[Camera]:
    """Crops of cameras midway between the views, spread over them; places follow the golden ratio over the frame."""
    middles = between(cameras, 2 * len(cameras) - 1)[1::2] if len(cameras) > 1 else list(cameras)
    stripes = []
    for n in range(count):
        camera = middles[int((n + 0.5) * len(middles) / count)]
        rows = min(STRIPE_ROWS, camera.height)
        K = camera.K.copy()
        K[1, 2] -= int((0.5 + n * _GOLDEN) % 1 * (camera.height - rows))
        stripes.append(Camera(K, camera.c2w, camera.width, rows))
    return stripes


def _select(layer: Gaussians, inverse: NDArray, stripe: Camera) -> _Selection:
    points = layer.means + (layer.origin - stripe.centre).astype(np.float32)  # (V, H, W, 3)
    x, y, z = np.moveaxis(points @ stripe.rotation.T.astype(np.float32), -1, 0)
    K, safe = stripe.K, np.maximum(z, np.float32(_LEAST_DEPTH))
    widest = np.maximum(np.maximum(layer.scales[..., 0], layer.scales[..., 1]), layer.scales[..., 2])
    reach = np.float32(_REACH * stripe.focal) * widest / safe + np.float32(_DILATION_PX)
    v = K[1, 1] * y / safe + K[1, 2]
    near = (np.abs(v - stripe.height / 2) < stripe.height / 2 + reach) & (z > _LEAST_DEPTH)
    u = (K[0, 0] * x + K[0, 1] * y) / safe + K[0, 2]
    near &= (np.abs(u - stripe.width / 2) < stripe.width / 2 + reach) & (layer.opacities >= ALPHA_MIN)
    at = np.nonzero(near)
    directions = points[at]
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    colors = np.matmul(sh_basis(directions, layer.degree)[:, None], layer.sh[at]) / np.float32(C0)
    arrays = {name: getattr(layer, name)[at] for name in ("means", "quats", "scales", "opacities")} | {"sh": colors}
    centres = np.stack([camera.centre - layer.origin for camera in layer.cameras]).astype(np.float32)
    return _Selection(at, inverse[at], (float(inverse.min()), float(inverse.max())), centres[at[0]], arrays)
