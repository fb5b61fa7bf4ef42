"""Cameras of other trackers: distortion by its name, and what no camera here can express.

Poses are held by `test_every_layout`.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scene import trackers
from scenes import make_photo, refused, tells

from tinysplat_runtime.errors import InputWarning
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.intake.layouts import load_scene
from tinysplat_runtime.scene.lenses import Lens
from tinysplat_runtime.scene.pictures import write_png

HEIGHT, WIDTH, F = 48, 64, 60.0
POSE = " ".join(map(str, np.eye(4).ravel()))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "images").mkdir()
    write_png(tmp_path / "images/0000.png", make_photo(HEIGHT, WIDTH))
    return tmp_path


metashape, realityscan, bundler, meshroom = (
    partial(write, cameras=[Camera([[F, 0, WIDTH / 2], [0, F, HEIGHT / 2], [0, 0, 1]], np.eye(4), WIDTH, HEIGHT)])
    for write in (trackers.metashape, trackers.realityscan, trackers.bundler, trackers.meshroom)
)


def lens_of(path: Path) -> Lens:
    frame = load_scene(path).frames[0]
    K = frame.camera.K
    return frame.lens or Lens("PINHOLE", (K[0, 0], K[1, 1], K[0, 2], K[1, 2]), frame.camera.width, frame.camera.height)


def brown(x: Any, y: Any, k: tuple[float, ...], across: tuple[float, float]) -> Any:
    """Where Brown's distortion moves a ray, as OpenCV has it."""
    r2, (p1, p2) = x * x + y * y, across
    radial = 1 + sum(term * r2 ** (n + 1) for n, term in enumerate(k))
    shift = 2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.stack([x * radial + shift[0], y * radial + shift[1]], axis=1)


def fisheye(x: Any, y: Any, k: tuple[float, ...]) -> Any:
    r = np.hypot(x, y)
    angle = np.arctan(r)
    bent = angle * (1 + sum(term * angle ** (2 * n + 2) for n, term in enumerate(k)))
    return np.stack([x * bent / r, y * bent / r], axis=1)


M3M = (-0.09, -0.076, 0.116, -0.076)  # about a drone's; of k4 OpenCV's lenses know nothing
K, P = (0.1, -0.05, 0.02), (0.003, -0.002)
LENSES: list[tuple[Callable[..., Path], dict[str, Any], Callable[..., Any]]] = [
    (metashape, {"k1": K[0], "k2": K[1], "k3": K[2], "p1": P[1], "p2": P[0]}, lambda x, y: brown(x, y, K, P)),
    (metashape, {"k1": -0.09, "k2": -0.076, "k3": 0.116, "k4": -0.076}, lambda x, y: brown(x, y, M3M, (0, 0))),
    (realityscan, {"k1": -0.09, "k2": -0.076, "k3": 0.116, "k4": -0.076}, lambda x, y: brown(x, y, M3M, (0, 0))),
    (metashape, {"kind": "fisheye", "k1": 0.1, "k4": 0.02}, lambda x, y: fisheye(x, y, (0.1, 0, 0, 0.02))),
    (realityscan, {"k1": K[0], "k2": K[1], "k3": K[2], "t1": P[0], "t2": P[1]}, lambda x, y: brown(x, y, K, P)),
    (bundler, {"k1": K[0], "k2": K[1]}, lambda x, y: brown(x, y, K[:2], (0, 0))),
    (meshroom, {"type": "radial3", "distortionParams": K}, lambda x, y: brown(x, y, K, (0, 0))),
    (meshroom, {"distortionType": "brown", "distortionParams": (*K, *P)}, lambda x, y: brown(x, y, K, P)),
    (meshroom, {"type": "fisheye4", "distortionParams": (*K, 0.01)}, lambda x, y: fisheye(x, y, (*K, 0.01))),
]


@pytest.mark.parametrize(("write", "terms", "bent"), LENSES)
def test_distortion_bends_rays_as_its_tool_says(folder: Path, write, terms: dict[str, Any], bent) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    lens = lens_of(write(folder, **terms))
    x, y = np.array([[0.2, -0.3, 0.1], [0.1, 0.2, -0.25]])
    camera = pycolmap.Camera(model=lens.model, width=lens.width, height=lens.height, params=lens.params)
    found = camera.img_from_cam(np.stack([x, y, np.ones(3)], axis=1))
    atol = 0.1 if "k4" in terms and "kind" not in terms else 1e-6
    np.testing.assert_allclose(found, bent(x, y) * F + [WIDTH / 2, HEIGHT / 2], atol=atol)


@pytest.mark.parametrize(
    ("version", "fields", "expected"),
    [
        ("1.0.0", {"pxFocalLength": 50, "principalPoint": [30, 20]}, (50, 50, 30, 20)),
        ("1.2.0", {"pxFocalLength": [50, 55], "principalPoint": [30, 20]}, (50, 55, 30, 20)),
        ("1.2.1", {"pxFocalLength": [50, 55], "principalPoint": [-2, 1]}, (50, 55, 30, 25)),
        ("1.2.4", {"focalLength": 18, "pixelRatio": 2}, (32, 16, 32, 24)),
        ("1.2.6", {"focalLength": 18, "pixelRatio": 2}, (32, 64, 32, 24)),
    ],
)
def test_meshrooms_versions_mean_other_things_by_the_same_names(
    folder: Path, version: str, fields: dict[str, Any], expected: tuple[float, ...]
) -> None:
    np.testing.assert_allclose(lens_of(meshroom(folder, version=version, **fields)).params, expected)


@pytest.mark.parametrize(
    ("write", "terms", "words"),
    [
        (metashape, {"k3": 200.0, "k4": -900.0}, "k4 -900"),
        (metashape, {"p3": 0.1}, "p3"),
        (metashape, {"kind": "spherical"}, "'spherical'"),
        (metashape, {"kind": "fisheye", "p1": 0.1}, "p2"),
        (realityscan, {"heading": "north"}, "heading 'north'"),
        (meshroom, {"type": "3deanamorphic4"}, "'3deanamorphic4'"),
        (meshroom, {"view": {"rigId": 4}}, "rigId"),
        (meshroom, {"principalPoint": [1]}, "principalPoint"),
        (meshroom, {"view": {"poseId": 77}}, "pose"),
        (bundler, {"k1": "nan"}, "0 k1"),
    ],
)
def test_what_no_camera_here_has_is_refused_by_its_name(folder: Path, write, terms: dict[str, Any], words: str) -> None:
    assert tells(refused(load_scene, write(folder, **terms)), words)


def test_of_components_the_largest_is_read(folder: Path) -> None:
    others = "".join(
        f'<camera id="{i}" sensor_id="0" component_id="1" label="{name}"><transform>{POSE}</transform></camera>'
        for i, name in enumerate(("b", "c"))
    )
    for name in "bc":
        write_png(folder / f"images/{name}.png", make_photo(HEIGHT, WIDTH))
    path = metashape(folder, extra=others)
    with pytest.warns(InputWarning) as caught:
        scene = load_scene(path)
    assert any(tells(str(entry.message), f"{path}: 2 components 1 photos") for entry in caught)
    assert [frame.path.stem for frame in scene.frames] == ["b", "c"]


@pytest.mark.parametrize("declared", ['<!DOCTYPE a [<!ENTITY b "c">]>', '<!DOCTYPE a SYSTEM "file:///etc/passwd">'])
def test_documents_with_types_of_their_own_are_refused_unparsed(folder: Path, declared: str) -> None:
    path = metashape(folder)
    path.write_text(f"{declared}{path.read_text()}")
    assert "document type" in refused(load_scene, path)


def test_bundlers_counts_are_held_against_its_lines(folder: Path) -> None:
    path = bundler(folder)
    path.write_text(path.read_text().replace("2 0\n", "900000000 0\n", 1))
    assert tells(refused(load_scene, path), "900000000")


def test_photos_that_are_nowhere_are_named(folder: Path) -> None:
    (folder / "images/0000.png").unlink()
    assert tells(refused(load_scene, realityscan(folder)), "0000.png images/")


def test_skew_of_metashape_is_resampled(folder: Path) -> None:
    """A column, leaning as b2 says, stands upright in the middle of the picture, and half as high moves half as far."""
    b2 = 12.0
    v, u = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    leaning = np.exp(-((u - WIDTH / 2 - b2 * (v - HEIGHT / 2) / F) ** 2) / 18)
    write_png(folder / "images/0000.png", np.repeat(leaning[..., None], 3, axis=2).astype(np.float32))
    frame = load_scene(metashape(folder, b2=b2)).frames[0]
    assert frame.lens is not None and not frame.camera.K[0, 1]
    image = frame.image()[..., 0]
    where = (image * (np.arange(WIDTH) + 0.5)).sum(axis=1) / image.sum(axis=1)
    np.testing.assert_allclose(where, WIDTH / 2, atol=0.1)
    small = frame.resized(HEIGHT // 2, WIDTH // 2).image()[..., 0]
    np.testing.assert_allclose((small * (np.arange(WIDTH // 2) + 0.5)).sum(1) / small.sum(1), WIDTH / 4, atol=0.1)
