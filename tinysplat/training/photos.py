"""Windows of real posed photos: two to four views, others between them to predict, crops about a common point.

A scene's folder may hold labels of depth beside its photos: `depth_mvs/NAME.png` of 16 bits, inverse z in units of
`step` of `depth_mvs/depth.json`, 0 where nothing is known. They are looked at by the losses alone.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.images import read_image
from tinysplat_runtime.scene.intake.cameras_json import CAMERAS_FILE
from tinysplat_runtime.scene.intake.layouts import load_scene
from tinysplat_runtime.scene.resampling import resize_cover

from .samples import Picture, Sample

BASELINES = (0.04, 0.4)
"""Distance of the context cameras in units of the scene's typical depth."""

MAX_ANGLE = 30.0
"""Between the viewing directions of any two views of a window, degrees."""

BETWEEN = (-0.1, 1.1)
"""Where a target stands along the line of the contexts; and no further beside it than `ASIDE` baselines."""

ASIDE = 0.6

FARTHEST_MORE = 0.6
"""Distance of a third or fourth view from the first, in units of the scene's typical depth."""

LABELS = "depth_mvs"


@dataclass(frozen=True)
class TrainingScene:
    """The photos of one scene in memory.

    Attributes:
        name: of its folder.
        images: of every frame, (H, W, 3) uint8.
        K: (N, 3, 3) pixels.
        c2w: (N, 4, 4).
        near, far: scene units.
        windows: (i, j, candidates for targets), i < j.
        depths: z of every frame, (H, W) float32, 0 where it is not known; None for a frame without labels.
    """

    name: str
    images: tuple[NDArray, ...]
    K: NDArray
    c2w: NDArray
    near: float
    far: float
    windows: tuple[tuple[int, int, NDArray], ...]
    depths: tuple[NDArray | None, ...]


def scene_folders(folder: Path, file: str = CAMERAS_FILE) -> list[Path]:
    """Folders in `folder` that have a file, or itself where it has one."""
    return [folder] if (folder / file).is_file() else sorted(path.parent for path in folder.glob(f"*/{file}"))


@dataclass(frozen=True)
class PhotoSet:
    """All scenes of a folder.

    Attributes:
        scenes: those with at least one window.
        skipped: a line for every photo that could not be read.
    """

    scenes: tuple[TrainingScene, ...]
    skipped: tuple[str, ...]

    @classmethod
    def load(cls, folder: Path) -> PhotoSet:
        """Read every scene folder in `folder`, or the one that it is; photos that cannot be read are skipped and noted.

        Raises:
            InputError: there is no scene with a window to train on.
        """
        skipped: list[str] = []
        paths = scene_folders(folder)
        scenes = tuple(scene for path in paths if (scene := _load_scene(path, skipped)).windows)
        if not scenes:
            fault = f"{len(paths)} scene folders, none with two views to train on" if paths else "no scene folders"
            raise InputError(f"{fault}, expected folders with {CAMERAS_FILE} and photos", where=str(folder))
        return cls(scenes, tuple(skipped))

    def sample(self, rng: np.random.Generator, side: int, views: int, target_sides: Sequence[int]) -> Sample:
        """A random window, cropped to squares about a common point, now and then mirrored or recoloured.

        Args:
            rng: everything random.
            side: of the views, pixels.
            views: two or more; fewer where a scene has no more nearby.
            target_sides: of each target, pixels; no photo is enlarged for it.
        """
        share = np.sqrt([len(scene.windows) for scene in self.scenes])
        scene = self.scenes[rng.choice(len(self.scenes), p=share / share.sum())]
        i, j, candidates = scene.windows[rng.integers(len(scene.windows))]
        frames = [i, j] if rng.random() < 0.5 else [j, i]
        targets = [int(f) for f in rng.choice(candidates, len(target_sides))]
        others = _near_to(scene, i, {i, j, *targets})
        frames += [int(f) for f in rng.permutation(others)[: views - 2]]
        count = len(frames)
        frames += targets
        smallest = min(min(scene.images[f].shape[:2]) for f in frames)
        wanted = min(smallest, max(side, *target_sides))
        crop = round(wanted / rng.uniform(wanted / smallest, 1.0))
        crop = min(crop, smallest)
        pictures, depth = _crops(scene, frames, crop, [side] * count + [min(size, crop) for size in target_sides], rng)
        if rng.random() < 0.5:
            pictures, depth = [_mirrored(*picture) for picture in pictures], [z[:, ::-1] for z in depth]
        if rng.random() < 0.5:
            pictures, depth = [_transposed(*picture) for picture in pictures], [z.T for z in depth]
        pictures = _recoloured(pictures, rng)
        depth_range = (scene.near * rng.uniform(0.75, 1.05), scene.far * rng.uniform(0.95, 1.3))
        known = np.stack(depth[:count]) if any(scene.depths[f] is not None for f in frames[:count]) else None
        return Sample.of(scene.name, pictures[:count], pictures[count:], depth_range, known)


def _load_scene(path: Path, skipped: list[str]) -> TrainingScene:
    scene = load_scene(path)
    near, far = scene.depth_range()
    images, cameras, depths = [], [], []
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
        depths.append(_labels(path / LABELS / f"{Path(frame.path).stem}.png", pixels.shape[:2]))
    if not cameras:
        return TrainingScene(path.name, (), np.zeros((0, 3, 3)), np.zeros((0, 4, 4)), near, far, (), ())
    K, c2w = np.stack([camera.K for camera in cameras]), np.stack([camera.c2w for camera in cameras])
    windows = _windows(c2w, (near * far) ** 0.5)
    return TrainingScene(path.name, tuple(images), K, c2w, near, far, tuple(windows), tuple(depths))


def _labels(path: Path, size: tuple[int, ...]) -> NDArray | None:
    """Labels of depth of a photo of this size: z (H, W) float32, 0 where it is not known; None where there are none."""
    if not path.is_file():
        return None
    from PIL import Image

    with Image.open(path) as picture:
        codes = np.asarray(picture)
    if codes.shape != size:
        raise InputError(f"{codes.shape}, expected the photo's size {size}", where=str(path))
    step = json.loads((path.parent / "depth.json").read_text("utf-8"))["step"]
    return np.where(codes > 0, 1 / np.maximum(codes * np.float32(step), 1e-9), 0).astype(np.float32)


def _near_to(scene: TrainingScene, first: int, taken: set[int]) -> list[int]:
    """Further frames that see what a window's first frame sees."""
    centre, forward = scene.c2w[:, :3, 3], scene.c2w[:, :3, 2]
    near = np.linalg.norm(centre - centre[first], axis=1) < FARTHEST_MORE * (scene.near * scene.far) ** 0.5
    near &= forward @ forward[first] > np.cos(np.radians(MAX_ANGLE))
    return [int(f) for f in np.flatnonzero(near) if f not in taken]


def _windows(c2w: NDArray, typical_depth: float) -> Sequence[tuple[int, int, NDArray]]:
    """Pairs of frames and what stands between them."""
    centre, forward = c2w[:, :3, 3], c2w[:, :3, 2]
    angle = np.degrees(np.arccos(np.clip(forward @ forward.T, -1, 1)))
    distance = np.linalg.norm(centre[:, None] - centre[None], axis=-1) / typical_depth
    fits = (distance > BASELINES[0]) & (distance < BASELINES[1]) & (angle < MAX_ANGLE)
    windows = []
    for i, j in np.argwhere(np.triu(fits)):
        line = centre[j] - centre[i]
        along = (centre - centre[i]) @ line / (line @ line)
        beside = np.linalg.norm(centre - centre[i] - along[:, None] * line, axis=1) / np.linalg.norm(line)
        is_target = (along > BETWEEN[0]) & (along < BETWEEN[1]) & (beside < ASIDE)
        is_target &= np.maximum(angle[i], angle[j]) < MAX_ANGLE
        is_target[[i, j]] = False
        if is_target.any():
            windows.append((int(i), int(j), np.flatnonzero(is_target)))
    return windows


def _crops(
    scene: TrainingScene, frames: Sequence[int], crop: int, sides: Sequence[int], rng: np.random.Generator
) -> tuple[list[Picture], list[NDArray]]:
    """Square crops of `crop` pixels about where a random point of the first view appears, scaled to `sides`; and z."""
    first = frames[0]
    size = np.array(scene.images[first].shape[1::-1])
    pixel = crop / 2 + rng.random(2) * (size - crop)
    depth = 1.3 * 2 / (1 / scene.near + 1 / scene.far)
    point = scene.c2w[first] @ np.append(np.linalg.solve(scene.K[first], np.append(pixel, 1)) * depth, 1)
    pictures, depths = [], []
    for frame, side in zip(frames, sides, strict=True):
        local = np.linalg.inv(scene.c2w[frame]) @ point
        shown = scene.K[frame] @ local[:3]
        size = np.array(scene.images[frame].shape[1::-1])
        x, y = np.clip(shown[:2] / max(shown[2], 1e-3) - crop / 2, 0, size - crop).astype(int)
        inside = np.s_[y : y + crop, x : x + crop]
        K = scene.K[frame].copy()
        K[:2, 2] -= x, y
        K[:2] *= side / crop
        pictures.append((resize_cover(scene.images[frame][inside], side, side), K, scene.c2w[frame]))
        at = ((np.arange(side) + 0.5) * (crop / side)).astype(int)
        known = scene.depths[frame]
        depths.append(np.zeros((side, side), np.float32) if known is None else known[inside][at[:, None], at])
    return pictures, depths


def _recoloured(pictures: Sequence[Picture], rng: np.random.Generator) -> list[Picture]:
    """Other light: channels swapped, a tone curve, a gain per channel, and small differences between the pictures."""
    order = rng.permutation(3) if rng.random() < 0.3 else np.arange(3)
    power, gain = np.float32(1), np.ones(3, np.float32)
    if rng.random() < 0.6:
        power, gain = np.float32(rng.uniform(0.6, 1.6)), rng.uniform(0.5, 1.1, 3).astype(np.float32)
    views = []
    for image, K, c2w in pictures:
        exposed = image[..., order] ** power * gain * np.float32(1 + rng.normal(0, 0.01))
        views.append((np.clip(exposed, 0, 1).astype(np.float32), K, c2w))
    return views


def _transposed(image: NDArray, K: NDArray, c2w: NDArray) -> Picture:
    """The mirror image of the world at the diagonal: rows and columns swapped in a square picture without skew."""
    swap = np.eye(4)[[1, 0, 2, 3]]
    return image.transpose(1, 0, 2), swap[:3, :3] @ K @ swap[:3, :3], swap @ c2w @ swap


def _mirrored(image: NDArray, K: NDArray, c2w: NDArray) -> Picture:
    """The mirror image of the world: left and right swapped in picture and camera."""
    flip = np.diag([-1.0, 1, 1, 1])
    mirrored = K.copy()
    mirrored[0, 2] = image.shape[1] - K[0, 2]
    mirrored[0, 1] *= -1
    return image[:, ::-1], mirrored, flip @ c2w @ flip
