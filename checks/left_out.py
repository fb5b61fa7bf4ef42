"""How good is a capture that `tinysplat encode` makes, at photos that it is not given?

    python checks/left_out.py SCENE 0-15 --masks background

Of these photos (0-15) every eighth, from the fourth on, is left out (from the first on where they are 0-15:0); `encode`
gets the others, and what follows as its options. Its file is drawn at the photos left out and held against them, at the
size that it chose, within their masks.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import tinysplat_runtime as ts
from tinysplat.measure.clock import cpu_of
from tinysplat.measure.pictures import as_photos, to_photos
from tinysplat_runtime.recipe.prepare import prepared
from tinysplat_runtime.recipe.request import EncodeRequest
from tinysplat_runtime.recipe.words import ALL


def main() -> int:
    """Print what was measured, on one line."""
    path, chosen, *options = sys.argv[1:]
    ends, _, out = chosen.partition(":")
    first, last = map(int, ends.split("-"))
    views = range(first, last + 1)
    left_out = views[int(out or 3) :: 8]
    kept = [view for view in views if view not in left_out]
    scene = ts.load_scene(path)
    size = prepared(EncodeRequest(scene.views(kept), views=ALL)).cameras[0]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "made.tsplat")
        command = ["tinysplat", "encode", path, "-o", file, "--views", ",".join(map(str, kept)), *options]
        _, cpu = cpu_of(lambda: subprocess.run([*map(str, command)], check=True))
        made, written = ts.load_gaussians(file), file.stat().st_size
    targets = scene.views(left_out).resized(size.height, size.width)
    score = to_photos(as_photos(made, targets.cameras), targets)
    figures = ", ".join(f"{name} {value:.3f}" for name, value in score.items())
    print(f"{path}: {len(kept)} photos given, {len(left_out)} drawn at {size.width}×{size.height}:")
    print(f"    {figures}; {written / 1000:.0f} KB, {cpu:.0f} processor seconds")
    return 0


if __name__ == "__main__":
    sys.exit(main())
