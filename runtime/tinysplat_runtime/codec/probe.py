"""What an error in the planes does to the picture, measured on the scene itself.

A few small windows are rendered from cameras at and between the input views, once from the planes as they are and once
from planes with an error; the mean squared difference is what that error costs. Only Gaussians that reach a window take
part, and their colours are evaluated for its camera once, so that a measurement takes some ten milliseconds whatever
the size of the scene.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np
from numpy.typing import NDArray

from ..cameras import Camera
from ..gaussians import Gaussians
from ..quaternions import left_multiplication_matrices, matrices_to_quats, multiply_quats
from ..render import Renderer, between
from ..render.prepare import ALPHA_MIN
from ..sh import C0, sh_basis
from .planes import PlaneClass

WINDOW_SIDE = 64
"""Pixels; a window of a smaller picture is as large as that."""

_REACH = 3.0  # standard deviations beyond which a Gaussian's part in a window is not worth the look
_DILATION_PX = 3.0
_LEAST_DEPTH = 1e-6
_LEAST_W = 0.1
_GOLDEN = 0.6180339887498949


@dataclass(frozen=True, eq=False)
class PlaneSet:
    """Planes of one layer with what turns them back into Gaussians; see `LayerPlan` for the maps.

    Attributes:
        layer: the Gaussians they were made of.
        values: (V, C, H, W) float32 by class: −1/z, pixel offsets, principal scales, vector parts of relative
            rotations, opacities, colour components.
        reference_quats: (V, 4).
        scale_mix: (3, 3) and (3,).
        color_inverse: (d, k) coefficients = inverse · planes.
    """

    layer: Gaussians
    values: Mapping[PlaneClass, NDArray]
    reference_quats: NDArray
    scale_mix: tuple[NDArray, NDArray]
    color_inverse: NDArray

    @cached_property
    def widest(self) -> NDArray:
        """(V, H, W) largest standard deviation of each Gaussian, scene units."""
        return reduce(np.maximum, np.moveaxis(self.layer.scales, -1, 0))


@dataclass(frozen=True, eq=False)
class _Selection:
    """Gaussians of one layer that reach a window: their view, row and column, and their colours from its camera."""

    planes: PlaneSet
    views: NDArray
    rows: NDArray
    columns: NDArray
    basis: NDArray

    def of_view(self, view: int) -> slice:
        """The rows of one view; views stand in order."""
        return slice(*np.searchsorted(self.views, [view, view + 1]))

    def pick(self, plane_class: PlaneClass, planes: NDArray | None = None) -> NDArray:
        """(C, n) values of a class, or of other planes in its place."""
        values = self.planes.values[plane_class] if planes is None else planes
        return values[self.views, :, self.rows, self.columns].T


class Probe:
    """Measures errors of the planes of a scene's layers.

    Args:
        layers: every layer's planes.
        cameras: input views; windows lie in them and between neighbours.
        windows: how many.
    """

    def __init__(self, layers: Sequence[PlaneSet], cameras: Sequence[Camera], windows: int) -> None:
        with np.errstate(all="ignore"):  # numbers at float32's end are no reason to fail: what is not one shows as 0
            self._shots = [_Shot(layers, window) for window in _windows(cameras, windows)]

    def damage(self, layer: int, errors: Mapping[PlaneClass, NDArray]) -> float:
        """Mean squared difference of the pictures when `errors` (V, C, H, W) are added to classes of a layer."""
        with np.errstate(all="ignore"):
            return sum(shot.damage(layer, errors) for shot in self._shots) / len(self._shots)


class _Shot:
    """A window with the Gaussians that reach it, and its picture."""

    def __init__(self, layers: Sequence[PlaneSet], window: Camera) -> None:
        self._window = window
        self._chosen = [_select(planes, window) for planes in layers]
        parts = [
            {**_positions(s, {}), **_rotations(s, {}), **_scales(s, {}), **_opacities(s, {}), **_colors(s, {})}
            for s in self._chosen
        ]
        self._arrays = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        ends = np.cumsum([len(s.views) for s in self._chosen])
        self._rows = [slice(end - len(s.views), end) for s, end in zip(self._chosen, ends, strict=True)]
        self._origin = layers[0].layer.origin
        self._picture = self._render(self._arrays)

    def damage(self, layer: int, errors: Mapping[PlaneClass, NDArray]) -> float:
        """See `Probe.damage`."""
        chosen = self._chosen[layer]
        arrays = dict(self._arrays)
        given = {plane_class: chosen.pick(plane_class, values) for plane_class, values in errors.items()}
        for depends, rebuild in _REBUILD:
            if depends & given.keys():
                for name, values in rebuild(chosen, given).items():
                    arrays[name] = arrays[name].copy()
                    arrays[name][self._rows[layer]] = values
        return float(np.square(self._render(arrays) - self._picture).mean(dtype=np.float64))

    def _render(self, arrays: Mapping[str, NDArray]) -> NDArray:
        # Never compiled: a file's bytes are not to depend on whether numba is installed.
        renderer = Renderer(Gaussians.unchecked(**arrays, origin=self._origin), 1, compiled=False)
        return np.clip(np.nan_to_num(renderer.render(self._window)), 0, 1)


def _windows(cameras: Sequence[Camera], count: int) -> list[Camera]:
    """Crops of the input views and of midpoints between them; places follow the golden ratio over the frame."""
    path = between(cameras, 2 * len(cameras) - 1) if len(cameras) > 1 else list(cameras)
    windows = []
    for n in range(count):
        # The first is a midpoint: that is where scenes are looked at, and where views meet.
        camera = path[(1 + round(n * len(path) / count)) % len(path)]
        width, height = min(WINDOW_SIDE, camera.width), min(WINDOW_SIDE, camera.height)
        K = camera.K.copy()
        K[0, 2] -= int((0.5 + n * _GOLDEN) % 1 * (camera.width - width))
        K[1, 2] -= int((n + 0.5) / count * (camera.height - height))
        windows.append(Camera(K, camera.c2w, width, height))
    return windows


def _select(planes: PlaneSet, window: Camera) -> _Selection:
    layer = planes.layer
    points = layer.means + (layer.origin - window.centre).astype(np.float32)  # (V, H, W, 3)
    x, y, z = np.moveaxis(points @ window.rotation.T.astype(np.float32), -1, 0)
    K, safe = window.K, np.maximum(z, np.float32(_LEAST_DEPTH))
    u = (K[0, 0] * x + K[0, 1] * y) / safe + K[0, 2]
    v = K[1, 1] * y / safe + K[1, 2]
    reach = np.float32(_REACH * window.focal) * planes.widest / safe + np.float32(_DILATION_PX)
    near = (np.abs(u - window.width / 2) < window.width / 2 + reach) & (z > _LEAST_DEPTH)
    near &= (np.abs(v - window.height / 2) < window.height / 2 + reach) & (layer.opacities >= ALPHA_MIN)
    views, rows, columns = np.nonzero(near)
    directions = points[views, rows, columns]
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return _Selection(planes, views, rows, columns, sh_basis(directions, layer.degree))


_Errors = Mapping[PlaneClass, NDArray]


def _planes(chosen: _Selection, plane_class: PlaneClass, errors: _Errors) -> NDArray:
    values = chosen.pick(plane_class)
    return values + errors[plane_class] if plane_class in errors else values


def _depths(chosen: _Selection, errors: _Errors) -> NDArray:
    return -1 / np.minimum(_planes(chosen, PlaneClass.DEPTH, errors)[0], np.float32(-_LEAST_DEPTH))


def _positions(chosen: _Selection, errors: _Errors) -> dict[str, NDArray]:
    layer, offsets, z = chosen.planes.layer, _planes(chosen, PlaneClass.OFFSET, errors), _depths(chosen, errors)
    means = np.empty((len(z), 3), np.float32)
    for view, camera in enumerate(layer.cameras):
        of, K = chosen.of_view(view), camera.K.astype(np.float32)
        y = (offsets[1, of] + (chosen.rows[of] + np.float32(0.5) - K[1, 2])) / K[1, 1]
        x = (offsets[0, of] + (chosen.columns[of] + np.float32(0.5) - K[0, 2]) - K[0, 1] * y) / K[0, 0]
        points = np.stack([x * z[of], y * z[of], z[of]], axis=-1)
        means[of] = points @ camera.rotation.astype(np.float32) + (camera.centre - layer.origin).astype(np.float32)
    return {"means": means}


def _scales(chosen: _Selection, errors: _Errors) -> dict[str, NDArray]:
    mix, mean = chosen.planes.scale_mix
    projected = np.maximum(mix @ _planes(chosen, PlaneClass.SCALE, errors) + mean[:, None], 0)
    z = _depths(chosen, errors)
    for view, camera in enumerate(chosen.planes.layer.cameras):
        z[chosen.of_view(view)] /= np.float32(camera.focal)
    return {"scales": np.ascontiguousarray((projected * z).T)}


def _rotations(chosen: _Selection, errors: _Errors) -> dict[str, NDArray]:
    vector = _planes(chosen, PlaneClass.ROTATION, errors)
    w = np.sqrt(np.maximum(1 - np.square(vector).sum(axis=0), np.float32(_LEAST_W**2)))
    quats = np.concatenate([w[None], vector])
    for view, camera in enumerate(chosen.planes.layer.cameras):
        of = chosen.of_view(view)
        turn = multiply_quats(matrices_to_quats(camera.rotation.T), chosen.planes.reference_quats[view])
        quats[:, of] = left_multiplication_matrices(turn).astype(np.float32) @ quats[:, of]
    return {"quats": np.ascontiguousarray(quats.T)}


def _opacities(chosen: _Selection, errors: _Errors) -> dict[str, NDArray]:
    return {"opacities": np.clip(_planes(chosen, PlaneClass.OPACITY, errors)[0], 0, 1)}


def _colors(chosen: _Selection, errors: _Errors) -> dict[str, NDArray]:
    """Colours as seen from the window's camera, as coefficients of degree 0."""
    sh = chosen.planes.layer.sh[chosen.views, chosen.rows, chosen.columns]
    rgb = np.matmul(chosen.basis[:, None], sh)[:, 0]
    if PlaneClass.COLOR in errors:
        inverse = chosen.planes.color_inverse.astype(np.float32)  # (d, k)
        change = (inverse @ errors[PlaneClass.COLOR]).T.reshape(sh.shape)
        rgb = rgb + np.matmul(chosen.basis[:, None], change)[:, 0]
    return {"sh": (rgb / np.float32(C0))[:, None]}


_REBUILD = (
    ({PlaneClass.DEPTH, PlaneClass.OFFSET}, _positions),
    ({PlaneClass.DEPTH, PlaneClass.SCALE}, _scales),
    ({PlaneClass.ROTATION}, _rotations),
    ({PlaneClass.OPACITY}, _opacities),
    ({PlaneClass.COLOR}, _colors),
)
"""Which arrays of the Gaussians follow from which classes."""
