"""The README's moving picture: a flight between the two photos of the demo's motorcycle, from its .tsplat file.

python examples/flight.py docs/flight.webp          # after examples/demo.py --photos; needs Pillow
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image

import tinysplat_runtime as ts
from tinysplat_runtime.render import Renderer, between
from tinysplat_runtime.scene.images import to_uint8

SCENE = Path("demo_out/motorcycle")
FRAMES, MS_PER_FRAME, QUALITY = 24, 60, 55
SIDES = (320, 474)
"""Rows and columns of the picture."""


def main(target: Path) -> int:
    """Encode, decode, fly there and back; returns the exit status."""
    scene = ts.load_scene(SCENE)
    data = ts.encode(scene)
    renderer = Renderer(ts.decompress(data))
    ease = (1 - np.cos(np.linspace(0, np.pi, FRAMES))) / 2  # slow where it turns round
    path = between(scene.resized(*SIDES).cameras, 8 * FRAMES)
    there = [Image.fromarray(to_uint8(renderer.render(path[round(share * (len(path) - 1))]))) for share in ease]
    frames = [*there, *there[-2:0:-1]]
    frames[0].save(
        target, save_all=True, append_images=frames[1:], duration=MS_PER_FRAME, loop=0, quality=QUALITY, method=6
    )
    print(f"{target}: {len(frames)} frames, {target.stat().st_size / 1000:.0f} KB, of a file of {len(data) / 1000:.0f}")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
