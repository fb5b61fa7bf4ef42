"""Coding like a file: nothing changed costs nothing, an edit costs where it was made, and what does not fit is told."""

from __future__ import annotations

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


@pytest.mark.parametrize("profile", ["paper", "balanced"])
def test_depth_limits_reach_as_far_as_what_is_new(profile: str) -> None:
    data = ts.compress(make_smooth_gaussians(2, 24, 32, 0), profile)
    before = read_container(data).body.layers[0].depth_limits
    decoded = ts.decompress(data)
    for factor, place in ((0.4, (0, 3, 4)), (2.5, (1, 9, 20))):
        centre = decoded.cameras[place[0]].centre - decoded.origin
        decoded.means[place] = centre + factor * (decoded.means[place] - centre)
    depths = [
        (means - c.centre + decoded.origin) @ c.c2w[:3, 2]
        for means, c in zip(decoded.means, decoded.cameras, strict=True)
    ]
    low, high = np.min(depths), np.max(depths)
    assert low < 0.7 * before[0] and high > 1.4 * before[1]
    after = read_container(ts.compress(decoded, like=data)).body.layers[0].depth_limits
    np.testing.assert_allclose(after, (low, high), rtol=1e-5)
    unmoved = ts.decompress(data)
    unmoved.opacities[0, 0] = 0
    assert read_container(ts.compress(unmoved, like=data)).body.layers[0].depth_limits == before


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
