"""What an error in depth or opacity does to the picture, measured on the scene itself.

They are the classes whose price depends on the scene: depth's errors show where neighbours change places, opacity's
where many faint surfaces lie behind each other. A few stripes are rendered from midway between the input views, once
from the Gaussians as they are and once with them changed; the mean squared difference is what the error costs. Only
Gaussians that reach a stripe take part, of many views those of the nearest, and their colours are evaluated for its
camera once.

A stripe shows more or less of what such errors do than the picture that it is of, mostly by its contrast. That is
known everywhere, so the difference is scaled by it (a ratio estimate): on ten scenes two stripes then told what
depth does to whole pictures to between 0.86 and 1.30 of it, without to between 0.52 and 1.51.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ...gaussian.gaussians import Gaussians
from ...gaussian.sh import C0, sh_basis
from ...render import DEFINITION, Renderer, between
from ...render.prepare import ALPHA_MIN
from ...scene.cameras import Camera
from ...scene.neighbours import NEAR, nearest_views
from ...system.threads import Crew
from ..quantise import extent, mean_of
from .blocks import SIDE

STRIPE_ROWS = 32
"""Rows of a stripe, which is as wide as the picture; fewer where the picture has fewer."""

FEW = 6
"""Views that a network takes at once: stripes of more are drawn from the nearest alone."""

_REACH = 3.0  # standard deviations beyond which a Gaussian's part in a stripe is not worth the look
_DILATION_PX = 3.0
_LEAST_DEPTH = 1e-6
_PIXELS_AT_A_TIME = 1 << 16
_GOLDEN = 0.6180339887498949

_LARGEST_SHARE = 4.0
"""Most that contrast scales a measured damage, either way: of a stripe without any it says nothing."""


class Probe:
    """Measures what errors of depth and opacity of a scene's layers do to its pictures.

    Args:
        layers: each with cameras.
        inverse: (V, H, W) −1/z of each layer.
        shown: (V, H, W) `contrast` of each layer.
        stripes: how many.
        threads: stripes rendered at a time; never changes a result.

    Attributes:
        reached: of each layer, (V, ceil(H / 8), ceil(W / 8)) bool: the blocks of pixels whose errors count.
    """

    def __init__(
        self,
        layers: Sequence[Gaussians],
        inverse: Sequence[NDArray],
        shown: Sequence[NDArray],
        stripes: int,
        threads: int,
    ) -> None:
        self._run = Crew(threads).map
        chosen = _stripes(layers[0].cameras, stripes, -1 / mean_of(inverse[0]))
        with np.errstate(all="ignore"):  # numbers at float32's end are no reason to fail: what is not one shows as 0
            self._shots = self._run(lambda stripe: _Shot(layers, inverse, shown, stripe), chosen)
        here, whole = (sum(shot.shown[i] for shot in self._shots) for i in range(2))
        share = whole / here if here > 0 else 1.0
        self.reached = [np.zeros((len(p), -(-p.shape[1] // SIDE), -(-p.shape[2] // SIDE)), bool) for p in inverse]
        for shot in self._shots:
            for reached, chosen_there in zip(self.reached, shot.chosen, strict=True):
                view, row, column = chosen_there.at
                reached[view, row // SIDE, column // SIDE] = True
        self._share = min(max(share, 1 / _LARGEST_SHARE), _LARGEST_SHARE) / len(self._shots)

    def damage(self, errors: Sequence[NDArray]) -> float:
        """Mean squared difference of the pictures with `errors`, (V, H, W) float32, added to −1/z of every layer."""
        return self._damage(errors, _Selection.moved)

    def opacity_damage(self, errors: Sequence[NDArray]) -> float:
        """The same with `errors`, (V, H, W) float32, added to every layer's opacities."""
        return self._damage(errors, _Selection.faded)

    def _damage(self, errors: Sequence[NDArray], change: _Change) -> float:
        with np.errstate(all="ignore"):
            return self._share * sum(self._run(lambda shot: shot.damage(errors, change), self._shots))


@dataclass(frozen=True, eq=False)
class _Stripe:
    """Rows of a picture.

    Attributes:
        camera: of the stripe alone.
        first: row of the whole picture that it begins at.
        height: rows of the whole picture.
        views: those whose Gaussians show in it.
    """

    camera: Camera
    first: int
    height: int
    views: Sequence[int]


@dataclass(frozen=True, eq=False)
class _Selection:
    """Gaussians of one layer that reach a stripe.

    Attributes:
        at: view, row and column of each, three arrays (n,).
        inverse: (n,) −1/z.
        limits: least and largest −1/z of the layer, which decoders hold depths to.
        centres: (n, 3) of their own views' cameras, relative to the layer's origin.
        arrays: themselves, (n, …) by field, with the colours that the stripe's camera sees at degree 0.
        shown: `contrast` per pixel of the stripe, and per pixel of the whole picture.
    """

    at: tuple[NDArray, ...]
    inverse: NDArray
    limits: tuple[float, float]
    centres: NDArray
    arrays: Mapping[str, NDArray]
    shown: tuple[float, float]

    def moved(self, errors: NDArray) -> dict[str, NDArray]:
        """The same with errors (V, H, W) added to −1/z: places and sizes follow along the pixels' rays."""
        changed = np.clip(self.inverse + errors[self.at], *self.limits)
        ratio = (self.inverse / changed)[:, None]
        means = self.centres + (self.arrays["means"] - self.centres) * ratio
        return {**self.arrays, "means": means, "scales": self.arrays["scales"] * ratio}

    def faded(self, errors: NDArray) -> dict[str, NDArray]:
        """The same with errors (V, H, W) added to opacities, which decoders clip."""
        return {**self.arrays, "opacities": np.clip(self.arrays["opacities"] + errors[self.at], 0, 1)}


_Change = Callable[[_Selection, NDArray], dict[str, NDArray]]


class _Shot:
    """A stripe with the Gaussians that reach it, and its picture."""

    def __init__(
        self, layers: Sequence[Gaussians], inverse: Sequence[NDArray], shown: Sequence[NDArray], stripe: _Stripe
    ) -> None:
        self._camera, self._origin = stripe.camera, layers[0].origin
        self.chosen = [_select(*of_layer, stripe) for of_layer in zip(layers, inverse, shown, strict=True)]
        self.shown = tuple(sum(chosen.shown[i] for chosen in self.chosen) for i in range(2))
        self._picture = self._render([chosen.arrays for chosen in self.chosen])

    def damage(self, errors: Sequence[NDArray], change: _Change) -> float:
        """See `Probe.damage`."""
        changed = [change(chosen, error) for chosen, error in zip(self.chosen, errors, strict=True)]
        return float(np.square(self._render(changed) - self._picture).mean(dtype=np.float64))

    def _render(self, layers: Sequence[Mapping[str, NDArray]]) -> NDArray:
        arrays = {name: np.concatenate([layer[name] for layer in layers]) for name in layers[0]}
        # Never compiled: a file's bytes are not to depend on whether numba is installed.
        renderer = Renderer(Gaussians.unchecked(**arrays, origin=self._origin), 1, compiled=False, **DEFINITION)
        return np.clip(np.nan_to_num(renderer.render(self._camera)), 0, 1)


def _stripes(cameras: Sequence[Camera], count: int, depth: float) -> list[_Stripe]:
    """Crops of cameras midway between the views, spread over them; places follow the golden ratio over the frame.

    Of more views than make one scene, those next to the camera are what is drawn; `depth` is the scene's.
    """
    middles = [between(pair, 3)[1] for pair in pairwise(cameras)] or list(cameras)
    stripes = []
    for n in range(count):
        camera = middles[int((n + 0.5) * len(middles) / count)]
        rows = min(STRIPE_ROWS, camera.height)
        first = int((0.5 + n * _GOLDEN) % 1 * (camera.height - rows))
        K = camera.K.copy()
        K[1, 2] -= first
        views: Sequence[int] = range(len(cameras))
        if len(cameras) > FEW:
            views = sorted(nearest_views(cameras, camera, depth, NEAR))
        stripes.append(_Stripe(Camera(K, camera.c2w, camera.width, rows), first, camera.height, views))
    return stripes


def _select(layer: Gaussians, inverse: NDArray, shown: NDArray, stripe: _Stripe) -> _Selection:
    """A layer's Gaussians that reach a stripe, looked for some rows at a time: of a large photo they are few."""
    camera = stripe.camera
    rows = max(_PIXELS_AT_A_TIME // layer.opacities.shape[2], 1)
    at, sums = [], np.zeros(2)
    for view in stripe.views:
        of_view = shown[view]
        for first in range(0, len(of_view), rows):
            block = slice(first, first + rows)
            near, seen = _near(layer, view, block, stripe)
            sums += [of_view[block][part].sum(dtype=np.float64) for part in seen]
            row, column = np.nonzero(near)
            at.append((np.full(len(row), view), row + first, column))
    chosen = tuple(np.concatenate(indices) for indices in zip(*at, strict=True))
    directions = layer.means[chosen] + _shift(layer, camera)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    colors = np.einsum("nb,nbc->nc", sh_basis(directions, layer.degree), layer.sh[chosen])[:, None] / np.float32(C0)
    arrays = {name: getattr(layer, name)[chosen] for name in ("means", "quats", "scales", "opacities")} | {"sh": colors}
    centres = np.stack([camera.centre - layer.origin for camera in layer.cameras]).astype(np.float32)
    limits = extent(inverse)
    per_pixel = float(sums[0]) / (camera.width * camera.height), float(sums[1]) / (camera.width * stripe.height)
    return _Selection(chosen, inverse[chosen], limits, centres[chosen[0]], arrays, per_pixel)


def _near(layer: Gaussians, view: int, block: slice, stripe: _Stripe) -> tuple[NDArray, tuple[NDArray, NDArray]]:
    """(h, W) bool of a block of a view's rows: which Gaussians reach a stripe, and whose centres lie in it and in its
    whole picture.
    """
    camera = stripe.camera
    points = layer.means[view, block] + _shift(layer, camera)  # (h, W, 3)
    x, y, z = np.einsum("ij,hwj->ihw", camera.rotation.astype(np.float32), points)
    K, safe, scales = camera.K, np.maximum(z, np.float32(_LEAST_DEPTH)), layer.scales[view, block]
    widest = np.maximum(np.maximum(scales[..., 0], scales[..., 1]), scales[..., 2])
    reach = np.float32(_REACH * camera.focal) * widest / safe + np.float32(_DILATION_PX)
    v, before = K[1, 1] * y / safe + K[1, 2], z > _LEAST_DEPTH
    near = (np.abs(v - camera.height / 2) < camera.height / 2 + reach) & before
    u = (K[0, 0] * x + K[0, 1] * y) / safe + K[0, 2]
    near &= (np.abs(u - camera.width / 2) < camera.width / 2 + reach) & (layer.opacities[view, block] >= ALPHA_MIN)
    whole = before & (u >= 0) & (u < camera.width) & (v >= -stripe.first) & (v < stripe.height - stripe.first)
    return near, (whole & (v >= 0) & (v < camera.height), whole)


def _shift(layer: Gaussians, camera: Camera) -> NDArray:
    """(3,) float32 from a camera's centre to what a layer's means are relative to."""
    return (layer.origin - camera.centre).astype(np.float32)
