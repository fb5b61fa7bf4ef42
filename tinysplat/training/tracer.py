"""Ray casting of textured boxes, ellipsoids and rooms with exact depth, compiled with numba for one thread.

Needs the package numba.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

BOX, ELLIPSOID, ROOM = 0, 1, 2
"""Kinds of primitive; a room is a box seen from inside."""

NEAREST = 0.1
"""Hits nearer than this depth do not count, scene units."""

AMBIENT = 0.7
"""Share of light that comes from everywhere."""

_F: Any = np.float32  # compiled code mixes it with float, which numpy's annotations do not allow
_NOTHING = _F(1e8)

# Columns of the packed geometry and looks of primitives
_CENTRE, _EXTENT, _ROTATION = 0, 3, 6
_DENSITY, _SHIFT, _GAIN, _BIAS, _GLOSS = 0, 1, 3, 4, 7


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

    def packed(self) -> tuple[NDArray, NDArray, NDArray]:
        """Kind and texture (P, 2) int64, geometry (P, 15) and looks (P, 8) float32."""
        ids = np.stack([self.kind, self.texture], axis=1)
        geometry = np.concatenate([self.centre, self.extent, self.rotation.reshape(-1, 9)], axis=1)
        looks = [self.density[:, None], self.shift, self.gain[:, None], self.bias, self.gloss[:, None]]
        return ids, geometry.astype(_F), np.concatenate(looks, axis=1).astype(_F)


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
        Picture (side, side, 3) float32 in [0, 1], and z (side, side) of a ray near each pixel's centre; 0 where
        nothing was hit.
    """
    image, depth = np.zeros((side, side, 3), _F), np.zeros((side, side), _F)
    camera = np.concatenate([c2w[:3, :3], c2w[:3, 3:], np.linalg.inv(K), light[:, None]], axis=1)  # (3, 8)
    _trace(*primitives.packed(), textures, camera.astype(_F), samples, image, depth)
    return image, depth


@njit(cache=True, nogil=True, inline="always")
def _reflected(position: float, size: int) -> int:
    """Texture index with the texture mirrored at its borders."""
    period = 2 * size - 2
    i = int(position) % period
    return period - i if i >= size else i


@njit(cache=True, nogil=True, fastmath=True)
def _hit_ellipsoid(origin: NDArray, ray: NDArray, extent: NDArray) -> float:
    """Depth of the first hit of a ray in the ellipsoid's frame, or a huge number."""
    a, b, c = _F(0), _F(0), _F(-1)
    for k in range(3):
        e = _F(1) / (extent[k] * extent[k])
        a += ray[k] * ray[k] * e
        b += origin[k] * ray[k] * e
        c += origin[k] * origin[k] * e
    inside = b * b - a * c
    return (-b - math.sqrt(inside)) / a if inside > 0 else _NOTHING


@njit(cache=True, nogil=True, fastmath=True)
def _hit_box(origin: NDArray, ray: NDArray, extent: NDArray, from_inside: bool) -> tuple[float, int]:
    """Depth of the first hit of a ray in the box's frame, or a huge number, and the axis of the face."""
    enter, leave, enter_axis, leave_axis = -_NOTHING, _NOTHING, 0, 0
    for k in range(3):
        inverse = _F(1) / (ray[k] if abs(ray[k]) > _F(1e-7) else _F(1e-7))
        one, two = (-extent[k] - origin[k]) * inverse, (extent[k] - origin[k]) * inverse
        if min(one, two) > enter:
            enter, enter_axis = min(one, two), k
        if max(one, two) < leave:
            leave, leave_axis = max(one, two), k
    if enter > leave:
        return _NOTHING, 0
    return (leave, leave_axis) if from_inside else (enter, enter_axis)


@njit(cache=True, nogil=True, fastmath=True)
def _texel(page: NDArray, u: float, v: float, out: NDArray) -> None:
    """Read a texture at (u, v) pixels, bilinear."""
    size = page.shape[0]
    fu, fv = u - math.floor(u), v - math.floor(v)
    i0, i1, j0, j1 = _reflected(u, size), _reflected(u + 1, size), _reflected(v, size), _reflected(v + 1, size)
    for k in range(3):
        top = (1 - fu) * page[j0, i0, k] + fu * page[j0, i1, k]
        bottom = (1 - fu) * page[j1, i0, k] + fu * page[j1, i1, k]
        out[k] = ((1 - fv) * top + fv * bottom) / _F(255)


@njit(cache=True, nogil=True, fastmath=True)
def _shade(
    at: NDArray, axis: int, geometry: NDArray, looks: NDArray, page: NDArray, light: NDArray, ray: NDArray, out: NDArray
) -> None:
    """Colour of a hit: texture, Lambert's law beside ambient light, and a highlight about the mirrored light.

    Args:
        at: (3,) place in the primitive's frame.
        axis: of the face; −1 on an ellipsoid.
        geometry, looks: rows of the primitive.
        page: its texture.
        light: (3,) towards the light.
        ray: (3,) viewing ray in the world.
        out: (3,) becomes the colour.
    """
    normal = np.zeros(3, np.float32)
    if axis < 0:
        u, v = math.atan2(at[0], at[2]) * geometry[_EXTENT], at[1]
        for k in range(3):
            normal[k] = at[k] / (geometry[_EXTENT + k] * geometry[_EXTENT + k])
    else:
        normal[axis] = _F(1)
        u, v = at[(axis + 1) % 3], at[(axis + 2) % 3]
    length = math.sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2])
    facing, lit, along, mirrored, ray2 = _F(0), _F(0), _F(0), _F(0), _F(0)
    for k in range(3):
        n = _F(0)
        for j in range(3):
            n += geometry[_ROTATION + 3 * j + k] * normal[j] / length
        facing += n * ray[k]
        lit += n * light[k]
        along += ray[k] * light[k]
        ray2 += ray[k] * ray[k]
    mirrored = (along - 2 * facing * lit) / math.sqrt(ray2)
    shade = _F(AMBIENT) + _F(1 - AMBIENT) * (-lit if facing > 0 else lit)
    glint = looks[_GLOSS] * max(mirrored, _F(0)) ** 16
    _texel(page, abs(u * looks[_DENSITY] + looks[_SHIFT]), abs(v * looks[_DENSITY] + looks[_SHIFT + 1]), out)
    for k in range(3):
        value = (out[k] * looks[_GAIN] + looks[_BIAS + k]) * shade + glint
        out[k] = min(max(value, _F(0)), _F(1))


@njit(cache=True, nogil=True, fastmath=True)
def _origins(geometry: NDArray, camera: NDArray) -> tuple[NDArray, NDArray]:
    """The camera's centre in the primitives' frames (P, 3), and spheres about them (P, 5).

    A sphere is the centre less the camera's, its squared distance, and its squared radius.
    """
    count = geometry.shape[0]
    local, spheres = np.zeros((count, 3), np.float32), np.zeros((count, 5), np.float32)
    for p in range(count):
        for k in range(3):
            spheres[p, k] = geometry[p, _CENTRE + k] - camera[k, 3]
            spheres[p, 3] += spheres[p, k] * spheres[p, k]
            spheres[p, 4] += geometry[p, _EXTENT + k] * geometry[p, _EXTENT + k]
        for k in range(3):
            for j in range(3):
                local[p, k] -= geometry[p, _ROTATION + 3 * k + j] * spheres[p, j]
    return local, spheres


@njit(cache=True, nogil=True, fastmath=True)
def _trace(
    ids: NDArray,
    geometry: NDArray,
    looks: NDArray,
    textures: NDArray,
    camera: NDArray,
    samples: int,
    image: NDArray,
    depth: NDArray,
) -> None:
    local, spheres = _origins(geometry, camera)
    side, light = depth.shape[0], camera[:, 7]
    d, ray, best_ray, colour = np.empty((4, 3), np.float32)
    share, middle = _F(1) / (samples * samples), (samples * samples) // 2
    for pixel in range(side * side):
        row, column = pixel // side, pixel % side
        for q in range(samples * samples):
            x, y = column + (q % samples + _F(0.5)) / samples, row + (q // samples + _F(0.5)) / samples
            d2 = _F(0)
            for k in range(3):
                d[k] = _F(0)
                for j in range(3):
                    d[k] += camera[k, j] * (camera[j, 4] * x + camera[j, 5] * y + camera[j, 6])
                d2 += d[k] * d[k]
            best, at, axis = _NOTHING, -1, -1
            for p in range(ids.shape[0]):
                along = d[0] * spheres[p, 0] + d[1] * spheres[p, 1] + d[2] * spheres[p, 2]
                if spheres[p, 3] - along * along / d2 > spheres[p, 4]:
                    continue
                for k in range(3):
                    at_k = _ROTATION + 3 * k
                    ray[k] = geometry[p, at_k] * d[0] + geometry[p, at_k + 1] * d[1] + geometry[p, at_k + 2] * d[2]
                extent, face = geometry[p, _EXTENT:_ROTATION], -1
                if ids[p, 0] == ELLIPSOID:
                    t = _hit_ellipsoid(local[p], ray, extent)
                else:
                    t, face = _hit_box(local[p], ray, extent, ids[p, 0] == ROOM)
                if NEAREST <= t < best:
                    best, at, axis = t, p, face
                    best_ray[:] = ray
            if at < 0:
                continue
            if q == middle:
                depth[row, column] = best
            for k in range(3):
                best_ray[k] = local[at, k] + best * best_ray[k]
            page = textures[ids[at, 1]]
            _shade(best_ray, axis, geometry[at], looks[at], page, light, d, colour)
            for k in range(3):
                image[row, column, k] += colour[k] * share
