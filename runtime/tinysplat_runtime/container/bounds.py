"""What a layer's metadata lets decoding come to: the memory it takes, and the largest numbers it can compute.

A file whose numbers each are fine may still combine them into infinity, and infinity into NaN. Interval arithmetic
over the metadata, codes from 0 to 4095, shows before any decoding that it cannot: bounds cost microseconds where a
look at every decoded number would cost more than the synthesis itself.
"""

import math

import numpy as np
from numpy.typing import NDArray

from ..errors import FormatError
from ..gaussian.planes import CODING_ORDER, GEOMETRY_CHANNELS, MAX_CODE, MAX_DECODED, PlaneClass
from .layers import LayerHeader

MIN_DEPTH = 1e-30
"""Least depth: its inverse is a decoded number too."""


def decoding_bytes(layer: LayerHeader) -> int:
    """Memory that decoding a layer takes: its Gaussians, the codes that they come from, and both as float32.

    Codes count because they can outweigh the Gaussians: a file may announce more planes than a Gaussian has numbers.
    """
    pictures = sum(1 for channel in layer.channels if channel.pictures)
    numbers = GEOMETRY_CHANNELS + 3 * (layer.degree + 1) ** 2
    per_gaussian = 4 * (numbers + 2 * GEOMETRY_CHANNELS) + (2 + 4) * (pictures + 2)
    return layer.gaussians * per_gaussian


def check_ranges(layer: LayerHeader, origin: NDArray, where: str) -> None:
    """Refuse a layer whose codes can decode to numbers that float32 does not hold; `origin` is (3,) float64.

    Raises:
        FormatError: names the attribute and how large it can become.
    """
    low, high = layer.depth_limits
    if low < MIN_DEPTH or high > MAX_DECODED:
        raise FormatError(f"depths {low:g} to {high:g}, accepted are {MIN_DEPTH:g} to {MAX_DECODED:g}", where=where)
    largest = {plane_class: _largest(layer, plane_class) for plane_class in CODING_ORDER}
    values = {c.label: (max(largest[c].values(), default=0.0), c.facts.largest) for c in CODING_ORDER}
    scale = max(largest[PlaneClass.SCALE].values(), default=0.0)
    if layer.scale_mix is not None:
        matrix, mean = (np.abs(a.astype(np.float64)) for a in layer.scale_mix)
        scale = float((matrix.sum(axis=1) * scale + mean).max())
    color = largest[PlaneClass.COLOR]
    if layer.basis is not None and color:
        columns = np.abs(layer.basis.astype(np.float64)).max(axis=0)
        values["sh"] = sum(float(columns[target]) * value for target, value in color.items()), MAX_DECODED
    for view, camera in enumerate(layer.cameras):
        values[f"scales of view {view}"] = max(scale, scale * high / camera.focal), MAX_DECODED
        values[f"means of view {view}"] = _reach(layer, view, largest[PlaneClass.OFFSET], origin), MAX_DECODED
    for name, (value, bound) in values.items():
        if not value <= bound:  # also refuses NaN
            raise FormatError(f"{name} can decode to {value:.3g}, accepted is at most {bound:g}", where=where)


def _largest(layer: LayerHeader, plane_class: PlaneClass) -> dict[int, float]:
    """Largest magnitude that a class's records can add up to, by target."""
    sums: dict[int, float] = {}
    for channel in layer.channels:
        if channel.plane_class == plane_class:
            reach = abs(channel.offset) + (MAX_CODE * abs(channel.scale) if channel.pictures else 0.0)
            sums[channel.target] = sums.get(channel.target, 0.0) + reach
    return sums


def _reach(layer: LayerHeader, view: int, offsets: dict[int, float], origin: NDArray) -> float:
    """Largest coordinate of a mean: rays through the farthest pixels at the largest depth."""
    camera = layer.cameras[view]
    (fx, skew, cx), (_, fy, cy) = (map(abs, row) for row in camera.K[:2].tolist())
    y = (offsets.get(1, 0.0) + layer.height + cy) / fy
    x = (offsets.get(0, 0.0) + layer.width + cx + skew * y) / fx
    return (x + y + 1) * max(layer.depth_limits[1], 1.0) + math.hypot(*(camera.centre - origin).tolist())
