"""Chunks of scenes as MVSplat and DepthSplat publish RealEstate10K, ACID and DL3DV.

A folder holds `index.json` (`{scene key: chunk file}`) and chunk files. A chunk is a `torch.save`d list of scenes; a
scene is `{"key": str, "cameras": float32 (N, 18), "images": N uint8 vectors, each a whole JPEG or PNG file, …}`. A
camera row is fx, fy, cx, cy divided by the image's width and height, two unused values, and the 3×4 world-to-camera
matrix, OpenCV axes.

Frames are prepared as the official evaluations do: 8-bit Lanczos (Pillow's) to cover the wanted size, each side
rounded, then a crop whose corner is rounded down. There fx and fy follow scaling and crop, while the principal point
stays where it was relative to the image, up to half a pixel from the true one; figures compare only if we do the same.

Trust boundary: chunks are unpickled with `weights_only`; types, shapes and sizes in pixels are checked before use.
"""

import io
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.cameras import Camera, intrinsics
from tinysplat_runtime.scene.images import MAX_PIXELS
from tinysplat_runtime.scene.intake.realestate import pose_of
from tinysplat_runtime.system.files import StrPath, check_readable
from tinysplat_runtime.system.jsonfields import JsonObject

from .indices import DatasetSpec, read_object

INDEX_FILE = "index.json"
CAMERA_VALUES = 18
_MAX_INDEX_BYTES = 256 * 1000 * 1000


@dataclass(frozen=True, eq=False)
class ChunkScene:
    """One scene of a chunk.

    Attributes:
        key: its name in indices.
        where: chunk and key, for messages.
        rows: (N, 18) float64 camera rows.
        files: N encoded photos.
        spec: the data set it belongs to.
    """

    key: str
    where: str
    rows: NDArray
    files: tuple[bytes, ...]
    spec: DatasetSpec

    def views(self, indices: Iterable[int], size: tuple[int, int]) -> tuple[NDArray, tuple[Camera, ...]]:
        """Frames and cameras, prepared as the official evaluations do.

        Args:
            indices: frames wanted, in order.
            size: (height, width).

        Returns:
            (V, H, W, 3) float32 in [0, 1], and a camera each.

        Raises:
            InputError: names the scene and the frame: there is none of that index, it cannot be decoded, its shape is
                not one of the data set's, its field of view is too wide, or its camera is none.
        """
        images, cameras = [], []
        for index in indices:
            if not 0 <= index < len(self.files):
                raise InputError(f"frame {index}, but there are 0 to {len(self.files) - 1}", where=self.where)
            where = f"{self.where}: frame {index}"
            pixels = _decode(self.files[index], where)
            if pixels.shape[:2] not in self.spec.frame_shapes:
                wanted = " or ".join(f"{w}x{h}" for h, w in self.spec.frame_shapes)
                fault = f"{pixels.shape[1]}x{pixels.shape[0]} pixels"
                raise InputError(f"{fault}, {self.spec.name} has {wanted}", where=where)
            fov, limit = max(fields_of_view(self.rows[index])), self.spec.max_fov_degrees
            if not fov <= limit:
                raise InputError(f"field of view {fov:.1f}°, scenes over {limit:g}° are not evaluated", where=where)
            images.append(prepare_image(pixels, size))
            try:
                cameras.append(prepare_camera(self.rows[index], size, (pixels.shape[0], pixels.shape[1])))
            except InputError as error:
                raise error.within(where) from None
        return np.stack(images), tuple(cameras)


class ChunkFolder:
    """A folder of chunks; scenes are loaded when asked for, the last chunk is kept."""

    def __init__(self, path: StrPath, spec: DatasetSpec) -> None:
        """Read the folder's index; InputError where there is none, or it is not one."""
        self.path, self.spec = Path(path), spec
        index = self.path / INDEX_FILE
        what = "of chunk files of this folder by scene key"
        self.chunks: dict[str, str] = read_object(index, _MAX_INDEX_BYTES, what)
        if not all(isinstance(name, str) and name and Path(name).name == name for name in self.chunks.values()):
            raise InputError(f"expected an object {what}", where=str(index))

    def scene(self, key: str) -> ChunkScene:
        """One scene; InputError where there is no such scene, or its chunk is unreadable or breaks the layout."""
        if key not in self.chunks:
            raise InputError(f"no scene '{key}' in {INDEX_FILE}", where=str(self.path))
        path = self.path / self.chunks[key]
        check_readable(path)
        scenes = _load_chunk(str(path), path.stat().st_mtime_ns)
        if key not in scenes:
            raise InputError(f"no scene '{key}', though {INDEX_FILE} says so", where=str(path))
        return _parse_scene(scenes[key], key, f"{path}: {key}", self.spec)


def prepare_image(pixels: NDArray, size: tuple[int, int]) -> NDArray:
    """Scale a photo (H, W, 3) uint8 to cover `size` and crop its centre; (height, width, 3) float32 in [0, 1]."""
    from PIL import Image

    scaled_height, scaled_width = _scaled_size((pixels.shape[0], pixels.shape[1]), size)
    scaled = Image.fromarray(pixels).resize((scaled_width, scaled_height), Image.Resampling.LANCZOS)
    row, column = (scaled_height - size[0]) // 2, (scaled_width - size[1]) // 2
    cropped = np.asarray(scaled)[row : row + size[0], column : column + size[1]]
    return cropped.astype(np.float32) / np.float32(255)


def prepare_camera(row: NDArray, size: tuple[int, int], shape: tuple[int, int]) -> Camera:
    """The camera of a prepared photo; the principal point keeps its place relative to the image.

    Args:
        row: (18,) camera row.
        size: (height, width) that the photo is prepared at.
        shape: (height, width) of the stored photo.

    Raises:
        InputError: the row is no camera.
    """
    height, width = size
    scaled_height, scaled_width = _scaled_size(shape, size)
    fx, fy, cx, cy = row[:4]
    c2w = pose_of(row)
    c2w[3] = (0, 0, 0, 1)
    return Camera(intrinsics(fx * scaled_width, fy * scaled_height, cx * width, cy * height), c2w, width, height)


def fields_of_view(row: NDArray) -> tuple[float, float]:
    """Horizontal and vertical field of view of a camera row (18,) float, degrees, between middles of opposite edges."""
    fx, fy, cx, cy = row[:4]
    edges = ((0, 0.5), (1, 0.5)), ((0.5, 0), (0.5, 1))
    angles = []
    for pair in edges:
        rays = np.array([[(u - cx) / fx, (v - cy) / fy, 1] for u, v in pair])
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        angles.append(float(np.degrees(np.arccos(np.clip(rays[0] @ rays[1], -1, 1)))))
    return angles[0], angles[1]


def _scaled_size(shape: tuple[int, int], size: tuple[int, int]) -> tuple[int, int]:
    scale = max(size[0] / shape[0], size[1] / shape[1])
    return max(round(shape[0] * scale), size[0]), max(round(shape[1] * scale), size[1])


@lru_cache(maxsize=1)
def _load_chunk(path: str, _modified: int) -> JsonObject:
    """Scenes of a chunk by key; the last chunk is kept, as its scenes are asked for one after another."""
    import torch

    try:
        scenes = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises a dozen unrelated types on damaged files
        said = str(error).strip().split("\n")[0][:120]
        raise InputError(f"unreadable chunk ({type(error).__name__}: {said})", where=path) from None
    if not isinstance(scenes, list) or not all(isinstance(s, dict) and isinstance(s.get("key"), str) for s in scenes):
        raise InputError("not a chunk, expected a list of scenes with keys", where=path)
    return {scene["key"]: scene for scene in scenes}


def _parse_scene(scene: JsonObject, key: str, where: str, spec: DatasetSpec) -> ChunkScene:
    import torch

    cameras, images = scene.get("cameras"), scene.get("images")
    if not isinstance(cameras, torch.Tensor) or cameras.ndim != 2 or cameras.shape[1] != CAMERA_VALUES:
        raise InputError(f"expected a tensor (N, {CAMERA_VALUES})", where=f"{where}: cameras")
    if not isinstance(images, list) or len(images) != len(cameras):
        raise InputError(f"expected a list of {len(cameras)} photos, one per camera", where=f"{where}: images")
    for i, image in enumerate(images):
        if not isinstance(image, torch.Tensor) or image.dtype != torch.uint8 or image.ndim != 1:
            raise InputError("expected a photo's file as a vector of bytes", where=f"{where}: images[{i}]")
    rows = cameras.numpy().astype(np.float64)
    if not np.isfinite(rows).all() or not (rows[:, :2] > 0).all():
        raise InputError("holds focal lengths ≤ 0, NaN or infinity", where=f"{where}: cameras")
    return ChunkScene(key, where, rows, tuple(image.numpy().tobytes() for image in images), spec)


def _decode(data: bytes, where: str) -> NDArray:
    """(H, W, 3) uint8 of a JPEG or PNG file's bytes."""
    from PIL import Image

    try:
        with Image.open(io.BytesIO(data), formats=("JPEG", "PNG")) as image:
            if image.width * image.height > MAX_PIXELS:
                raise InputError(f"{image.width}x{image.height} pixels, expected at most {MAX_PIXELS}", where=where)
            return np.asarray(image.convert("RGB"))
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        raise InputError(f"cannot be decoded ({str(error)[:120]})", where=where) from None
