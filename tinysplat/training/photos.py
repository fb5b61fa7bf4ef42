"""Windows of real posed photos: two context views, a view between them to predict, crops about a common point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.images import read_image, resize_cover
from tinysplat_runtime.scene.intake.cameras_json import CAMERAS_FILE
from tinysplat_runtime.scene.intake.layouts import load_scene

from .samples import Sample

BASELINES = (0.04, 0.4)
"""Distance of the context cameras in units of the scene's typical depth."""

MAX_ANGLE = 30.0
"""Between the viewing directions of any two views of a window, degrees."""

BETWEEN = (-0.1, 1.1)
"""Where a target stands along the line of the contexts; and no further beside it than `ASIDE` baselines."""

ASIDE = 0.6


@dataclass(frozen=True)
class PhotoScene:
    """The photos of one scene in memory.

    Attributes:
        name: of its folder.
        images: of every frame, (H, W, 3) uint8.
        K: (N, 3, 3) pixels.
        c2w: (N, 4, 4).
        near, far: scene units.
        windows: (i, j, candidates for targets), i < j.
    """

    name: str
    images: tuple[NDArray, ...]
    K: NDArray
    c2w: NDArray
    near: float
    far: float
    windows: tuple[tuple[int, int, NDArray], ...]


@dataclass(frozen=True)
class PhotoSet:
    """All scenes of a folder.

    Attributes:
        scenes: those with at least one window.
        skipped: a line for every photo that could not be read.
    """

    scenes: tuple[PhotoScene, ...]
    skipped: tuple[str, ...]

    @classmethod
    def load(cls, folder: Path) -> PhotoSet:
        """Read every scene folder in `folder`; photos that cannot be read are skipped and noted.

        Raises:
            InputError: there is no scene with a window to train on.
        """
        skipped: list[str] = []
        paths = sorted(path.parent for path in folder.glob(f"*/{CAMERAS_FILE}"))
        scenes = tuple(scene for path in paths if (scene := _load_scene(path, skipped)).windows)
        if not scenes:
            found = f"{len(paths)} scene folders, none with two views to train on" if paths else "no scene folders"
            raise InputError(f"{found}, expected folders with {CAMERAS_FILE} and photos", where=str(folder))
        return cls(scenes, tuple(skipped))

    def sample(self, rng: np.random.Generator, side: int, targets: int) -> Sample:
        """A random window, cropped to `side` × `side` about a common point, now and then mirrored or recoloured."""
        share = np.sqrt([len(scene.windows) for scene in self.scenes])
        scene = self.scenes[rng.choice(len(self.scenes), p=share / share.sum())]
        i, j, candidates = scene.windows[rng.integers(len(scene.windows))]
        frames = [i, j] if rng.random() < 0.5 else [j, i]
        frames += list(rng.choice(candidates, targets))
        smallest = min(min(scene.images[f].shape[:2]) for f in frames)
        crop = min(smallest, round(side / rng.uniform(min(side / smallest, 1.0), 1.0)))
        images, K = _crops(scene, frames, crop, side, rng)
        c2w = scene.c2w[frames]
        if rng.random() < 0.5:
            images, K, c2w = _mirrored(images, K, c2w)
        if rng.random() < 0.5:
            images, K, c2w = _transposed(images, K, c2w)
        images = _recoloured(images, rng)
        depth_range = (scene.near * rng.uniform(0.75, 1.05), scene.far * rng.uniform(0.95, 1.3))
        return Sample.of(scene.name, images, K, c2w, depth_range, 2)


def _load_scene(path: Path, skipped: list[str]) -> PhotoScene:
    scene = load_scene(path)
    near, far = scene.depth_range()
    images, cameras = [], []
    for frame in scene.frames:
        try:
            pixels = read_image(frame.path)
            if pixels.shape[:2] != (frame.camera.height, frame.camera.width):
                raise InputError("size differs from the camera's", where=str(frame.path))
        except (InputError, OSError) as error:
            skipped.append(str(error))
            continue
        images.append(pixels)
        cameras.append(frame.camera)
    if not cameras:
        return PhotoScene(path.name, (), np.zeros((0, 3, 3)), np.zeros((0, 4, 4)), near, far, ())
    K, c2w = np.stack([camera.K for camera in cameras]), np.stack([camera.c2w for camera in cameras])
    windows = _windows(c2w, (near * far) ** 0.5)
    return PhotoScene(path.name, tuple(images), K, c2w, near, far, tuple(windows))


def _windows(c2w: NDArray, typical_depth: float) -> Sequence[tuple[int, int, NDArray]]:
    """Pairs of frames and what stands between them."""
    centre, forward = c2w[:, :3, 3], c2w[:, :3, 2]
    angle = np.degrees(np.arccos(np.clip(forward @ forward.T, -1, 1)))
    distance = np.linalg.norm(centre[:, None] - centre[None], axis=-1) / typical_depth
    fits = (distance > BASELINES[0]) & (distance < BASELINES[1]) & (angle < MAX_ANGLE)
    found = []
    for i, j in np.argwhere(np.triu(fits)):
        line = centre[j] - centre[i]
        along = (centre - centre[i]) @ line / (line @ line)
        beside = np.linalg.norm(centre - centre[i] - along[:, None] * line, axis=1) / np.linalg.norm(line)
        is_target = (along > BETWEEN[0]) & (along < BETWEEN[1]) & (beside < ASIDE)
        is_target &= np.maximum(angle[i], angle[j]) < MAX_ANGLE
        is_target[[i, j]] = False
        if is_target.any():
            found.append((int(i), int(j), np.flatnonzero(is_target)))
    return found


def _crops(
    scene: PhotoScene, frames: Sequence[int], crop: int, side: int, rng: np.random.Generator
) -> tuple[NDArray, NDArray]:
    """Square crops of `crop` pixels about where a random point of the first view appears, scaled to `side`."""
    first = frames[0]
    size = np.array(scene.images[first].shape[1::-1])
    pixel = crop / 2 + rng.random(2) * (size - crop)
    depth = 1.3 * 2 / (1 / scene.near + 1 / scene.far)
    point = scene.c2w[first] @ np.append(np.linalg.solve(scene.K[first], np.append(pixel, 1)) * depth, 1)
    images, intrinsics = [], []
    for frame in frames:
        local = np.linalg.inv(scene.c2w[frame]) @ point
        shown = scene.K[frame] @ local[:3]
        size = np.array(scene.images[frame].shape[1::-1])
        x, y = np.clip(shown[:2] / max(shown[2], 1e-3) - crop / 2, 0, size - crop).astype(int)
        images.append(resize_cover(scene.images[frame][y : y + crop, x : x + crop], side, side))
        K = scene.K[frame].copy()
        K[:2, 2] -= x, y
        K[:2] *= side / crop
        intrinsics.append(K)
    return np.stack(images), np.stack(intrinsics)


def _recoloured(images: NDArray, rng: np.random.Generator) -> NDArray:
    """Other light: channels swapped, a tone curve, a gain per channel, and small differences between the pictures."""
    if rng.random() < 0.3:
        images = images[..., rng.permutation(3)]
    if rng.random() < 0.6:
        images = images ** np.float32(rng.uniform(0.6, 1.6)) * rng.uniform(0.5, 1.1, 3).astype(np.float32)
    exposures = 1 + rng.normal(0, 0.01, (len(images), 1, 1, 1))
    return np.clip(images * exposures, 0, 1).astype(np.float32)


def _transposed(images: NDArray, K: NDArray, c2w: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """The mirror image of the world at the diagonal: rows and columns swapped in square pictures without skew."""
    swap = np.eye(4)[[1, 0, 2, 3]]
    return images.transpose(0, 2, 1, 3), swap[:3, :3] @ K @ swap[:3, :3], swap @ c2w @ swap


def _mirrored(images: NDArray, K: NDArray, c2w: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """The mirror image of the world: left and right swapped in pictures and cameras."""
    flip = np.diag([-1.0, 1, 1, 1])
    mirrored = K.copy()
    mirrored[:, 0, 2] = images.shape[2] - K[:, 0, 2]
    mirrored[:, 0, 1] *= -1
    return images[:, :, ::-1], mirrored, flip @ c2w @ flip
