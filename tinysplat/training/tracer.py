"""Ray casting of textured boxes, ellipsoids and rooms with exact depth."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

BOX, ELLIPSOID, ROOM = 0, 1, 2
"""Kinds of primitive; a room is a box seen from inside."""

NEAREST = 0.1
"""Hits nearer than this depth do not count, scene units."""

AMBIENT = 0.7
"""Share of light that comes from everywhere."""

SHINE = 16
"""Exponent of highlights."""


@dataclass(frozen=True, eq=False)
class Primitive:
    """A thing of a scene.

    Attributes:
        kind: of the three.
        centre: (3,).
        rotation: (3, 3), rows are its axes in the world.
        extent: (3,) half sides or half axes.
        texture: (S, S, 3) uint8, continued by reflection.
        density: texture pixels per scene unit.
        shift: (2,) texture pixels.
        gain: factor on the texture's values.
        bias: (3,) added to them.
        gloss: strength of the highlight.
    """

    kind: int
    centre: NDArray
    rotation: NDArray
    extent: NDArray
    texture: NDArray
    density: float
    shift: NDArray
    gain: float
    bias: NDArray
    gloss: float


def trace(
    primitives: Sequence[Primitive], light: NDArray, K: NDArray, c2w: NDArray, side: int, samples: int
) -> tuple[NDArray, NDArray]:
    """Take a square picture.

    Args:
        primitives: the scene.
        light: (3,) unit direction towards the light.
        K: (3, 3) pixels.
        c2w: (4, 4).
        side: pixels.
        samples: rays per pixel along each axis.

    Returns:
        Picture (side, side, 3) float32 in [0, 1], and z (side, side) of a ray near each pixel's centre; 0 where
        nothing was hit.
    """
    size, scale = side * samples, np.array([samples, samples, 1])[:, None]
    at = np.arange(size, dtype=np.float32) + np.float32(0.5)
    pixels = np.stack([*np.meshgrid(at, at), np.ones((size, size), np.float32)])
    rays = _turned(c2w[:3, :3] @ np.linalg.inv(scale * K), pixels)  # (3, h, w), z = 1 in the camera's frame
    depth, colours = np.full((size, size), np.inf, np.float32), np.zeros((3, size, size), np.float32)
    hit, axes = np.full((size, size), -1), np.zeros((size, size), np.int8)  # which primitive, and which of its axes
    for number, one in enumerate(primitives):
        part = _shown(one, scale * K, c2w, size)
        found, axis = _hit(one, c2w[:3, 3], rays[(slice(None), *part)])
        nearer = (found >= NEAREST) & (found < depth[part])
        for values, new in ((depth, found), (hit, number), (axes, axis)):
            np.copyto(values[part], new, where=nearer)
    for number, one in enumerate(primitives):
        mine = hit == number
        if mine.any():
            colours[:, mine] = _shade(one, c2w[:3, 3], rays[:, mine], depth[mine], axes[mine], light)
    picture = colours.reshape(3, side, samples, side, samples).mean(axis=(2, 4)).transpose(1, 2, 0)
    return picture, np.where(np.isfinite(depth), depth, 0)[samples // 2 :: samples, (samples - 1) // 2 :: samples]


def _turned(matrix: NDArray, vectors: NDArray) -> NDArray:
    """Vectors (3, …) float32 by a matrix (3, 3)."""
    return np.tensordot(matrix.astype(np.float32), vectors, 1)


def _shown(one: Primitive, K: NDArray, c2w: NDArray, size: int) -> tuple[slice, slice]:
    """Rows and columns of a picture that may show a primitive: those of the cube about it that faces the camera."""
    x, y, z = (one.centre - c2w[:3, 3]) @ c2w[:3, :3]
    radius = np.linalg.norm(one.extent)
    if z - radius < NEAREST:
        return np.s_[:size], np.s_[:size]
    corners = [(x + i * radius, y + j * radius, z + k * radius) for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]
    shown = np.array(corners) @ K.T
    ends = shown[:, :2] / shown[:, 2:]
    (left, top), (right, bottom) = (side.clip(0, size).astype(int) for side in (ends.min(0), ends.max(0) + 1))
    return np.s_[top:bottom], np.s_[left:right]


def _hit(one: Primitive, eye: NDArray, rays: NDArray) -> tuple[NDArray, NDArray | int]:
    """Depth (h, w) of the first hit of rays (3, h, w), infinite or less than nothing without one, and the face's axis.

    An ellipsoid has no axis: −1.
    """
    origin, local = (_turned(one.rotation, vectors) for vectors in ((eye - one.centre).astype(np.float32), rays))
    extent = one.extent.astype(np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        if one.kind == ELLIPSOID:
            origin, local = origin / extent, local / extent[:, None, None]
            a, b, c = (local * local).sum(axis=0), np.tensordot(origin, local, 1), origin @ origin - 1
            return np.nan_to_num((-b - np.sqrt(b * b - a * c)) / a, nan=np.inf), -1
        first, second = (((sign * extent - origin)[:, None, None] / local) for sign in (-1, 1))
        near, far = np.minimum(first, second), np.maximum(first, second)
        enter, leave = near.max(axis=0), far.min(axis=0)
        depth, axis = (leave, far.argmin(axis=0)) if one.kind == ROOM else (enter, near.argmax(axis=0))
        return np.where(enter <= leave, depth, np.inf), axis


def _shade(one: Primitive, eye: NDArray, rays: NDArray, depth: NDArray, axis: NDArray, light: NDArray) -> NDArray:
    """Colours (3, n) of hits: texture, Lambert's law beside ambient light, and a highlight about the mirrored light."""
    at = one.rotation @ ((eye - one.centre)[:, None] + depth * rays)
    if one.kind == ELLIPSOID:
        normal = at / one.extent[:, None] ** 2
        normal /= np.sqrt((normal * normal).sum(axis=0))
        uv = np.stack([np.arctan2(at[0], at[2]) * one.extent[0], at[1]])
    else:
        normal = np.eye(3)[:, axis]
        uv = np.stack([np.choose((axis + further) % 3, at) for further in (1, 2)])
    normal = one.rotation.T @ normal
    facing, lit = (normal * rays).sum(axis=0), light @ normal
    mirrored = (light @ rays - 2 * facing * lit) / np.sqrt((rays * rays).sum(axis=0))
    shade = AMBIENT + (1 - AMBIENT) * np.where(facing > 0, -lit, lit)
    texels = _texels(one.texture, np.abs(one.density * uv + one.shift[:, None]))
    return ((texels * one.gain + one.bias[:, None]) * shade + one.gloss * mirrored.clip(0) ** SHINE).clip(0, 1)


def _texels(texture: NDArray, uv: NDArray) -> NDArray:
    """(3, n) in [0, 1] of a texture at columns and rows (2, n), bilinear."""
    from scipy.ndimage import map_coordinates  # which scikit-image brings

    planes = np.moveaxis(texture, -1, 0).astype(np.float32) / 255
    return np.stack([map_coordinates(plane, uv[::-1], order=1, mode="mirror") for plane in planes])
