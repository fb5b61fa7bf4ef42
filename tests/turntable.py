"""A turntable that tests make: a thing that turns before a backdrop that does not, as cameras about it see it."""

import json
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.sh import C0
from tinysplat_runtime.render import Renderer
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.intake.cameras_json import camera_entry
from tinysplat_runtime.scene.pictures import write_png

NEAR, FAR = 1.8, 5.0
AWAY, ABOVE = 3.2, 0.3  # of the cameras from the thing's middle, and radians


def thing(count: int = 12_000, seed: int = 0) -> Gaussians:
    """A textured body about as large as the unit sphere."""
    rng = np.random.default_rng(seed)
    ray = rng.normal(size=(count, 3))
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    means = ray * (1 + 0.25 * np.sin(3 * ray[:, :1] + 1) * np.cos(4 * ray[:, 1:2])) * (1, 0.8, 1)
    waves = [[np.sin(means @ rng.normal(size=3) * n + rng.uniform(0, 6)) for n in (4, 8, 16)] for _ in range(3)]
    colours = (0.5 + 0.2 * np.sum(waves, axis=1).T).clip(0.02, 0.98)
    return Gaussians(
        means=means.astype(np.float32),
        quats=np.tile([1.0, 0, 0, 0], (count, 1)),
        scales=np.full((count, 3), 0.025),
        opacities=np.full(count, 0.98),
        sh=((colours - 0.5) / C0)[:, None],
    )


def camera_about(angle: float, size: int) -> Camera:
    """At an angle about the thing, looking at its middle; size × size."""
    side, up = np.cos(ABOVE), -np.sin(ABOVE)
    centre = AWAY * np.array([np.sin(angle) * side, up, -np.cos(angle) * side])
    ahead = -centre / AWAY
    across = np.cross([0, 1, 0], ahead)
    across /= np.linalg.norm(across)
    c2w = np.eye(4)
    c2w[:3] = np.stack([across, np.cross(ahead, across), ahead, centre], axis=1)
    return Camera([[1.1 * size, 0, size / 2], [0, 1.1 * size, size / 2], [0, 0, 1]], c2w, size, size)


def backdrop(size: int, seed: int = 3) -> NDArray:
    """(size, size, 3) with edges that every photo has in the same place."""
    rng = np.random.default_rng(seed)
    row, column = np.mgrid[:size, :size] / size
    picture = np.full((size, size, 3), 0.75)
    for x, y, radius in rng.uniform(0, 1, (14, 3)) * (1, 1, 0.15):
        picture[(column - x) ** 2 + (row - y) ** 2 < radius**2] = rng.uniform(0, 1, 3)
    return picture


def write_turntable(folder: Path, cameras: list[Camera]) -> list[NDArray]:
    """Photos with `cameras.json`, and their masks; (H, W) opacities of the truth."""
    renderer, behind, covered = Renderer(thing()), backdrop(cameras[0].width), []
    for i, camera in enumerate(cameras):
        drawn = renderer.render(camera, outputs=("rgb", "alpha"))
        alpha = drawn["alpha"][..., None]
        covered.append(drawn["alpha"])
        photo = (drawn["rgb"] + (1 - alpha) * behind).clip(0, 1)
        (folder / "images").mkdir(parents=True, exist_ok=True)
        write_png(folder / f"images/{i}.png", photo)
        (folder / "masks").mkdir(exist_ok=True)
        write_png(folder / f"masks/{i}.png", (drawn["alpha"] > 0.5).astype(np.float32))
    frames = [camera_entry(f"images/{i}.png", camera) for i, camera in enumerate(cameras)]
    (folder / "cameras.json").write_text(json.dumps({"near": NEAR, "far": FAR, "frames": frames}))
    return covered
