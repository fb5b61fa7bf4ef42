"""What benchmarks run on: photos with cameras, and Gaussians made from them.

    room        ray-traced, any size and number of views, exact depth, photos at cameras in between
    motorcycle  scikit-image's Middlebury stereo pair, real photos with measured depth, where scikit-image is installed
    a user's    scene folders with `eval_index.json`, or Gaussian files

`network_like` dresses photos and depth as a network's output: per-pixel Gaussians whose attributes follow the picture
as MVSplat's do, up to SH degree 4, so that the codec meets realistic statistics without a checkpoint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.cameras import Camera
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.files import StrPath
from tinysplat_runtime.gaussians import Gaussians
from tinysplat_runtime.images import resize_cover
from tinysplat_runtime.predict import predict
from tinysplat_runtime.quaternions import matrices_to_quats, multiply_quats
from tinysplat_runtime.render import between
from tinysplat_runtime.sh import C0, sh_basis

from ..evaluation.sources import FileSource, FolderSource, Window, find_sources
from . import room

MIDDLEBURY = {"focal": 994.978, "baseline": 0.193001, "cx": (311.193, 342.279), "cy": 254.877}
"""Calibration of scikit-image's motorcycle pair at 741×500: pixels and metres (Middlebury 2014)."""


@dataclass(frozen=True, eq=False)
class Photos:
    """Views of one size.

    Attributes:
        images: (V, H, W, 3) float32 in [0, 1].
        cameras: one per view.
        depths: (V, H, W) float32 true z, 0 where unknown, or None.
    """

    images: NDArray
    cameras: tuple[Camera, ...]
    depths: NDArray | None = None


class PhotoSource(Protocol):
    """A scene that can be photographed at any size."""

    @property
    def name(self) -> str:
        """For reports."""

    @property
    def depth_range(self) -> tuple[float, float]:
        """near, far."""

    def context(self, height: int, width: int) -> Photos:
        """What a network gets."""

    def targets(self, height: int, width: int) -> Photos:
        """Photos from elsewhere, that the network's Gaussians are held against; V may be 0."""


@dataclass(frozen=True)
class Room:
    """See `bench.room`."""

    views: int = 2

    @property
    def name(self) -> str:
        """For reports."""
        return "room"

    @property
    def depth_range(self) -> tuple[float, float]:
        """near, far."""
        return room.NEAR, room.FAR

    def context(self, height: int, width: int) -> Photos:
        """The input views."""
        return _room_photos(self.views, height, width, False)

    def targets(self, height: int, width: int) -> Photos:
        """Three views between the middle pair."""
        return _room_photos(self.views, height, width, True)


@dataclass(frozen=True)
class Motorcycle:
    """The stereo pair; its measured depth belongs to the left view alone."""

    @property
    def name(self) -> str:
        """For reports."""
        return "motorcycle"

    @property
    def depth_range(self) -> tuple[float, float]:
        """near, far."""
        return 2.0, 5.1

    def context(self, height: int, width: int) -> Photos:
        """Both photos."""
        photos, depth = _motorcycle()
        full = [self._camera(i, photos.shape[1], photos.shape[2]) for i in (0, 1)]
        images = np.stack([resize_cover(photo, height, width) for photo in photos])
        cameras = tuple(camera.resized(height, width) for camera in full)
        left = _nearest(depth, full[0], cameras[0])
        return Photos(images, cameras, np.stack([left, np.zeros_like(left)]))

    def targets(self, height: int, width: int) -> Photos:
        """None: there is no third photo."""
        return Photos(np.zeros((0, height, width, 3), np.float32), ())

    @staticmethod
    def _camera(index: int, height: int, width: int) -> Camera:
        focal = MIDDLEBURY["focal"]
        c2w = np.eye(4)
        c2w[0, 3] = index * MIDDLEBURY["baseline"]  # type: ignore[operator]
        K = np.array([[focal, 0, MIDDLEBURY["cx"][index]], [0, focal, MIDDLEBURY["cy"]], [0, 0, 1]])  # type: ignore[index]
        return Camera(K, c2w, width, height)


@dataclass(frozen=True)
class Folder:
    """A window of a user's scene."""

    source: FolderSource
    window: Window

    @property
    def name(self) -> str:
        """For reports."""
        return f"{self.source.name} {self.window}"

    @property
    def depth_range(self) -> tuple[float, float]:
        """near, far."""
        return self.source.scene().depth_range()

    def context(self, height: int, width: int) -> Photos:
        """The window's context frames."""
        return self._photos(self.window.context, height, width)

    def targets(self, height: int, width: int) -> Photos:
        """The window's target frames."""
        return self._photos(self.window.targets, height, width)

    def _photos(self, indices: Sequence[int], height: int, width: int) -> Photos:
        scene = self.source.scene().views(indices).resized(height, width)
        return Photos(scene.images(), tuple(scene.cameras))


@dataclass(frozen=True, eq=False)
class Case:
    """Gaussians, and the pictures that their coding is judged by.

    Attributes:
        name: for reports.
        gaussians: per pixel, with cameras.
        cameras: input views and views in between.
        photos: one (H, W, 3) per camera, or None where there is none.
    """

    name: str
    gaussians: Gaussians
    cameras: tuple[Camera, ...]
    photos: tuple[NDArray | None, ...]


def network_case(source: PhotoSource, model: str, height: int, width: int, runtime: Runtime) -> Case:
    """A network's Gaussians of a scene, judged at its input views and targets."""
    context, targets = source.context(height, width), source.targets(height, width)
    near, far = source.depth_range
    gaussians = predict(context.images, context.cameras, near, far, runtime.store.network(model))
    name = f"{model} on {source.name}, {len(context.cameras)}×{height}×{width}"
    return _case(name, gaussians, context, targets)


def made_case(views: int, height: int, width: int, degree: int) -> Case:
    """Network-like Gaussians of the room."""
    source = Room(views)
    context, targets = source.context(height, width), source.targets(height, width)
    name = f"network-like, room, {views}×{height}×{width}, SH degree {degree}"
    return _case(name, made_gaussians(views, height, width, degree), context, targets)


@lru_cache(maxsize=4)
def made_gaussians(views: int, height: int, width: int, degree: int) -> Gaussians:
    """Network-like Gaussians of the room; the same arguments give the same Gaussians."""
    return network_like(Room(views).context(height, width), degree)


def file_case(source: FileSource, size: tuple[int, int]) -> Case:
    """A user's Gaussian file, judged at its views and between them."""
    (window,), _ = source.windows()
    loaded = source.load(window, "", size, Runtime(threads=1))
    gaussians = loaded.gaussians
    cameras = (*gaussians.cameras, *loaded.cameras)
    return Case(source.name, gaussians, cameras, (None,) * len(cameras))


def user_inputs(paths: Sequence[StrPath]) -> tuple[list[Folder], list[FileSource], list[str]]:
    """Scenes and Gaussian files that paths name; the first window of each scene; what was left out, one line each.

    Raises:
        InputError: nothing at all can be used.
    """
    scenes: list[Folder] = []
    files: list[FileSource] = []
    left_out: list[str] = []
    for path in paths:
        sources, lost = find_sources([Path(path)])
        left_out += map(str, lost)
        for source in sources:
            if isinstance(source, FileSource):
                files.append(source)
                continue
            if not isinstance(source, FolderSource):
                left_out.append(f"left out {source.name}: bench takes scene folders and Gaussian files")
                continue
            try:
                windows, lost = source.windows()
            except InputError as error:
                left_out.append(f"left out {error}")
                continue
            left_out += map(str, lost)
            scenes += [Folder(source, window) for window in windows[:1]]
    if paths and not scenes and not files:
        raise InputError("; ".join(left_out) or "nothing to measure", where="bench")
    return scenes, files, left_out


def _case(name: str, gaussians: Gaussians, context: Photos, targets: Photos) -> Case:
    photos: tuple[NDArray | None, ...] = (*context.images, *targets.images)
    cameras = (*context.cameras, *targets.cameras)
    if not targets.cameras:  # no photo lies between the views, but pictures do
        middle = tuple(between(context.cameras, 3)[1:2])
        cameras, photos = cameras + middle, (*photos, *(None for _ in middle))
    return Case(name, gaussians, cameras, photos)


@lru_cache(maxsize=16)
def _room_photos(views: int, height: int, width: int, is_between: bool) -> Photos:
    cameras = (room.between_cameras if is_between else room.room_cameras)(views, height, width)
    shots = [room.photograph(camera) for camera in cameras]
    return Photos(np.stack([photo for photo, _ in shots]), tuple(cameras), np.stack([depth for _, depth in shots]))


@lru_cache(maxsize=1)
def _motorcycle() -> tuple[NDArray, NDArray]:
    """Photos (2, H, W, 3) uint8 and the left one's z (H, W) in metres, 0 where unknown."""
    try:
        from skimage.data import stereo_motorcycle
    except ImportError:
        raise InputError(
            "needs the package 'scikit-image'; pip install \"tinysplat[demo]\" brings it", where="motorcycle"
        ) from None
    left, right, disparity = stereo_motorcycle()
    known = np.isfinite(disparity) & (disparity > 0)
    between_principal_points = MIDDLEBURY["cx"][1] - MIDDLEBURY["cx"][0]  # type: ignore[index]
    depth = np.zeros(disparity.shape)
    depth[known] = MIDDLEBURY["focal"] * MIDDLEBURY["baseline"] / (disparity[known] + between_principal_points)  # type: ignore[operator]
    return np.stack([left, right]), depth


def _nearest(depth: NDArray, camera: Camera, to: Camera) -> NDArray:
    """Depth at another size of the same view: a step must not be averaged away."""
    y, x = np.mgrid[: to.height, : to.width] + 0.5
    pixels = np.stack([x, y, np.ones_like(x)], axis=-1) @ (camera.K @ np.linalg.inv(to.K)).T
    column = pixels[..., 0].astype(int).clip(0, camera.width - 1)
    row = pixels[..., 1].astype(int).clip(0, camera.height - 1)
    return depth[row, column].astype(np.float32)


def network_like(photos: Photos, degree: int, seed: int = 0) -> Gaussians:
    """Per-pixel Gaussians with the look of a feedforward network's output.

    Every attribute is a smooth field plus a function of the picture plus a little fine noise, the shares by eye from
    MVSplat's planes; SH bands fall by 4 from one to the next and follow eight latent fields. What is seen from a
    Gaussian's own camera is the photo.
    """
    if photos.depths is None:
        raise InputError("no depth, expected photos with it", where="photos")
    layers = [
        _dress(image, depth, camera, degree, np.random.default_rng([seed, view]))
        for view, (image, depth, camera) in enumerate(zip(photos.images, photos.depths, photos.cameras, strict=True))
    ]
    arrays = {name: np.stack([layer[name] for layer in layers]) for name in layers[0]}
    return Gaussians(cameras=photos.cameras, **arrays)  # type: ignore[arg-type]


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
        grey = image @ np.array([0.3, 0.59, 0.11], np.float32)
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
    """Gaussian blur of (H, W) or (H, W, C) with mirrored borders."""
    rows, columns = _blur_matrix(image.shape[0], sigma), _blur_matrix(image.shape[1], sigma)
    channels = np.moveaxis(np.atleast_3d(image), -1, 0)
    return np.moveaxis(rows @ channels @ columns.T, 0, -1).reshape(image.shape)


@lru_cache(maxsize=64)
def _blur_matrix(length: int, sigma: float) -> NDArray:
    """(n, n) whose rows are the weights of a line's blurred samples."""
    radius = max(1, int(np.ceil(3 * sigma)))
    taps = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2)
    period = max(2 * length - 2, 1)
    reach = np.arange(length)[:, None] + np.arange(-radius, radius + 1)
    mirrored = np.abs((reach + length - 1) % period - (length - 1))
    matrix = np.zeros((length, length))
    np.add.at(matrix, (np.arange(length)[:, None], mirrored), taps / taps.sum())
    return matrix


def truncated(gaussians: Gaussians, degree: int) -> Gaussians:
    """The same Gaussians with the bands above `degree` cut off, in all layers."""
    return replace(
        gaussians,
        sh=np.ascontiguousarray(gaussians.sh[..., : (degree + 1) ** 2, :]),
        extra_layers=tuple(truncated(layer, degree) for layer in gaussians.extra_layers),
    )
