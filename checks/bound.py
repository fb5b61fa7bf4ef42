"""How pictures fall with the distance from the views: what the page's bound (page/bound.js, SIDE) was chosen by.

    python checks/bound.py SCENE_FOLDER… [--kind near] [--side 0.035]

A scene is a folder with cameras.json and eval_index.json. Of its first window of a kind the context is encoded as
`tinysplat encode` does, and every other photo within the bound is held against what is drawn from its camera, where
anything is known (alpha above 0.95). Prints PSNR by strain, the distance from the ways between the views over the
bound's, and how far the worst photo within the bound falls behind the best.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import tinysplat_runtime as ts
from tinysplat_runtime.render import Renderer
from tinysplat_runtime.render.near import NearViews

AHEAD = 2.5
LEAST_SIDE, MOST_SIDE = 0.02, 0.12
KNOWN = 0.95
LEAST_COVERED = 0.5


@dataclass(frozen=True)
class HeldOutPhoto:
    """A photo that was not given, and what is drawn from its camera.

    Attributes:
        strain: distance from the views' hull, 1 at the bound.
        covered: share of the picture where anything is known.
        psnr: there, dB.
    """

    strain: float
    covered: float
    psnr: float


def foot(camera: ts.Camera, views: NearViews) -> NDArray:
    """The place nearest to a camera on the lines between views."""
    places = []
    for i, j in itertools.combinations(range(len(views.centres)), 2):
        way = views.centres[j] - views.centres[i]
        t = ((camera.centre - views.centres[i]) @ way / (way @ way)).clip(0, 1)
        places.append(views.centres[i] + t * way)
    return min(places, key=lambda place: float(np.linalg.norm(camera.centre - place)))


def bound_of(gaussians: ts.Gaussians, views: NearViews, side: float) -> float:
    """How far the page lets its camera go to the side, scene units."""
    z = np.einsum("vhwc,vc->vhw", gaussians.means, views.directions)
    z += ((gaussians.origin - views.centres) * views.directions).sum(axis=1)[:, None, None]
    spread = float(np.std(1 / z[z > 0])) * views.depth
    return views.depth * min(max(side / math.sqrt(spread), LEAST_SIDE), MOST_SIDE)


def readings(folder: Path, kind: str, side: float) -> list[HeldOutPhoto]:
    """Of one scene; none where it has no such window."""
    windows = [w for w in json.loads((folder / "eval_index.json").read_text())["windows"] if w["kind"] == kind]
    if not windows:
        return []
    given = windows[0]["context"]
    gaussians = ts.decompress(ts.encode(folder, views=given))
    views, scene, renderer = NearViews.of(gaussians), ts.load_scene(folder), Renderer(gaussians)
    assert views is not None
    reach, size, rows = bound_of(gaussians, views, side), gaussians.opacities.shape[1:], []
    for number, frame in enumerate(scene.frames):
        seen = frame.resized(*size)
        off = seen.camera.centre - foot(seen.camera, views)
        ahead = float(off @ seen.camera.rotation[2])
        aside = float(np.linalg.norm(off - ahead * seen.camera.rotation[2]))
        strain = math.hypot(aside, ahead / (AHEAD if ahead > 0 else 1)) / reach
        if number in given or strain > 3:
            continue
        drawn = renderer.render(seen.camera, outputs=("rgb", "alpha"))
        known = drawn["alpha"] > KNOWN
        if known.mean() > LEAST_COVERED:
            error = np.mean((drawn["rgb"][known].astype(np.float64) - seen.image()[known]) ** 2)
            rows.append(HeldOutPhoto(strain, float(known.mean()), float(-10 * np.log10(error))))
    return sorted(rows, key=lambda reading: reading.strain)


def main() -> None:
    """Print the curves."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="+", type=Path)
    parser.add_argument("--kind", default="near")
    parser.add_argument("--side", type=float, default=0.035)
    args = parser.parse_args()
    for folder in args.scenes:
        held = readings(folder, args.kind, args.side)
        inside = [reading.psnr for reading in held if reading.strain <= 1]
        loss = f"{max(inside) - min(inside):.1f} dB over {len(inside)} photos" if inside else "no photo"
        print(f"{folder.name}: {loss}")
        print("  " + "  ".join(f"{reading.strain:.2f}: {reading.psnr:.1f}" for reading in held[:16]))


if __name__ == "__main__":
    main()
