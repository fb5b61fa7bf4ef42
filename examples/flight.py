"""A moving picture of a scene, such as README's: a flight past the places of its photos.

    python examples/flight.py mug.tsplat flight.webp

Needs Pillow, which scikit-image brings.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image

import tinysplat_runtime as ts
from tinysplat_runtime.render import DEFINITION, Renderer, between

SIDE = 400
"""Of the longer side, pixels."""

FRAMES_A_VIEW, FRAME_MS = 4, 60
QUALITY, MAX_BYTES = 50, 1_200_000
WHITE = (1.0, 1.0, 1.0)


def main(source: str, target: str) -> int:
    """Write the animation, there and back; returns the exit status."""
    gaussians = ts.load_gaussians(source)
    cameras = gaussians.cameras or gaussians.viewpoints
    scale = SIDE / max(cameras[0].height, cameras[0].width)
    cameras = [camera.resized(round(scale * camera.height), round(scale * camera.width)) for camera in cameras]
    renderer = Renderer(gaussians, **({} if gaussians.cameras else DEFINITION))
    way = between(cameras, FRAMES_A_VIEW * (len(cameras) - 1) + 1)
    frames = [renderer.render(camera, background=WHITE) for camera in way]
    pictures = [Image.fromarray(np.rint(255 * frame.clip(0, 1)).astype(np.uint8)) for frame in frames]
    pictures += pictures[-2:0:-1]
    pictures[0].save(
        target, save_all=True, append_images=pictures[1:], duration=FRAME_MS, loop=0, quality=QUALITY, method=6
    )
    size = Path(target).stat().st_size
    print(f"{target}: {size / 1000:.0f} KB, {len(pictures)} frames of a file of {Path(source).stat().st_size:,} bytes")
    return int(size > MAX_BYTES)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
