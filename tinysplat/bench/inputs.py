"""What benchmarks run on: photos with cameras, and Gaussians made from them.

    room        ray-traced, any size and number of views, exact depth, photos at cameras in between
    motorcycle  scikit-image's Middlebury stereo pair, real photos with measured depth, where scikit-image is installed
    a user's    scene folders with `eval_index.json`, or Gaussian files

Gaussians are a network's, a file's, or made from the room (`bench.dressing`).
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
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.graphs.predict import predict
from tinysplat_runtime.render import between
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.images import resize_cover
from tinysplat_runtime.system.files import StrPath

from ..evaluation.sources import FileSource, FolderSource, Window, find_sources
from . import room
from .dressing import network_like

# Calibration of scikit-image's motorcycle pair at 741×500, from the Middlebury 2014 data set.
FOCAL_PX, BASELINE_M, CX_PX, CY_PX = 994.978, 0.193001, (311.193, 342.279), 254.877


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
        c2w = np.eye(4)
        c2w[0, 3] = index * BASELINE_M
        K = np.array([[FOCAL_PX, 0, CX_PX[index]], [0, FOCAL_PX, CY_PX], [0, 0, 1]])
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
    photos = Room(views).context(height, width)
    assert photos.depths is not None
    return network_like(photos.images, photos.depths, photos.cameras, degree)


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
    depth = np.zeros(disparity.shape)
    depth[known] = FOCAL_PX * BASELINE_M / (disparity[known] + CX_PX[1] - CX_PX[0])
    return np.stack([left, right]), depth


def _nearest(depth: NDArray, camera: Camera, to: Camera) -> NDArray:
    """Depth at another size of the same view: a step must not be averaged away."""
    y, x = np.mgrid[: to.height, : to.width] + 0.5
    pixels = np.stack([x, y, np.ones_like(x)], axis=-1) @ (camera.K @ np.linalg.inv(to.K)).T
    column = pixels[..., 0].astype(int).clip(0, camera.width - 1)
    row = pixels[..., 1].astype(int).clip(0, camera.height - 1)
    return depth[row, column].astype(np.float32)


def truncated(gaussians: Gaussians, degree: int) -> Gaussians:
    """The same Gaussians with the bands above `degree` cut off, in all layers."""
    return replace(
        gaussians,
        sh=np.ascontiguousarray(gaussians.sh[..., : (degree + 1) ** 2, :]),
        extra_layers=tuple(truncated(layer, degree) for layer in gaussians.extra_layers),
    )
