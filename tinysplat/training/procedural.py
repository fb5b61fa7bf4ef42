"""Procedural scenes with exact depth: rooms, tables, clutter, fences, far backdrops, seen along a short camera path.

Aimed also at where matching fails: blank and dark surfaces, thin repeated structure, a few near things before
something very far, glossy objects. Everything follows from one random generator.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .samples import Sample
from .tracer import BOX, ELLIPSOID, ROOM, Primitive, trace

_RAYS = 2
"""Rays per pixel along each axis."""


@dataclass
class _Builder:
    """Primitives as they are added.

    Attributes:
        rng: of the scene.
        textures: (T, S, S, 3) uint8.
        focal: pixels; textures are as fine as pixels at their distance, more or less.
    """

    rng: np.random.Generator
    textures: NDArray
    focal: float
    primitives: list[Primitive] = field(default_factory=list)

    def add(self, kind: int, centre: NDArray, rotation: NDArray, extent: NDArray, **looks: object) -> None:
        """One primitive; `looks` replaces what would be drawn at random for texture, gain or bias."""
        rng = self.rng
        contrast = rng.uniform(0.05, 0.4) if rng.random() < 0.25 else rng.uniform(0.6, 1.1)
        distance = max(abs(centre[2]), 1.5)
        drawn = {
            "texture": self.texture(),
            "density": self.focal / distance * math.exp(rng.normal(-0.05, 0.4)),
            "shift": rng.random(2) * 400 + 4000,
            "gain": contrast,
            "bias": (1 - contrast) * rng.random(3) * 0.9 + rng.normal(0, 0.04, 3),
            "gloss": rng.uniform(0.1, 0.6) if rng.random() < 0.1 else 0.0,
        }
        self.primitives.append(Primitive(kind, centre, rotation.T, np.maximum(extent, 0.008), **{**drawn, **looks}))

    def texture(self) -> NDArray:
        """One of them."""
        return self.textures[self.rng.integers(len(self.textures))]


def euler(roll: float, yaw: float, pitch: float) -> NDArray:
    """Rotation R_z(roll) R_y(yaw) R_x(pitch), (3, 3) float64, radians."""
    (cr, cy, cp), (sr, sy, sp) = np.cos([roll, yaw, pitch]), np.sin([roll, yaw, pitch])
    z = np.array([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1]])
    y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    x = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
    return z @ y @ x


def procedural_sample(
    rng: np.random.Generator, textures: NDArray, side: int, views: int, target_sides: Sequence[int]
) -> Sample:
    """A scene and its pictures.

    Args:
        rng: everything random.
        textures: (T, h, w, 3) uint8 of `texture_bank`.
        side: of the square views, pixels.
        views: how many.
        target_sides: of each target, pixels.
    """
    focal = rng.uniform(0.75, 1.8) * side
    K = np.array([[focal, 0, side / 2], [0, focal, side / 2], [0, 0, 1]])
    K[:2, 2] += rng.normal(0, 0.03 * side, 2)
    builder = _Builder(rng, textures, focal)
    depth = _furnish(builder, side / focal)
    cameras = _cameras(rng, depth, views, len(target_sides))
    light = rng.normal(size=3)
    light /= np.linalg.norm(light)
    images, intrinsics, depths = [], [], []
    for c2w, size in zip(cameras, [side] * views + list(target_sides), strict=True):
        intrinsics.append(np.diag([size / side, size / side, 1]) @ K)
        image, z = trace(builder.primitives, light, intrinsics[-1], c2w, size, _RAYS)
        images.append(image)
        depths.append(z)
    images = _photographed(rng, images)
    exact = np.stack(depths[:views])
    seen = exact[exact > 0]
    near, far = np.quantile(seen, 0.005) * rng.uniform(0.7, 1.0), np.quantile(seen, 0.995) * rng.uniform(1.0, 1.4)
    if rng.random() < 0.1:
        near, far = near * rng.uniform(0.4, 1), far * rng.uniform(1, 3)
    pictures = list(zip(images, intrinsics, cameras, strict=True))
    depth_range = (float(near), float(max(far, 1.05 * near)))
    return Sample.of("procedural", pictures[:views], pictures[views:], depth_range, exact)


def _furnish(b: _Builder, spread: float) -> float:
    """Put a scene together; the depth of its middle. `spread` is the picture's width at unit depth."""
    rng = b.rng
    back = rng.uniform(4, 9)
    outdoors = rng.random() < 0.25
    if outdoors:  # a far backdrop and a ground that runs towards it
        back *= math.exp(rng.uniform(0.3, 2.2))
        b.add(
            BOX,
            np.array([0, rng.uniform(0.8, 2.5), back / 2]),
            euler(0, rng.normal(0, 0.3), rng.normal(0, 0.04)),
            np.array([60, 0.03, back]),
        )
    elif rng.random() < 0.6:
        middle = np.array([rng.normal(0, 0.5), rng.normal(0, 0.4), back - 6])
        turn = euler(*rng.normal(0, [0.05, 0.5, 0.15]))
        b.add(ROOM, middle, turn, np.array([rng.uniform(1.8, 5), rng.uniform(1, 3), 6.0]))
    b.add(BOX, np.array([0, 0, back + 3.0]), euler(*rng.normal(0, [0.1, 0.4, 0.4])), np.array([120, 120, 0.05]))
    if rng.random() < 0.5:  # a table
        b.add(
            BOX,
            np.array([0, rng.uniform(0.5, 1.6), rng.uniform(2, 5)]),
            euler(*rng.normal(0, [0.1, 0.6, 0.25])),
            np.array([rng.uniform(0.6, 6), 0.03, rng.uniform(0.6, 5)]),
        )
    for _ in range(rng.integers(2, 11)):
        _thing(b, back if not outdoors else min(back, 12.0), spread)
    if rng.random() < 0.3:
        _fence(b, spread)
    if rng.random() < 0.2:
        _clutter(b, spread)
    return min(0.5 * back, 4.5)


def _place(b: _Builder, z: float, spread: float) -> NDArray:
    return np.array([*(b.rng.uniform(-0.6, 0.6, 2) * z * spread), z])


def _thing(b: _Builder, back: float, spread: float) -> None:
    """A box, a panel, a post or an ellipsoid."""
    rng = b.rng
    z = rng.uniform(1.8, back)
    extent = rng.uniform(0.08, 0.3) * z * spread * rng.uniform(0.3, 1.5, 3)
    shape = rng.integers(4)
    if shape == 0:
        extent[2] = 0.01
    elif shape == 1:
        extent[rng.integers(2)] *= 0.2
    turn = rng.normal(0, [0.5, 0.6, 0.4] if shape == 0 else [0.7, 0.7, 0.5])
    b.add(ELLIPSOID if shape == 3 else BOX, _place(b, z, spread), euler(*turn), extent)


def _fence(b: _Builder, spread: float) -> None:
    """Equal thin bars in a row: thin and repeated, at a distance from what is behind."""
    rng = b.rng
    z = rng.uniform(1.8, 4.5)
    bars, gap = rng.integers(4, 16), rng.uniform(0.04, 0.12) * z * spread
    turn = euler(*rng.normal(0, [0.8, 0.4, 0.2]))
    extent = np.array([rng.uniform(0.1, 0.25) * gap, rng.uniform(0.2, 0.8) * z * spread, 0.2 * gap])
    looks = {"texture": b.texture(), "gain": rng.uniform(0.1, 0.7), "bias": rng.random(3) * 0.4}
    middle = _place(b, z, 0.6 * spread)
    kind = ELLIPSOID if rng.random() < 0.4 else BOX
    for i in range(bars):
        b.add(kind, middle + turn @ np.array([(i - bars / 2) * gap, 0, 0]), turn, extent, **looks)


def _clutter(b: _Builder, spread: float) -> None:
    """Many small leaves in a cloud, as of a plant."""
    rng = b.rng
    z = rng.uniform(2, 4.5)
    middle, size = _place(b, z, 0.7 * spread), rng.uniform(0.1, 0.3) * z * spread
    looks = {"texture": b.texture(), "gain": rng.uniform(0.3, 1.0)}
    for _ in range(rng.integers(12, 40)):
        extent = size * rng.uniform(0.05, 0.3, 3) * np.array([1, 1, 0.1])
        b.add(ELLIPSOID, middle + rng.normal(0, 0.5 * size, 3), euler(*rng.normal(0, 1.0, 3)), extent, **looks)


def _cameras(rng: np.random.Generator, depth: float, views: int, targets: int) -> list[NDArray]:
    """c2w of context and target cameras along a line of 0.04 to 0.5 depths, turned towards a common point."""
    baseline = depth * math.exp(rng.uniform(math.log(0.04), math.log(0.5)))
    angle = rng.normal(0, 0.6) + (math.pi if rng.random() < 0.5 else 0)
    direction = np.array([math.cos(angle), math.sin(angle), rng.normal(0, 0.25)])
    direction /= np.linalg.norm(direction)
    convergence, pivot = rng.uniform(0, 1.1), rng.uniform(0.6, 1.8) * depth
    base = euler(*rng.normal(0, [0.1, 0.05, 0.05]))
    places = [*np.linspace(-0.5, 0.5, views)]
    places += [rng.uniform(-0.5, 0.5) if rng.random() < 0.85 else rng.uniform(-0.8, 0.8) for _ in range(targets)]
    cameras = []
    for i, place in enumerate(places):
        centre = direction * baseline * place + (rng.normal(0, 0.08, 3) * baseline if i > 1 else 0)
        yaw, pitch = -convergence * centre[0] / pivot, convergence * centre[1] / pivot
        c2w = np.eye(4)
        c2w[:3, :3] = base @ euler(*(np.array([0, yaw, pitch]) + rng.normal(0, 0.02, 3)))
        c2w[:3, 3] = centre
        cameras.append(c2w)
    return cameras


def _photographed(rng: np.random.Generator, images: Sequence[NDArray]) -> list[NDArray]:
    """Tone curve, darkness, noise and small differences of exposure between the pictures."""
    power, gain = rng.uniform(0.7, 1.4), rng.uniform(0.25, 0.7) if rng.random() < 0.12 else 1.0
    noise = rng.uniform(0, 0.004)
    photos = []
    for image in images:
        exposed = image**power * (gain * (1 + rng.normal(0, 0.006)))
        photos.append(np.clip(exposed + rng.normal(0, noise, image.shape), 0, 1).astype(np.float32))
    return photos
