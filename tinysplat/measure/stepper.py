"""Refinement, a step whenever it is told to: a process of `studies/pacing.py`, on the runtime of any checkout.

    python stepper.py RUNTIME FOLDER

FOLDER has `g.npz` and the photos, cameras.json with them. The first line that is read begins, every further one takes a
step, and is answered by processor seconds so far, or by nothing once there is nothing left to do; what Gaussians have
become lies in `step.npz` then. All on one thread.
"""

from __future__ import annotations

import gc
import math
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

MOST_STEPS = 10_000
SMALLER = 4
"""Gaussians and photos of this part of their size are stepped first, which loads what is compiled."""


def main(runtime: str, folder: Path) -> None:
    """Answer lines."""
    sys.path.insert(0, runtime)
    import tinysplat_runtime as ts
    from tinysplat_runtime.codec.profiles import find_profile
    from tinysplat_runtime.refine.refine import Refining
    from tinysplat_runtime.system.threads import Crew

    told = find_profile("balanced"), 0.0, Crew(1).map
    gaussians, scene = ts.load_gaussians(folder / "g.npz"), ts.load_scene(folder)
    small = _thinned(gaussians)
    for _ in Refining(small, scene, *told).advance(2, math.inf):
        pass
    print(0, flush=True)
    sys.stdin.readline()
    begun, spent = _timed(lambda: Refining(gaussians, scene, *told), 0.0)
    taken = begun.advance(MOST_STEPS, math.inf)
    while True:
        ts.save_gaussians(folder / "step.npz", _standing(begun, gaussians))
        print(spent, flush=True)
        if not sys.stdin.readline():
            return
        step, spent = _timed(lambda: next(taken, None), spent)
        if step is None:
            return


def _timed(work: Callable[[], Any], spent: float) -> tuple[Any, float]:
    start = time.process_time()
    found = work()
    return found, spent + time.process_time() - start


def _thinned(gaussians: Any) -> Any:
    """Every fourth row and column, as of photos of that size."""
    layers = []
    for layer in gaussians.layers:
        arrays = {
            name: getattr(layer, name)[:, ::SMALLER, ::SMALLER]
            for name in ("means", "quats", "scales", "opacities", "sh")
        }
        height, width = arrays["opacities"].shape[1:]
        cameras = tuple(camera.resized(height, width) for camera in layer.cameras)
        arrays["scales"] = SMALLER * arrays["scales"]
        layers.append(replace(layer, **arrays, cameras=cameras, extra_layers=()))
    return replace(layers[0], extra_layers=tuple(layers[1:]))


def _standing(refining: Any, start: Any) -> Any:
    """Gaussians as they stand between two steps."""
    if hasattr(refining, "present"):
        return refining.present()
    from tinysplat_runtime.render.gradient import MovableGaussians  # an older checkout has those of one size alone

    alive = [found for found in gc.get_objects() if isinstance(found, MovableGaussians)]
    return max(alive, key=lambda field: field.values.size).gaussians(start)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
