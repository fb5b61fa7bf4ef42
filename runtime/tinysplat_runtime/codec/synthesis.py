"""Codes of a layer to Gaussians: what the synthesis graph is fed with, and where its results go.

Dequantisation and all linear maps are folded into one matrix per group of planes, in float64. The graph runs a view at
a time, on several threads geometry apart from colour, so that it can work on what is there while other planes are being
decoded; it writes into the arrays of the result.
"""

import numpy as np
from numpy.typing import NDArray

from ..container.layers import LayerMaps
from ..gaussian.gaussians import Gaussians
from ..gaussian.planes import GEOMETRY, GEOMETRY_CHANNELS, PlaneClass
from ..gaussian.quaternions import matrices_to_quats, multiply_quats
from ..graphs.inference import GraphStore, as_input

STRIP_PX = 1 << 16
"""Pixels that the graph takes at a time: between its operators the numbers of so many stay in a core's share of the
cache, and the operators' own cost does not yet count (512×960: 19 in place of 27 ms for a view)."""

_HALF_RANGE = 1 << 16


class LayerSynthesis:
    """The Gaussians of one layer in the making; views and halves may come in any order, on any threads."""

    def __init__(self, layer: LayerMaps, origin: NDArray, store: GraphStore, base: NDArray | None = None) -> None:
        """Fold the layer's numbers into matrices; `base` is what the codes are added to: geometry planes
        (V, 11, H, W).
        """
        self._layer, self._origin = layer, origin
        self._graph = store.transform("synthesis")
        cameras, (geometry, colors) = layer.cameras, coded_channels(layer)
        mix = _geometry_mix(layer, geometry)
        self._base_codes: NDArray | None = None
        if base is not None:
            self._base_codes, base_mix = _as_codes(base)
            mix[:, -1] += base_mix[:, -1]
            mix = np.concatenate([base_mix[:, :-1], mix], axis=1)
        rotations = np.stack([camera.rotation.T for camera in cameras])
        quats = matrices_to_quats(rotations)
        if layer.reference_quats is not None:
            quats = multiply_quats(quats, layer.reference_quats.astype(np.float64))
        self._by_view = {
            "K": as_input([camera.K for camera in cameras]),
            "rotation": as_input(rotations),
            "rotation_quat": as_input(quats),
            "centre": as_input([camera.centre - origin for camera in cameras]),
        }
        color_mix = as_input(_colour_mix(layer, colors))
        # Inputs of the half that does not run are as small as they can be.
        self._shared = {
            "geometry_codes": np.ones((1, mix.shape[1], 1, 1), np.uint16),
            "geometry_mix": as_input(mix[None]),
            "color_codes": np.ones((1, len(color_mix), 1, 1), np.uint16),
            "color_mix": color_mix,
            "inverse_depth": as_input(layer.inverse_depth),
            "relative_rotation": as_input(layer.reference_quats is not None),
            "depth_limits": as_input(layer.depth_limits),
        }
        grid = (len(cameras), layer.height, layer.width)
        shapes = {"means": (*grid, 3), "quats": (*grid, 4), "scales": (*grid, 3), "opacities": grid}
        self._geometry = {name: np.empty(shape, np.float32) for name, shape in shapes.items()}
        self._sh = np.empty((*grid, color_mix.shape[1]), np.float32)

    def run(self, view: int, geometry: NDArray | None = None, colors: NDArray | None = None) -> None:
        """Make a view's means, quats, scales and opacities, its SH coefficients, or both at once.

        Args:
            view: which.
            geometry: codes (P + 1, H, W) uint16, the last plane ones; None to leave these fields for another call.
            colors: codes (k + 1, H, W) uint16 likewise, for the SH coefficients.
        """
        codes: dict[str, NDArray] = {}
        outputs: dict[str, NDArray] = {}
        if geometry is not None:
            if self._base_codes is not None:
                geometry = np.concatenate([self._base_codes[view], geometry])
            codes["geometry_codes"] = geometry
            outputs |= self._geometry
        if colors is not None:
            codes["color_codes"] = colors
            outputs["sh"] = self._sh
        own = slice(view, view + 1)
        by_view = {key: array[own] for key, array in self._by_view.items()}
        for strip in self._strips():
            # A strip's rows count from its own first, which the principal point makes up for: bit for bit where float32
            # holds the difference, as with whole and half pixels, and else to the rounding that K has in it anyway.
            K = by_view["K"].copy()
            K[0, 1, 2] -= strip.start
            parts = {key: np.ascontiguousarray(array[None, :, strip]) for key, array in codes.items()}
            inputs = self._shared | by_view | parts | {"K": K}
            self._graph.run_into(inputs, {key: array[own, strip] for key, array in outputs.items()})

    def _strips(self) -> list[slice]:
        rows = max(1, STRIP_PX // self._layer.width)
        return [slice(row, min(row + rows, self._layer.height)) for row in range(0, self._layer.height, rows)]

    def gaussians(self) -> Gaussians:
        """The layer, once all views are done."""
        sh = self._sh.reshape(*self._sh.shape[:3], -1, 3)
        return Gaussians.unchecked(**self._geometry, sh=sh, cameras=self._layer.cameras, origin=self._origin)


def coded_channels(layer: LayerMaps) -> tuple[list[int], list[int]]:
    """Which of the layer's channels have pictures, by index: those of geometry, and of colour. The graph's planes stand
    in this order.

    Indices, as a record's hash and comparison go through all its streams: 4 of 208 ms at 16 views.
    """
    coded = [index for index, channel in enumerate(layer.channels) if channel.pictures]
    colors = [index for index in coded if layer.channels[index].plane_class == PlaneClass.COLOR]
    return [index for index in coded if index not in colors], colors


def _geometry_mix(layer: LayerMaps, coded: list[int]) -> NDArray:
    """(11, P + 1) float64: geometry channels = mix · codes, the last code being 1."""
    mix = np.zeros((GEOMETRY_CHANNELS, len(coded) + 1))
    for index, channel in enumerate(layer.channels):
        if channel.plane_class == PlaneClass.COLOR:
            continue
        row = GEOMETRY[channel.plane_class].start + channel.target
        mix[row, -1] += channel.offset
        if index in coded:
            mix[row, coded.index(index)] = channel.scale
    if layer.scale_mix is not None:
        rows = GEOMETRY[PlaneClass.SCALE]
        matrix, mean = (a.astype(np.float64) for a in layer.scale_mix)
        mix[rows] = matrix @ mix[rows]
        mix[rows, -1] += mean
    return mix


def _colour_mix(layer: LayerMaps, coded: list[int]) -> NDArray:
    """(k + 1, d) float64: SH coefficients = codes · mix, the last code being 1.

    arXiv 2506.09479, basis reduction: X̂ = Δ⁻¹WZ, with the quantiser's steps folded in.
    """
    # Without VABR the colour planes are the three coefficients of degree 0 themselves.
    inverse = np.eye(3) if layer.basis is None else layer.basis.astype(np.float64)  # (d, k)
    mix = np.zeros((len(coded) + 1, len(inverse)))
    for index, channel in enumerate(layer.channels):
        if channel.plane_class == PlaneClass.COLOR:
            mix[-1] += inverse[:, channel.target] * channel.offset
            if index in coded:
                mix[coded.index(index)] = inverse[:, channel.target] * channel.scale
    return mix


def _as_codes(planes: NDArray) -> tuple[NDArray, NDArray]:
    """Float planes in the form that the synthesis graph adds up: 16-bit codes and what one is worth.

    Args:
        planes: (V, C, H, W) float32.

    Returns:
        codes (V, 2C, H, W) uint16, upper halves first, and mix (C, 2C + 1) float64: planes = mix · (codes, 1), to
        2⁻³² of each channel's range.
    """
    count = planes.shape[1]
    low = planes.min(axis=(0, 2, 3)).astype(np.float64)
    span = np.maximum(planes.max(axis=(0, 2, 3)) - low, 1e-30)
    unit = span / (_HALF_RANGE**2 - 1)
    steps = np.rint((planes - low[:, None, None]) / unit[:, None, None]).astype(np.uint32)
    codes = np.concatenate([steps >> 16, steps & (_HALF_RANGE - 1)], axis=1).astype(np.uint16)
    mix = np.zeros((count, 2 * count + 1))
    mix[:, :count] = np.diag(unit * _HALF_RANGE)
    mix[:, count:-1] = np.diag(unit)
    mix[:, -1] = low
    return codes, mix
