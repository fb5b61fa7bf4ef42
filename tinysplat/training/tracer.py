"""Ray casting of textured boxes, ellipsoids and rooms with exact depth, compiled with numba for one thread."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

BOX, ELLIPSOID, ROOM = 0, 1, 2
"""Kinds of primitive; a room is a box seen from inside."""

NEAREST = 0.1
"""Hits nearer than this depth do not count, scene units."""

_F = np.float32


@dataclass(frozen=True)
class Primitives:
    """What a procedural scene is made of; float32 unless stated.

    Attributes:
        kind: (P,) int64.
        centre: (P, 3).
        rotation: (P, 3, 3), rows are the primitive's axes in the world.
        extent: (P, 3) half sides or half axes.
        texture: (P,) int64 index into the bank.
        density: (P,) texture pixels per scene unit.
        shift: (P, 2) texture pixels.
        gain: (P,) factor on the texture's values.
        bias: (P, 3) added to them.
        gloss: (P,) strength of the highlight.
    """

    kind: NDArray
    centre: NDArray
    rotation: NDArray
    extent: NDArray
    texture: NDArray
    density: NDArray
    shift: NDArray
    gain: NDArray
    bias: NDArray
    gloss: NDArray

    def arrays(self) -> tuple[NDArray, ...]:
        """All of them, in the order above."""
        return tuple(vars(self).values())


def trace(
    primitives: Primitives, textures: NDArray, light: NDArray, K: NDArray, c2w: NDArray, side: int, samples: int
) -> tuple[NDArray, NDArray]:
    """Take a square picture.

    Args:
        primitives: the scene.
        textures: (T, S, S, 3) uint8, continued by reflection.
        light: (3,) unit direction towards the light.
        K: (3, 3) pixels.
        c2w: (4, 4).
        side: pixels.
        samples: rays per pixel along each axis.

    Returns:
        Picture (side, side, 3) float32 in [0, 1], and z (side, side) of the ray nearest each pixel's centre; 0 where
        nothing was hit.
    """
    image, depth = np.zeros((side, side, 3), _F), np.zeros((side, side), _F)
    rotation, origin, intrinsics = (np.ascontiguousarray(a, _F) for a in (c2w[:3, :3], c2w[:3, 3], K))
    _trace(*primitives.arrays(), textures, light.astype(_F), intrinsics, rotation, origin, samples, image, depth)
    return image, depth


@njit(cache=True, nogil=True, inline="always")
def _reflected(position: float, size: int) -> int:
    """Texture index with the texture mirrored at its borders."""
    period = 2 * size - 2
    i = int(position) % period
    return period - i if i >= size else i


@njit(cache=True, nogil=True, fastmath=True)
def _hit(kind: int, local: NDArray, ray: NDArray, extent: NDArray) -> tuple[float, int]:
    """Depth of the first hit, or a huge number, and the axis of the face that was hit (0 for ellipsoids)."""
    if kind == 1:
        a, b, c = _F(0), _F(0), _F(-1)
        for k in range(3):
            e = _F(1) / (extent[k] * extent[k])
            a += ray[k] * ray[k] * e
            b += local[k] * ray[k] * e
            c += local[k] * local[k] * e
        disc = b * b - a * c
        if disc <= 0:
            return _F(1e9), 0
        return (-b - math.sqrt(disc)) / a, 0
    enter, leave, enter_axis, leave_axis = _F(-1e9), _F(1e9), 0, 0
    for k in range(3):
        inverse = _F(1) / (ray[k] if abs(ray[k]) > _F(1e-7) else _F(1e-7))
        one, two = (-extent[k] - local[k]) * inverse, (extent[k] - local[k]) * inverse
        if min(one, two) > enter:
            enter, enter_axis = min(one, two), k
        if max(one, two) < leave:
            leave, leave_axis = max(one, two), k
    if enter > leave:
        return _F(1e9), 0
    return (leave, leave_axis) if kind == 2 else (enter, enter_axis)


@njit(cache=True, nogil=True, fastmath=True)
def _trace(
    kind: NDArray, centre: NDArray, rotation: NDArray, extent: NDArray, texture: NDArray, density: NDArray,
    shift: NDArray, gain: NDArray, bias: NDArray, gloss: NDArray, textures: NDArray, light: NDArray, K: NDArray,
    camera: NDArray, origin: NDArray, samples: int, image: NDArray, depth: NDArray,
) -> None:  # fmt: skip
    count, side, size = kind.shape[0], depth.shape[0], textures.shape[1]
    local = np.empty((count, 3), np.float32)
    to = np.empty((count, 3), np.float32)
    reach2 = np.empty(count, np.float32)
    far2 = np.empty(count, np.float32)
    for p in range(count):
        reach2[p] = (extent[p] ** 2).sum()
        far2[p] = 0
        for k in range(3):
            to[p, k] = centre[p, k] - origin[k]
            far2[p] += to[p, k] ** 2
            local[p, k] = 0
            for j in range(3):
                local[p, k] += rotation[p, k, j] * (origin[j] - centre[p, j])
    d, ray, best_ray, normal = (
        np.empty(3, np.float32),
        np.empty(3, np.float32),
        np.empty(3, np.float32),
        np.empty(3, np.float32),
    )
    share = _F(1) / (samples * samples)
    for row in range(side):
        for column in range(side):
            for q in range(samples * samples):
                x = (column + (q % samples + _F(0.5)) / samples - K[0, 2]) / K[0, 0]
                y = (row + (q // samples + _F(0.5)) / samples - K[1, 2]) / K[1, 1]
                for k in range(3):
                    d[k] = camera[k, 0] * x + camera[k, 1] * y + camera[k, 2]
                d2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
                best, at, axis = _F(1e8), -1, 0
                for p in range(count):
                    along = d[0] * to[p, 0] + d[1] * to[p, 1] + d[2] * to[p, 2]
                    if far2[p] - along * along / d2 > reach2[p]:
                        continue
                    for k in range(3):
                        ray[k] = rotation[p, k, 0] * d[0] + rotation[p, k, 1] * d[1] + rotation[p, k, 2] * d[2]
                    t, face = _hit(kind[p], local[p], ray, extent[p])
                    if NEAREST <= t < best:
                        best, at, axis = t, p, face
                        for k in range(3):
                            best_ray[k] = ray[k]
                if at < 0:
                    continue
                if q == (samples * samples) // 2:
                    depth[row, column] = best
                h0, h1, h2 = (
                    local[at, 0] + best * best_ray[0],
                    local[at, 1] + best * best_ray[1],
                    local[at, 2] + best * best_ray[2],
                )
                if kind[at] == 1:
                    u, v = math.atan2(h0, h2) * extent[at, 0], h1
                    n0, n1, n2 = h0 / extent[at, 0] ** 2, h1 / extent[at, 1] ** 2, h2 / extent[at, 2] ** 2
                else:
                    n0, n1, n2 = _F(axis == 0), _F(axis == 1), _F(axis == 2)
                    u, v = (h1, h2) if axis == 0 else ((h2, h0) if axis == 1 else (h0, h1))
                length = math.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
                facing, shade, mirror = _F(0), _F(0), _F(0)
                for k in range(3):
                    normal[k] = (rotation[at, 0, k] * n0 + rotation[at, 1, k] * n1 + rotation[at, 2, k] * n2) / length
                    facing += normal[k] * d[k]
                for k in range(3):
                    shade += normal[k] * light[k] * (_F(-1) if facing > 0 else _F(1))
                    mirror += (d[k] - 2 * facing * normal[k]) * light[k]
                shade = _F(0.7) + _F(0.3) * shade
                glint = gloss[at] * max(mirror / math.sqrt(d2), _F(0)) ** 16
                u = abs(u * density[at] + shift[at, 0])
                v = abs(v * density[at] + shift[at, 1])
                fu, fv = u - math.floor(u), v - math.floor(v)
                i0, i1, j0, j1 = (
                    _reflected(u, size),
                    _reflected(u + 1, size),
                    _reflected(v, size),
                    _reflected(v + 1, size),
                )
                page = textures[texture[at]]
                for k in range(3):
                    top = (1 - fu) * page[j0, i0, k] + fu * page[j0, i1, k]
                    bottom = (1 - fu) * page[j1, i0, k] + fu * page[j1, i1, k]
                    value = ((1 - fv) * top + fv * bottom) / _F(255) * gain[at] + bias[at, k]
                    image[row, column, k] += min(max(value * shade + glint, _F(0)), _F(1)) * share
