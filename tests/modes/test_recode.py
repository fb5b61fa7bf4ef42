"""Coding like a file: nothing changed costs nothing, an edit costs where it was made, and what does not fit is told."""

from dataclasses import replace

import numpy as np
import pytest
from hostile.containers import Seed, join
from scenes import drawn_psnr, make_smooth_gaussians, refusing

import tinysplat_runtime as ts
from tinysplat_runtime.codec.job import EncodeStats
from tinysplat_runtime.container.body import Container
from tinysplat_runtime.container.layout import PARAMETER_SETS, SCENE
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.errors import FormatError, InputError
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians

PROFILES = ("paper", "fast", "balanced", "max")


def payloads(container: Container) -> dict[tuple[str, int], bytes]:
    layer = container.body.layers[0]
    return {
        (f"{channel.name} {n}", view): bytes(container.table.payload(channel, view))
        for n, channel in enumerate(layer.channels)
        for view in range(len(channel.pictures))
    }


@pytest.mark.parametrize(("degree", "layers"), [(0, 1), (2, 2)])
@pytest.mark.parametrize("profile", PROFILES)
def test_a_decoded_file_coded_like_itself_is_the_same_file(profile: str, degree: int, layers: int) -> None:
    data = ts.compress(make_smooth_gaussians(2, 24, 32, degree, layers=layers), profile, 3)
    assert ts.compress(ts.decompress(data), like=data) == data


@pytest.mark.parametrize("profile", ["paper", "balanced"])
def test_a_scene_that_went_through_another_format_loses_nothing_that_shows(profile: str, tmp_path) -> None:
    g = make_smooth_gaussians(2, 40, 56, 1)
    data = ts.compress(g, profile)
    ts.save_gaussians(tmp_path / "g.ply", ts.decompress(data))
    again = ts.compress(ts.load_gaussians(tmp_path / "g.ply", (2, 40, 56), g.cameras), like=data)
    assert drawn_psnr(ts.decompress(data), g) - drawn_psnr(ts.decompress(again), g) <= 0.02


def test_an_edit_changes_the_pictures_of_its_views_and_classes_alone() -> None:
    data = ts.compress(make_smooth_gaussians(2, 40, 56, 1))
    decoded = ts.decompress(data)
    decoded.opacities[1, :10, :20] = 0
    edited = ts.compress(decoded, like=data)
    before, after = payloads(read_container(data)), payloads(read_container(edited))
    changed = {(name.split()[0], view) for name, view in before if before[name, view] != after[name, view]}
    assert changed == {("opacity0", 1)}
    assert ts.decompress(edited).opacities[1, :8, :18].max() < 0.1


def test_a_moved_scene_keeps_its_pictures() -> None:
    data = ts.compress(make_smooth_gaussians(2, 24, 32, 0))
    decoded = ts.decompress(data)
    shift = np.array([3.0, -2, 5])
    cameras = []
    for camera in decoded.cameras:
        c2w = camera.c2w.copy()
        c2w[:3, 3] += shift
        cameras.append(replace(camera, c2w=c2w))
    fields = {name: getattr(decoded, name) for name in FIELDS}
    moved = Gaussians(**fields, cameras=tuple(cameras), origin=decoded.origin + shift)
    again = ts.compress(moved, like=data)
    assert payloads(read_container(again)) == payloads(read_container(data))
    np.testing.assert_allclose(ts.decompress(again).origin, shift)


def test_another_scene_is_coded_with_the_steps_and_maps_of_the_file() -> None:
    first, other = (make_smooth_gaussians(2, 40, 56, 1, seed=seed) for seed in (0, 1))
    data = ts.compress(first)
    stats = EncodeStats()
    like = ts.Runtime(threads=1).compress(other, like=data, stats=stats)
    a, b = (read_container(one).body.layers[0] for one in (data, like))
    steps = [[(c.name, c.qp, c.scale) for c in layer.channels] for layer in (a, b)]
    assert steps[0] == steps[1]
    np.testing.assert_array_equal(a.basis, b.basis)
    assert not stats.clipped.get("depth")


def test_pictures_of_another_x265_are_all_coded_anew() -> None:
    g = make_smooth_gaussians(2, 24, 32, 0)
    parts = Seed.of(ts.compress(g, "paper")).parts
    other = next(p.data for p in Seed.of(ts.compress(g, "fast")).parts if p.kind == PARAMETER_SETS)
    scene = next(p.data for p in Seed.of(ts.compress(g, "fast")).parts if p.kind == SCENE)
    renamed = join([replace(p, data=scene) if p.kind == SCENE else p for p in parts])
    decoded = ts.decompress(renamed)
    decoded.opacities[0, 0] = 0
    again = ts.compress(decoded, like=renamed)
    assert [p.data for p in Seed.of(again).parts if p.kind == PARAMETER_SETS] == [other]
    assert drawn_psnr(ts.decompress(again), decoded) > 45


def test_what_does_not_fit_is_told() -> None:
    g = make_smooth_gaussians(2, 16, 24, 0)
    data = ts.compress(g)
    with refusing(InputError, "2x16x16 2x16x24"):
        ts.compress(make_smooth_gaussians(2, 16, 16, 0), like=data)
    with pytest.raises(InputError):
        ts.compress(g, like=ts.compress(g, lossless=True))
    with pytest.raises(InputError):
        ts.compress(g, qp=3, like=data)
    with pytest.raises(FormatError) as caught:
        ts.compress(g, like=data[:-1])
    assert str(caught.value).startswith("like: ")
    with pytest.raises(InputError):
        ts.compress(g.flat(), like=data)
