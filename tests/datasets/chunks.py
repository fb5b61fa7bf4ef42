"""Chunks of made-up scenes in the layout of RealEstate10K as pixelSplat, MVSplat and DepthSplat read it."""

import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from numpy.typing import NDArray
from PIL import Image
from scenes import make_cameras, make_photo, realestate_line

from tinysplat_runtime.scene.cameras import Camera


def encoded(pixels: NDArray, kind: str = "PNG") -> torch.Tensor:
    """A photo's file as a vector of bytes."""
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, kind)
    return torch.frombuffer(bytearray(buffer.getvalue()), dtype=torch.uint8)


def camera_row(camera: Camera) -> list[float]:
    """As RealEstate10K's own files have it, without the time."""
    return [float(word) for word in realestate_line(0, camera).split()[1:]]


def make_chunk_scene(key: str, frames: int = 4, height: int = 360, width: int = 640, seed: int = 0) -> dict[str, Any]:
    """One scene of a chunk."""
    cameras = make_cameras(frames, height, width)
    return {
        "key": key,
        "url": "",
        "timestamps": torch.arange(frames),
        "cameras": torch.tensor([camera_row(camera) for camera in cameras], dtype=torch.float32),
        "images": [encoded(make_photo(height, width, seed + i), "JPEG" if i % 2 else "PNG") for i in range(frames)],
    }


def write_chunks(folder: Path, chunks: Sequence[Sequence[dict[str, Any]]]) -> Path:
    """Write chunk files and their index; returns the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    index = {}
    for n, scenes in enumerate(chunks):
        name = f"{n:06}.torch"
        torch.save(list(scenes), folder / name)
        index |= {scene["key"]: name for scene in scenes}
    (folder / "index.json").write_text(json.dumps(index))
    return folder
