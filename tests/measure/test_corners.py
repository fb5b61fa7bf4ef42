"""Corners that photos agree on have the depth that these put them at."""

import json
from pathlib import Path

import numpy as np
from scenes import make_cameras, scene_document

import tinysplat_runtime as ts
from tinysplat.measure.subjects.corners import agreed_corners
from tinysplat_runtime.scene.pictures import write_png

DEPTH, SHIFT = 4.0, 6
"""Of a plane before cameras in a row, in scene units, and pixels from photo to photo."""


def test_corners_of_a_plane_lie_in_it(tmp_path: Path) -> None:
    noise = np.fft.rfft2(np.random.default_rng(1).normal(size=(96, 200)))
    y, x = np.meshgrid(np.fft.fftfreq(96), np.fft.rfftfreq(200), indexing="ij")
    plane = np.fft.irfft2(noise * np.exp(-60 * (x**2 + y**2)), (96, 200))
    plane = np.repeat((255 * (plane - plane.min()) / np.ptp(plane)).astype(np.uint8)[..., None], 3, axis=-1)
    cameras = make_cameras(5, 96, 128, spacing=DEPTH * SHIFT / (1.1 * 128), turn=0)
    (tmp_path / "images").mkdir()
    (tmp_path / "cameras.json").write_text(json.dumps(scene_document(cameras)))
    for n in range(len(cameras)):
        write_png(tmp_path / "images" / f"{n:04}.png", plane[:, SHIFT * n :][:, :128])
    photos = agreed_corners(ts.load_scene(tmp_path))
    inverse = np.concatenate([depths for _, depths in photos])
    assert len(photos) == 5 and len(inverse) > 50 and np.median(np.abs(DEPTH * inverse - 1)) < 0.005
    assert np.mean(np.abs(DEPTH * inverse - 1) < 0.05) > 0.95
