"""A scene folder that ours and others' programs open: photos without distortion, and their cameras in three layouts.

`cameras.json` is ours, `transforms.json` nerfstudio's and instant-ngp's, `sparse/0` COLMAP's in text, with points but
without what photo saw them: the layout that trainers of 3D Gaussians start from.
"""

import json
import shutil
from collections.abc import Mapping, Sequence, Set
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.gaussian.quaternions import matrices_to_quats
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.images import read_image
from tinysplat_runtime.scene.intake.cameras_json import CAMERAS_FILE, camera_entry, lens_entry
from tinysplat_runtime.scene.intake.nerfstudio import FILE as TRANSFORMS_FILE
from tinysplat_runtime.scene.intake.nerfstudio import OPENGL_TO_OPENCV
from tinysplat_runtime.scene.lenses import Lens
from tinysplat_runtime.scene.masks import Mask
from tinysplat_runtime.scene.pictures import png_bytes
from tinysplat_runtime.scene.resampling import resize_cover
from tinysplat_runtime.system.files import write_atomically
from tinysplat_runtime.system.jsonfields import JsonObject
from tinysplat_runtime.system.told import NOBODY, Told

from .copies import encoded

MOST_PIXELS = 4_000_000
"""Of a photo that is kept as large as it is: trainers take photos 1,600 pixels wide, and `encode` smaller ones."""

Points = tuple[NDArray, NDArray, NDArray]
"""Positions (N, 3), colours (N, 3) uint8, errors (N,) in pixels."""


def write_folder(
    output: Path,
    photos: Path,
    entries: Sequence[JsonObject],
    depths: tuple[float | None, float | None],
    points: Points,
    masks: Mapping[str, Mask] = MappingProxyType({}),
    told: Told = NOBODY,
) -> dict[str, Camera]:
    """Write a scene; nothing stays behind when that fails.

    Args:
        output: the folder, new or empty.
        photos: where the photos are, upright as stored.
        entries: what `model.placed_photos` says of each.
        depths: near and far, None where they are unknown.
        points: of the surfaces.
        masks: of photos, by their names; what is transparent stays so, others are written beside the photos.
        told: is told of each photo.

    Returns:
        Cameras of the photos in it by the photos' names, in their order.
    """
    existed = output.exists()
    (output / "images").mkdir(parents=True)
    try:
        order = sorted(entries, key=lambda entry: str(entry["name"]))
        are_masked = any(not mask.is_opacity for mask in masks.values())  # then each has a mask, if a white one
        frames = [
            _written(output, photos, entry, masks.get(str(entry["name"])), is_masked=are_masked)
            for entry in told.progress("taking distortion out", order)
        ]
        near, far = depths
        ours = [{**camera_entry(file, camera), "taken_with": lens_entry(lens)} for file, camera, lens in frames]
        _write_json(output / CAMERAS_FILE, {"near": near, "far": far, "frames": ours})
        masked = {file for file, _, _ in frames if (output / mask_file(file)).is_file()}
        _write_json(
            output / TRANSFORMS_FILE, transforms([(file, camera) for file, camera, _ in frames], depths, masked)
        )
        (output / "sparse/0").mkdir(parents=True)
        for name, text in colmap_texts([(file, camera) for file, camera, _ in frames], points).items():
            write_atomically(output / "sparse/0" / name, text.encode())
    except BaseException:
        for path in [output] if not existed else list(output.iterdir()):
            shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)
        raise
    return {str(entry["name"]): camera for entry, (_, camera, _) in zip(order, frames, strict=True)}


def _written(
    output: Path, photos: Path, entry: JsonObject, mask: Mask | None, *, is_masked: bool
) -> tuple[str, Camera, Lens]:
    """A photo without distortion, of its own kind; its place in the folder, its camera and its lens.

    It is of its own size, or of a half or a quarter of that, where it has more than `MOST_PIXELS`.
    """
    stated, name = entry["camera"], str(entry["name"])
    lens = Lens(stated["model"], tuple(stated["params"]), stated["width"], stated["height"])
    sides = lens.height, lens.width
    shrink = next((n for n in (1, 2, 4) if sides[0] * sides[1] <= MOST_PIXELS * n * n), 4)
    if any(side % shrink for side in sides):
        shrink = 1
    kept = sides[0] // shrink, sides[1] // shrink
    photo = read_image(photos / name, shrink=shrink)
    taken = lens.scaled(photo.shape[1], photo.shape[0])
    view = taken.camera(np.linalg.inv(np.vstack([entry["w2c"], [0, 0, 0, 1]])))
    file = f"images/{name.replace('/', '_')}"
    picture = resize_cover(taken.undistort(photo), *kept)
    if mask is not None or is_masked:
        levels = np.full(photo.shape, 255, np.uint8)
        if mask is not None:
            levels = taken.undistort(np.repeat(mask.kept(*photo.shape[:2])[..., None], 3, axis=2))
        counts = resize_cover(levels, *kept)[..., :1] >= 0.5
        if mask is not None and mask.is_opacity:
            picture = np.concatenate([picture, counts], axis=2)
        else:
            path = output / mask_file(file)
            path.parent.mkdir(exist_ok=True)
            write_atomically(path, png_bytes(counts[..., 0].astype(np.float32)))
    write_atomically(output / file, encoded(picture, file))
    return file, view.resized(*kept), lens


def mask_file(photo: str) -> str:
    """Where the mask of a photo `images/NAME` is, as COLMAP has it."""
    return f"masks/{photo.removeprefix('images/')}.png"


def _write_json(path: Path, document: JsonObject) -> None:
    write_atomically(path, (json.dumps(document, indent=1) + "\n").encode())


def transforms(
    frames: Sequence[tuple[str, Camera]], depths: tuple[float | None, float | None], masked: Set[str] = frozenset()
) -> JsonObject:
    """A `transforms.json` of photos and their cameras, and of those that are `masked` where their masks are."""
    entries = [
        {
            "file_path": file,
            "w": camera.width,
            "h": camera.height,
            "fl_x": camera.K[0, 0],
            "fl_y": camera.K[1, 1],
            "cx": camera.K[0, 2],
            "cy": camera.K[1, 2],
            "transform_matrix": (camera.c2w @ OPENGL_TO_OPENCV).tolist(),
            **({"mask_path": mask_file(file)} if file in masked else {}),
        }
        for file, camera in frames
    ]
    return {"camera_model": "PINHOLE", "near": depths[0], "far": depths[1], "frames": entries}


def colmap_texts(frames: Sequence[tuple[str, Camera]], points: Points) -> dict[str, str]:
    """`cameras.txt`, `images.txt` and `points3D.txt` of photos, their cameras and points."""
    numbers: dict[tuple[float, ...], int] = {}
    images = []
    for i, (file, camera) in enumerate(frames, start=1):
        K = camera.K
        key = (camera.width, camera.height, K[0, 0], K[1, 1], K[0, 2], K[1, 2])
        number = numbers.setdefault(key, len(numbers) + 1)
        pose = (*matrices_to_quats(camera.w2c[:3, :3]), *camera.w2c[:3, 3])
        images.append(f"{i} {_joined(pose)} {number} {Path(file).name}\n\n")  # an empty line: points it saw
    cameras = [f"{number} PINHOLE {key[0]} {key[1]} {_joined(key[2:])}\n" for key, number in numbers.items()]
    rows = [
        f"{i} {_joined(xyz)} {' '.join(map(str, rgb))} {error:.4g}\n"
        for i, (xyz, rgb, error) in enumerate(zip(*points, strict=True), start=1)
    ]
    return {"cameras.txt": "".join(cameras), "images.txt": "".join(images), "points3D.txt": "".join(rows)}


def _joined(values: Sequence[float] | NDArray) -> str:
    return " ".join(f"{float(value):.12g}" for value in values)
