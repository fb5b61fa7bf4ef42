"""What masks leave out shows nothing, changes nothing else, and costs next to nothing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from turntable import camera_about, write_turntable

import tinysplat_runtime as ts
from tinysplat_runtime.network.masked import LEAST_SHOWN
from tinysplat_runtime.recipe.encode import encode
from tinysplat_runtime.recipe.request import EncodeRequest
from tinysplat_runtime.render import Renderer
from tinysplat_runtime.scene.images import read_image
from tinysplat_runtime.scene.pictures import write_png

VIEWS, SIZE = 4, 72
RUNTIME = ts.Runtime(threads=2)
ANGLES = np.linspace(-0.35, 0.35, 2 * VIEWS - 1)


@pytest.fixture(scope="module")
def turntable(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("turntable")
    write_turntable(folder, [camera_about(angle, SIZE) for angle in ANGLES[::2]])
    return folder


def made(folder: Path, **options: object) -> tuple[bytes, ts.Gaussians]:
    data = encode(EncodeRequest(folder, fast=True, **options), RUNTIME).data
    return data, RUNTIME.decompress(data)


def test_a_turntable_costs_what_its_thing_does_and_stands_before_nothing(turntable: Path, tmp_path: Path) -> None:
    camera = camera_about(ANGLES[3], SIZE)
    alpha = write_turntable(tmp_path, [camera])[0]
    truth = read_image(tmp_path / "images/0.png") / np.float32(255)
    inside, outside, sizes = {}, {}, {}
    for masks in ("no", "background"):
        data, gaussians = made(turntable, masks=masks)
        drawn = Renderer(gaussians).render(camera, outputs=("rgb", "alpha"))
        sizes[masks] = len(data)
        inside[masks] = float(np.square(drawn["rgb"] - truth)[alpha > 0.99].mean())
        outside[masks] = float(drawn["alpha"][alpha < 0.01].mean())
    assert sizes["background"] < 0.7 * sizes["no"] and inside["background"] < 1.5 * inside["no"]
    assert outside["no"] > 0.9 and outside["background"] < 0.12


def test_what_stands_in_masked_pixels_changes_no_byte(turntable: Path, tmp_path: Path) -> None:
    data, _ = made(turntable)
    rng = np.random.default_rng(0)
    for name in ("images", "masks"):
        (tmp_path / name).mkdir()
    (tmp_path / "cameras.json").write_bytes((turntable / "cameras.json").read_bytes())
    for path in sorted((turntable / "images").iterdir()):
        mask = read_image(turntable / "masks" / path.name)
        noise = rng.integers(0, 256, mask.shape, np.uint8)
        write_png(tmp_path / "images" / path.name, np.where(mask > 0, read_image(path), noise))
        (tmp_path / "masks" / path.name).write_bytes((turntable / "masks" / path.name).read_bytes())
    assert made(tmp_path)[0] == data


def test_hidden_gaussians_show_nothing_and_others_stay(turntable: Path) -> None:
    scene = ts.load_scene(turntable)
    found = RUNTIME.predict(scene)
    bare = replace(scene, frames=tuple(replace(frame, mask=None, path=frame.path) for frame in scene.frames))
    known = np.stack([frame.known() for frame in scene.frames])
    assert not found.opacities[~known].any() and (found.opacities[known] >= LEAST_SHOWN).mean() > 0.5
    ts.Gaussians(**vars(found))  # which checks
    whole = RUNTIME.predict(bare)
    assert whole.opacities[~known].mean() > 0.1
    centre = scene.cameras[0].centre
    places = (found.means[0] + found.origin - centre) @ (scene.cameras[0].K @ scene.cameras[0].rotation).T
    row, column = np.mgrid[:SIZE, :SIZE] + 0.5
    apart = places[..., :2] / places[..., 2:] - np.stack([column, row], axis=2)
    assert np.abs(apart).max() < 1  # filled on their own rays
