"""What `encode` says that photos will take, and what it counts."""

from __future__ import annotations

from pathlib import Path

import pytest
from networks.two_planes import row_of_cameras, trace, write_traced
from scenes import Heard

import tinysplat_runtime as ts
from tinysplat_runtime.api import Runtime
from tinysplat_runtime.recipe.encode import encode
from tinysplat_runtime.recipe.prepare import expected_bytes
from tinysplat_runtime.recipe.request import EncodeRequest
from tinysplat_runtime.scene.scenes import Frame, Scene


def photos(count: int, height: int, width: int) -> Scene:
    """Photos that are never opened."""
    frames = [Frame(camera, Path(f"{i}.png")) for i, camera in enumerate(row_of_cameras(count, height, width))]
    return Scene(Path("made"), tuple(frames), 1.0, 2.0)


def test_a_file_grows_with_photos_and_slower_with_their_pixels() -> None:
    one, two, larger = (expected_bytes(photos(*size)) for size in ((24, 64, 64), (48, 64, 64), (24, 128, 128)))
    assert two == pytest.approx(2 * one) and 2 * one < larger < 4 * one


def test_what_runs_before_the_network_is_counted(tmp_path: Path) -> None:
    heard = Heard()
    scene = ts.load_scene(write_traced(tmp_path, trace(7, 32, 32, spacing=0.25, subpixels=1)))
    encode(EncodeRequest(scene, model="sweep"), Runtime(threads=1), heard)
    assert len(heard.passed) > 1 and any(" KB" in line for line in heard.lines)
