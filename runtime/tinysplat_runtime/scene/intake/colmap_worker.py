"""The process in which pycolmap reads a model: `python -m tinysplat_runtime.scene.intake.colmap_worker FOLDER`.

Writes an .npz archive to standard output: `entries`, the UTF-8 bytes of a JSON list with a photo's `name`, `w2c` (3×4)
and `camera` (model, params, width, height); `points` (N, 3) float64; `observations` (M, 2) int64, pairs of an index
into `entries` and one into `points`. Exit status 3 where pycolmap is not installed.

pycolmap is shown cameras, images and points alone, in a folder of their own: rigs and frames repeat the poses that
images have, and often are another model's. Points may be lacking. Names of photos are read here, since pycolmap ends
one in text at its first space and knows UTF-8 alone.
"""

from __future__ import annotations

import io
import json
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...system.bounds import bound_process
from ...system.jsonfields import JsonObject
from ..lenses import load_pycolmap
from .colmap_binary import decoded, photo_names

MEMORY_BASE, MEMORY_PER_BYTE = 1 << 29, 64
"""Bytes beyond those of the process at its start; an observation of 24 bytes takes 100 in memory."""

_WORDS_BEFORE_NAME = 9  # number, rotation, translation, camera

SECONDS_BASE, BYTES_PER_SECOND = 4, 500_000
"""Processor time: reading takes 0.02 seconds a megabyte, starting 0.5."""


def model_arrays(reconstruction: Any, names: dict[int, str]) -> dict[str, NDArray]:
    """The arrays of a pycolmap.Reconstruction, with the shapes and dtypes described above.

    Args:
        reconstruction: the model.
        names: of photos by their numbers, where they are not those that pycolmap has.
    """
    points = {i: row for row, i in enumerate(reconstruction.points3D)}
    entries: list[JsonObject] = []
    observations: list[tuple[int, int]] = []
    for number, image in reconstruction.images.items():
        if not image.has_pose:
            continue
        camera = reconstruction.cameras[image.camera_id]
        observations += [
            (len(entries), points[point.point3D_id])
            for point in image.points2D
            if point.has_point3D() and point.point3D_id in points
        ]
        entries.append(
            {
                "name": names.get(number) or image.name,
                "w2c": image.cam_from_world().matrix().tolist(),
                "camera": {
                    "model": camera.model.name,
                    "params": [float(value) for value in camera.params],
                    "width": int(camera.width),
                    "height": int(camera.height),
                },
            }
        )
    positions = [point.xyz for point in reconstruction.points3D.values()]
    return {
        "entries": np.frombuffer(json.dumps(entries).encode(), np.uint8),
        "points": np.array(positions, np.float64).reshape(-1, 3),
        "observations": np.array(observations, np.int64).reshape(-1, 2),
    }


def bound_resources(bytes_of_model: int) -> None:
    """Bounds of memory and time that no real model of this size reaches, where the system has such bounds (Unix).

    A second line of defence behind `colmap_binary`.
    """
    memory = MEMORY_BASE + MEMORY_PER_BYTE * bytes_of_model
    bound_process(memory, SECONDS_BASE + bytes_of_model // BYTES_PER_SECOND)


def text_names(text: bytes) -> dict[int, str]:
    """Names of the photos in an images.txt by their numbers: what follows nine words in every other line."""
    names = {}
    lines = iter(text.splitlines())
    for line in lines:
        words = line.strip().split(maxsplit=_WORDS_BEFORE_NAME)
        if not words or words[0].startswith(b"#"):
            continue
        if len(words) > _WORDS_BEFORE_NAME and words[0].isdigit():
            names[int(words[0])] = decoded(words[-1])
        next(lines, None)  # what the photo observes
    return names


def _shown(model: Path, place: Path) -> dict[int, str]:
    """Show pycolmap a model at another place; the names of its photos."""
    suffix = ".bin" if all((model / f"{part}.bin").is_file() for part in ("cameras", "images")) else ".txt"
    for part in ("cameras", "images", "points3D"):
        source, target = (folder / f"{part}{suffix}" for folder in (model.resolve(), place))
        if not source.is_file():
            target.write_bytes(bytes(8) if suffix == ".bin" else b"")
            continue
        try:
            target.symlink_to(source)
        except OSError:  # Windows asks for a privilege
            shutil.copyfile(source, target)
    images = place / f"images{suffix}"
    return photo_names(images) if suffix == ".bin" else text_names(images.read_bytes())


def main(folder: str) -> int:
    """Read and write; returns the exit status."""
    try:
        pycolmap = load_pycolmap()
    except ImportError:
        return 3
    bound_resources(sum(file.stat().st_size for file in Path(folder).iterdir() if file.is_file()))
    try:
        with tempfile.TemporaryDirectory() as place:
            names = _shown(Path(folder), Path(place))
            arrays: JsonObject = model_arrays(pycolmap.Reconstruction(place), names)
    except (ValueError, IndexError, KeyError, RuntimeError, MemoryError, UnicodeDecodeError) as error:
        print(" ".join(str(error).split()) or type(error).__name__, file=sys.stderr)
        return 1
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    sys.stdout.buffer.write(buffer.getvalue())
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
