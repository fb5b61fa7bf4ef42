"""Corners that photos agree on find depths that are off, and by how many pixels."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from measure.tiny_runs import rows_of, shows, tiny_run
from scenes import make_cameras, make_gaussians, scene_document

import tinysplat_runtime as ts
from tinysplat.measure.studies import find_study
from tinysplat.measure.subjects.corners import agreed_corners, corner_errors
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.scene.pictures import write_png

DEPTH, SHIFT = 4.0, 6
"""Of a plane before cameras in a row, in scene units, and pixels from photo to photo."""

CAMERAS = make_cameras(5, 96, 128, spacing=DEPTH * SHIFT / (1.1 * 128), turn=0)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Photos of it, 128×96."""
    noise = np.fft.rfft2(np.random.default_rng(1).normal(size=(96, 200)))
    y, x = np.meshgrid(np.fft.fftfreq(96), np.fft.rfftfreq(200), indexing="ij")
    plane = np.fft.irfft2(noise * np.exp(-60 * (x**2 + y**2)), (96, 200))
    plane = np.repeat((255 * (plane - plane.min()) / np.ptp(plane)).astype(np.uint8)[..., None], 3, axis=-1)
    (tmp_path / "images").mkdir()
    (tmp_path / "cameras.json").write_text(json.dumps(scene_document(CAMERAS)))
    for n in range(len(CAMERAS)):
        write_png(tmp_path / "images" / f"{n:04}.png", plane[:, SHIFT * n :][:, :128])
    return tmp_path


def standing_at(depth: float) -> Gaussians:
    y, x = np.mgrid[:96, :128] + 0.5
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(CAMERAS[0].K).T
    means = np.stack([depth * rays + camera.centre for camera in CAMERAS])
    return replace(make_gaussians(5, 96, 128), means=means, cameras=tuple(CAMERAS))


def test_depths_where_photos_put_them_are_right_and_others_land_beside(folder: Path) -> None:
    agreed = agreed_corners(ts.load_scene(folder))
    errors, off = corner_errors(agreed, standing_at(DEPTH))
    assert len(errors) > 50 and np.median(errors) < 0.005 and np.mean(off < 0.5) > 0.95
    errors, off = corner_errors(agreed, standing_at(DEPTH * 1.5))
    assert np.median(errors) == pytest.approx(0.5, rel=0.02)
    steps = off * 3 / SHIFT  # in thirds of what a photo's step moves the plane
    assert np.mean(np.abs(steps - np.rint(steps).clip(1, 4)) < 0.1) > 0.95


def test_each_way_has_a_row_with_what_the_table_says(folder: Path, tmp_path: Path) -> None:
    rows = rows_of("corners", tiny_run(tmp_path / "report", folder))
    assert rows[0].way == "network" and 0 <= rows[0].figures["off"] <= 1
    table = find_study("corners").tables["corners"](rows)
    assert shows(table, 100 * rows[0].figures["depth"]) and shows(table, 100 * rows[0].figures["off"])
