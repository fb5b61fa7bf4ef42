"""Gaussians that are made: photos and depth dressed as a network's output, so that the codec meets realistic
statistics without a checkpoint, and clouds for the rasteriser.

All is made in float64 and rounded at the end: sines, exponentials and matrix products differ in their last bits with a
processor's vector instructions, which the float32 that comes out does not show.

Dressed are per-pixel Gaussians whose attributes follow the picture as MVSplat's planes do, up to SH degree 4. Shares of
smooth field, picture and fine noise are set by eye, and by the sizes and dB that the paper's configuration reaches.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.quaternions import matrices_to_quats, multiply_quats
from tinysplat_runtime.gaussian.sh import C0, sh_basis
from tinysplat_runtime.scene.cameras import Camera

from .room import Room


def network_like(images: NDArray, depths: NDArray, cameras: Sequence[Camera], degree: int) -> Gaussians:
    """Per-pixel Gaussians with the look of a feedforward network's output.

    Every attribute is a smooth field plus a function of the picture plus a little fine noise; SH bands fall by 4 from
    one to the next and follow eight latent fields. What is seen from a Gaussian's own camera is the photo.

    Args:
        images: (V, H, W, 3) float in [0, 1].
        depths: (V, H, W) float z, > 0.
        cameras: one per view.
        degree: SH degree, 0 to 4.
    """
    views = [
        _dress(image, depth, camera, degree, np.random.default_rng([0, view]))
        for view, (image, depth, camera) in enumerate(zip(images, depths, cameras, strict=True))
    ]
    arrays = {name: np.stack([view[name] for view in views]) for name in views[0]}
    return Gaussians(cameras=tuple(cameras), **arrays)  # type: ignore[arg-type]


def _dress(image: NDArray, depth: NDArray, camera: Camera, degree: int, rng: np.random.Generator) -> dict[str, NDArray]:
    """One view of `network_like`."""
    fields = _Fields(image, depth, rng)
    height, width = depth.shape
    waver = 0.003 * fields.smooth(16) + 0.001 * fields.smooth(3) + 0.0004 * fields.smooth(0.7)
    z = depth.astype(np.float64) * (1 + waver)
    v, u = np.mgrid[:height, :width] + 0.5
    pixels = np.stack([u + 0.2 * fields.draw(), v + 0.2 * fields.draw(), np.ones_like(u)], axis=-1)
    means = ((pixels @ np.linalg.inv(camera.K).T) * z[..., None]) @ camera.rotation + camera.centre
    size = 0.4 * fields.draw()
    axes = np.stack([-0.9 + 0.3 * k + size + 0.2 * fields.draw() for k in range(3)], axis=-1)
    quats = np.stack([mean + 0.25 * fields.draw() for mean in (1.0, 0.3, -0.2, 0.4)], axis=-1)
    opacities = 1 / (1 + np.exp(-(1.3 + 0.9 * fields.draw(fine=0.3))))
    directions = (means - camera.centre) / np.linalg.norm(means - camera.centre, axis=-1, keepdims=True)
    return {
        "means": means.astype(np.float32),
        "quats": multiply_quats(matrices_to_quats(camera.rotation.T), quats).astype(np.float32),
        "scales": (np.exp(axes) * z[..., None] / camera.focal).astype(np.float32),
        "opacities": opacities.astype(np.float32),
        "sh": _coefficients(image, directions, degree, fields),
    }


def _coefficients(image: NDArray, directions: NDArray, degree: int, fields: _Fields) -> NDArray:
    """(H, W, B, 3) SH coefficients that show `image` along `directions`."""
    functions = (degree + 1) ** 2
    weights = np.random.default_rng(11).standard_normal((2, 8, functions, 3))  # alike in all views, as a network's are
    band = np.floor(np.sqrt(np.arange(functions)))
    latent = np.stack([fields.draw(fine=0.05) for _ in range(8)], axis=-1)
    sh = (latent @ weights[0].reshape(8, -1)).reshape(*latent.shape[:2], functions, 3) / np.sqrt(8)
    sh = (sh + 0.5 * weights[1, 0]) * (0.2 * 0.25**band)[:, None]
    sh[..., 0, :] = 0
    basis = sh_basis(directions, degree)
    sharpened = image + 0.9 * (image - blur(image, 1.0))  # splatting blurs the picture by about a pixel
    sh[..., 0, :] = (sharpened - 0.5 - np.einsum("hwb,hwbc->hwc", basis, sh)) / C0
    return sh.astype(np.float32)


class _Fields:
    """Random fields (H, W) of unit variance that resemble a network's planes of one picture."""

    def __init__(self, image: NDArray, depth: NDArray, rng: np.random.Generator) -> None:
        image, depth = np.asarray(image, np.float64), np.asarray(depth, np.float64)
        grey = image @ np.array([0.3, 0.59, 0.11])
        maps = [grey, blur(grey, 2), blur(grey, 5), *np.gradient(blur(grey, 1)), image[..., 0] - grey, 1 / depth]
        self._features = np.stack([np.tanh(_standard(m)) for m in maps], axis=-1)
        self._rng = rng
        self._mixing = np.random.default_rng(5)  # alike in all views

    def smooth(self, sigma: float) -> NDArray:
        """Noise without features smaller than `sigma` pixels."""
        return _standard(blur(self._rng.standard_normal(self._features.shape[:2]), sigma))

    def draw(self, fine: float = 0.1) -> NDArray:
        """The next field: half smooth, half of the picture, and `fine` parts of fine noise."""
        weights = self._mixing.standard_normal(self._features.shape[-1])
        picture = _standard(blur(np.tanh(self._features @ weights), 1.5))
        return 0.55 * self.smooth(18) + 0.65 * picture + fine * self.smooth(0.7)


def _standard(values: NDArray) -> NDArray:
    return (values - values.mean()) / max(float(values.std()), 1e-12)


def blur(image: NDArray, sigma: float) -> NDArray:
    """Gaussian blur of (H, W) or (H, W, C) with mirrored borders, float64."""
    from scipy.ndimage import gaussian_filter

    return gaussian_filter(np.asarray(image, np.float64), sigma, mode="mirror", axes=(0, 1))


@lru_cache(maxsize=4)
def made_gaussians(views: int, height: int, width: int, degree: int) -> Gaussians:
    """Network-like Gaussians of the room; the same arguments give the same Gaussians."""
    room = Room(views)
    photos = room.shots(room.windows()[0][0], (height, width)).context
    return network_like(photos.images, np.stack(photos.depths), photos.cameras, degree)


def cloud(count: int) -> Gaussians:
    """Points of a room and beyond it, as many deep however many there are; a third of them lies beside `cloud_camera`'s
    picture. SH of degree 0, as the networks here have it."""
    rng = np.random.default_rng(0)
    z = rng.uniform(2, 12, count).astype(np.float32)
    means = np.stack([*(rng.uniform(-1.3, 1.3, (2, count)).astype(np.float32) * z), z], axis=-1)
    size = 0.016 * np.sqrt(1e6 / count) * np.exp(0.6 * np.float64(rng.standard_normal((count, 3), np.float32)))
    opacities = 1 / (1 + np.exp(-1 - 2 * np.float64(rng.standard_normal(count, np.float32))))
    quats, sh = rng.standard_normal((count, 4), np.float32), rng.standard_normal((count, 1, 3), np.float32)
    return Gaussians.unchecked(
        means=means, quats=quats, scales=size.astype(np.float32), opacities=opacities.astype(np.float32), sh=sh
    )


def cloud_camera(height: int, width: int) -> Camera:
    """At the origin of a `cloud`, a right angle wide."""
    K = np.array([[width / 2, 0, width / 2], [0, width / 2, height / 2], [0, 0, 1]])
    return Camera(K, np.eye(4), width, height)


STATUE = 25_000
"""Gaussians of a made statue."""


def statues(count: int) -> Gaussians:
    """Copies of a statue beside one another in a square, so many Gaussians of SH degree 3: an object seen from outside,
    larger the more there are.
    """
    copies = -(-count // STATUE)
    side = math.ceil(math.sqrt(copies))
    one = _statue()
    arrays = {name: np.tile(values, (copies, *[1] * (values.ndim - 1)))[:count] for name, values in one.items()}
    number = np.repeat(np.arange(copies), STATUE)[:count]
    arrays["means"] += np.float32(2.5) * np.stack([number % side, 0 * number, number // side], axis=-1)
    return Gaussians.unchecked(**arrays)


def _statue() -> dict[str, NDArray]:
    """A ball with bumps, of discs of one size that lie along it."""
    rng, n = np.random.default_rng(0), np.arange(STATUE)
    height, turn = 1 - (2 * n + 1) / STATUE, n * math.pi * (3 - math.sqrt(5))
    flat = np.sqrt(1 - height * height)
    towards = np.stack([flat * np.cos(turn), height, flat * np.sin(turn)], axis=-1)
    bumps = np.sin(5 * towards[:, 0]) * np.sin(7 * towards[:, 1]) + np.sin(9 * towards[:, 2] + 3 * towards[:, 0])
    stripes = np.sin(towards @ (20 * rng.standard_normal((3, 3))))
    size = math.sqrt(4 * math.pi / STATUE) * np.exp(0.3 * rng.standard_normal((STATUE, 3)))
    sh = 0.04 * rng.standard_normal((STATUE, 16, 3))
    sh[:, 0] = 0.8 * stripes + 0.3 * bumps[:, None]
    arrays = {
        "means": (1 + 0.1 * bumps[:, None]) * towards,
        "quats": np.concatenate([1 + towards[:, 2:], np.cross([0, 0, 1], towards)], axis=1),  # turns z outwards
        "scales": 0.8 * size * [1, 1, 0.15],
        "opacities": 1 / (1 + np.exp(-2 - 2 * rng.standard_normal(STATUE))),
        "sh": sh,
    }
    return {name: values.astype(np.float32) for name, values in arrays.items()}
