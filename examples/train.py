"""A capture trained as one scene of SH degree 3, with the gradient that `decode --fuse` follows.

    tinysplat encode SCENE --views 0,2,6,8,10,14 --size full --qp -6 -o walk.tsplat
    python examples/train.py SCENE walk.tsplat -o trained.ply --minutes 50

The Gaussians of the file are thinned as for other viewers, then moved, scaled, faded and coloured until the scene's
photos (L1) fit. Every eighth photo, from the fifth on, is left out; its dB is printed when the scene is written, which
happens every few minutes. The photos have to be as large as they are to be fitted. Needs numba (`tinysplat[fast]`).
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np
from numpy.typing import NDArray

import tinysplat_runtime as ts
from tinysplat_runtime.gaussian import sh
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.sh import C0
from tinysplat_runtime.gaussian.thin import thinned
from tinysplat_runtime.refine.descent import Descent, Pace, units
from tinysplat_runtime.refine.free import FreeGaussians
from tinysplat_runtime.refine.fuse import FADED
from tinysplat_runtime.refine.kernels_free import SH_RED
from tinysplat_runtime.render import DEFINITION, Renderer
from tinysplat_runtime.render.gradient import Target
from tinysplat_runtime.system.threads import Crew

EVERY, FIRST = 8, 4
"""Photos that are left out."""

PACE = Pace(last=0.05)
HIGHER = 0.1
"""How much smaller the steps of higher SH degrees are."""

DEGREE, WRITTEN_EVERY = 3, 300.0


class Training:
    """Gaussians on their way."""

    def __init__(self, gaussians: Gaussians, unit: NDArray, threads: int) -> None:
        self._run, self._origin = Crew(threads).map, gaussians.origin
        wide = np.zeros((gaussians.count, (DEGREE + 1) ** 2, 3), np.float32)
        wide[:, :4] = gaussians.sh[:, :4]
        field = FreeGaussians(replace(gaussians, sh=wide), unit, self._run)
        self._descent = Descent(field, PACE, self._run)

    @property
    def field(self) -> FreeGaussians:
        return self._descent.field

    @property
    def count(self) -> int:
        return self._descent.count

    def step(self, target: Target, way: float) -> float:
        """Towards one photo; the dB that it had."""
        descent, field = self._descent, self.field
        error = descent.correct(target, way)
        towards = target.camera.centre - self._origin
        numbers = HIGHER * PACE.step_sizes(way)[SH_RED], PACE.noise, 1 - PACE.memory**descent.count
        for piece in field.pieces:
            rows = piece.rows
            gradient, squares = descent.gradient[SH_RED:, rows], descent.means[1, SH_RED:, rows]
            move_higher(piece.geometry[:, :3], towards, gradient, squares, numbers, piece.sh)
        field.place()
        return error.psnr

    def drop_faded(self) -> None:
        self._descent.keep(self.field.opacities >= FADED)


BANDS = tuple(numba.njit(inline="always")(band) for band in (sh.band_1, sh.band_2, sh.band_3))
band_1, band_2, band_3 = BANDS


@numba.njit(cache=True, fastmath=True)
def move_higher(means, centre, gradient, squares, numbers, sh):  # type: ignore[no-untyped-def]
    """Step SH coefficients above degree 0: a picture's gradient of theirs is that of degree 0 times Y/C0.

    Args:
        means: (chunks, 3, 128) float32.
        centre: (3,) float64 of the camera.
        gradient, squares: (3, rows) float32 of the colours of degree 0, and Adam's running means of its squares.
        numbers: step size, least root of a square, and what those means have to be divided by.
        sh: (chunks, 48·128) float32, changed.
    """
    size, noise, rest = numbers
    for chunk in range(len(means)):
        for lane in range(128):
            row = chunk * 128 + lane
            if gradient[0, row] == 0 and gradient[1, row] == 0 and gradient[2, row] == 0:
                continue
            x, y, z = (
                means[chunk, 0, lane] - centre[0],
                means[chunk, 1, lane] - centre[1],
                means[chunk, 2, lane] - centre[2],
            )
            length = np.sqrt(x * x + y * y + z * z)
            x, y, z = x / length, y / length, z / length
            basis = band_1(x, y, z) + band_2(x, y, z, x * x, y * y, z * z) + band_3(x, y, z, x * x, y * y, z * z)
            for channel in range(3):
                slope = size * gradient[channel, row] / (np.sqrt(squares[channel, row] / rest) + noise) / C0
                for k in range(15):
                    sh[chunk, (3 * (k + 1) + channel) * 128 + lane] -= np.float32(slope * basis[k])


def dB(gaussians: Gaussians, targets: list[Target], threads: int) -> list[float]:
    """Of each photo."""
    renderer, found = Renderer(gaussians, threads, **DEFINITION), []
    for target in targets:
        error = np.clip(renderer.render(target.camera), 0, 1) - target.photo
        found.append(float(-10 * np.log10(np.square(error).mean())))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path)
    parser.add_argument("start", type=Path, help="of some of its photos, as `encode` writes it")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=50.0)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    scene, start = ts.load_scene(options.scene), ts.load_gaussians(options.start)
    targets = [Target(camera, photo) for camera, photo in zip(scene.cameras, scene.images(), strict=True)]
    unseen = targets[FIRST::EVERY]
    seen = [target for number, target in enumerate(targets) if number % EVERY != FIRST]
    thin = thinned(start, Crew(options.threads).map, shown=1)
    training = Training(thin, units(thin, start.cameras), options.threads)
    begin, written, order, left = time.perf_counter(), 0.0, np.random.default_rng(0), []
    print(f"{thin.count:,} Gaussians, {len(seen)} photos, {len(unseen)} left out", flush=True)
    while True:
        passed = time.perf_counter() - begin
        way = passed / (60 * options.minutes)
        if way >= 1 or passed - written > WRITTEN_EVERY:
            training.drop_faded()
            found, written = training.field.gaussians(), passed
            ts.save_gaussians(options.output, found)
            print(
                f"{passed:.0f} s, {training.count} steps, {found.count:,} Gaussians: left out "
                f"{np.mean(dB(found, unseen, options.threads)):.2f} dB, {time.process_time():.0f} CPU seconds",
                flush=True,
            )
        if way >= 1:
            break
        left = left or order.permutation(len(seen)).tolist()
        training.step(seen[left.pop()], way)


if __name__ == "__main__":
    main()
