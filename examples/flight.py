"""The moving picture of the README: a flight through the demo's scene (`make pictures` lists the others).

    python examples/flight.py docs/flight.webp

The photos are those of examples/demo.py; needs Pillow, which scikit-image brings.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
from demo import write_scene
from PIL import Image

import tinysplat_runtime as ts
from tinysplat_runtime.render import Renderer, orbit

SIZE = (320, 474)
FRAMES, FRAME_MS = 40, 60
LOOKED_AT_M = 3.2
"""Distance that the flight circles, about the motorcycle's."""

QUALITY, MAX_BYTES = 60, 2_000_000


def main(target: str) -> int:
    """Write the animation; returns the exit status."""
    with tempfile.TemporaryDirectory() as name:
        write_scene(Path(name))
        data = ts.encode(name, size=SIZE)
    gaussians = ts.decompress(data)
    renderer = Renderer(gaussians)
    frames = [renderer.render(camera) for camera in orbit(gaussians.cameras, FRAMES, LOOKED_AT_M)]
    pictures = [Image.fromarray(np.rint(255 * frame.clip(0, 1)).astype(np.uint8)) for frame in frames]
    pictures[0].save(
        target, save_all=True, append_images=pictures[1:], duration=FRAME_MS, loop=0, quality=QUALITY, method=6
    )
    size = Path(target).stat().st_size
    print(f"{target}: {size / 1000:.0f} KB, {FRAMES} frames of a file of {len(data) / 1000:.0f} KB")
    return int(size > MAX_BYTES)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
