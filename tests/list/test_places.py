"""Places, which were seen from within: what is left out of them with cameras of their photos, and without."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from list.looks import psnr
from scenes import make_list

import tinysplat_runtime as ts
from tinysplat_runtime.cli import main
from tinysplat_runtime.codec.job import EncodeStats
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.render.paths import looking_along
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.intake.cameras_json import camera_entry

pytest.importorskip("numba")

from tinysplat_runtime.list.views import views_of

COUNT = 3000


@pytest.fixture(scope="module")
def place() -> Gaussians:
    """What was photographed from about its middle: the farther away, the larger."""
    rng = np.random.default_rng(4)
    some = make_list(COUNT, 0, rng)
    away = np.exp(rng.uniform(-1.0, 2.5, COUNT))[:, None]
    towards = some.means / np.linalg.norm(some.means, axis=1, keepdims=True) * [1, 0.4, 1]
    return replace(some, means=away * towards, scales=0.4 * away * some.scales)


def cameras_within(count: int, start: float = 0.0, moved: float = 0.0, focal: float = 90) -> list[Camera]:
    """Cameras near the middle that look about; `start` turns all of them."""
    cameras = []
    for turn in start + 2 * np.pi * np.arange(count) / count:
        c2w = np.eye(4)
        c2w[:3, :3] = looking_along(np.array([np.sin(turn), 0, np.cos(turn)]), down=np.array([0.0, 1.0, 0.0]))
        c2w[:3, 3] = [0.1 * np.sin(2 * turn) + moved, 0, 0.1 * np.cos(turn)]
        cameras.append(Camera(np.array([[focal, 0, 48], [0, focal, 36], [0, 0, 1.0]]), c2w, 96, 72))
    return cameras


def test_a_place_without_cameras_keeps_all_and_says_how_to_have_it_smaller(place):
    with pytest.warns(ts.InputWarning, match="--cameras"):
        data = ts.compress(place)
    assert ts.decompress(data).count == COUNT


def turned(gaussians: Gaussians, seed: int) -> Gaussians:
    """About the origin, by a random rotation; spheres of the same sizes."""
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return replace(gaussians, means=gaussians.means @ turn, scales=np.repeat(gaussians.scales[:, :1], 3, axis=1))


def figure(count: int) -> Gaussians:
    """An object: a body with two arms, as large everywhere and nothing about it."""
    ball = make_list(count, 0, np.random.default_rng(4), size=0.3)
    means = ball.means.copy()
    means[::3] = means[::3] * [6, 0.6, 0.6] + [0, 0.3, 0]
    means[1::3] = means[1::3] * [1, 3, 1]
    return replace(ball, means=means, scales=0.3 * ball.scales)


def desk(count: int) -> Gaussians:
    """Trained from photos on one side of it: a desk before a wall, sizes alike, and a few that float far behind."""
    rng = np.random.default_rng(5)
    some = make_list(count, 0, rng)
    means = rng.uniform(-1, 1, (count, 3)) * [1, 1, 0.02]
    means[::2] = means[::2][:, [0, 2, 1]] + [0, 1, -1]
    means[::40] *= rng.uniform(1, 6, (len(means[::40]), 1))
    return replace(some, means=means, opacities=0.3 + 0.7 * some.opacities)


@pytest.mark.parametrize(("size", "moved"), [(1.0, 50.0), (1e3, -20.0)])
def test_only_what_is_surely_an_object_is_pruned_from_outside(place, size, moved):
    """Wherever it lies, however large and turned it is; nor is it joined to a place, or a room's box."""
    rng = np.random.default_rng(6)
    walls = rng.uniform(-1, 1, (COUNT, 3))
    walls[np.arange(COUNT), rng.integers(0, 3, COUNT)] = rng.choice([-1, 1], COUNT)
    room = replace(figure(COUNT), means=walls, scales=np.full((COUNT, 3), 0.05), opacities=np.full(COUNT, 0.9))
    lone, lying = figure(COUNT), desk(COUNT)
    joined = Gaussians(**{name: np.concatenate([getattr(one, name) for one in (lone, lying)]) for name in FIELDS})
    places = [place, lying, turned(lying, 1), room, turned(room, 2), joined]
    for gaussians, expected in [(lone, False), (turned(lone, 3), False), *((one, True) for one in places)]:
        scaled = replace(gaussians, means=size * gaussians.means + moved, scales=size * gaussians.scales)
        assert bool(views_of(scaled).doubt) == expected


@pytest.mark.parametrize("count", [200, COUNT])
@pytest.mark.parametrize("are_known", [False, True])
def test_a_place_keeps_its_looks_however_much_its_gaussians_cover(count, are_known):
    """Few of them, each of many pixels, as well as many, from where nobody told that people stand too."""
    lying = desk(count)
    lying = replace(lying, scales=lying.scales * np.float32(0.6 * (COUNT / count) ** 0.5))
    towards = [camera for camera in cameras_within(16, moved=0.3, focal=60) if camera.rotation[2, 2] < 0]
    lying = replace(lying, means=lying.means * [1, 0.5, 1] - [0, 0, 2.5])
    stats = EncodeStats()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = ts.decompress(ts.compress(lying, **({"cameras": towards} if are_known else {}), stats=stats))
    assert psnr(found, lying, towards) > (34 if are_known else 31)
    assert bool(stats.views) == are_known
    assert not are_known or abs(stats.psnr - psnr(found, lying, towards)) < 4


def test_cameras_leave_out_what_nobody_sees_from_where_they_stand(place):
    """Many of the Gaussians lie behind all cameras; what is before them looks as with all kept, in fewer bytes."""
    stats, cameras = EncodeStats(), [camera for camera in cameras_within(24, focal=40) if camera.rotation[2, 2] > 0.2]
    data = ts.compress(place, cameras=cameras, stats=stats)
    found = ts.decompress(data)
    between = [camera for camera in cameras_within(24, start=0.06, focal=40) if camera.rotation[2, 2] > 0.3]
    behind = [(one.means[:, 2] < -np.abs(one.means[:, 0])).sum() for one in (found, place)]
    assert found.count == COUNT - stats.left_out and behind[0] / behind[1] < found.count / COUNT
    whole = ts.compress(place, keep_all=True)
    assert len(data) < len(whole)
    coarse = ts.decompress(ts.compress(place, keep_all=True, target_size=len(data)))
    assert psnr(found, place, between) > psnr(coarse, place, between)


def test_files_keep_cameras_and_are_coded_again_by_them(place):
    cameras = cameras_within(12)
    again = ts.decompress(ts.compress(place, cameras=cameras))
    assert len(again.viewpoints) == 12
    for found, given in zip(again.viewpoints, cameras, strict=True):
        np.testing.assert_allclose(found.c2w, given.c2w, atol=1e-6)
        np.testing.assert_allclose(found.K, given.K, atol=1e-4)
        assert (found.width, found.height) == (given.width, given.height)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert ts.decompress(ts.compress(again)).count <= again.count


def test_cameras_of_another_scene_among_others_decide_nothing(place):
    own = cameras_within(8)
    data = ts.compress(place, cameras=[*own, *cameras_within(5, moved=1e4)])
    alone = ts.decompress(ts.compress(place, cameras=own))
    assert ts.decompress(data).count == alone.count < COUNT


@pytest.mark.parametrize("strange", ["of another scene", "half of another scene", "in a wall", "one"])
def test_cameras_that_do_not_show_a_place_leave_nothing_out(place, strange):
    cameras = {
        "of another scene": cameras_within(8, moved=1e4),
        "half of another scene": cameras_within(8) + cameras_within(8, moved=1e4),
        "in a wall": cameras_within(8),
        "one": cameras_within(1),
    }[strange]
    if strange == "in a wall":
        towards = place.means[:500] / np.linalg.norm(place.means[:500], axis=1, keepdims=True)
        wall = {"means": 0.3 * towards, "scales": np.full((500, 3), 0.06), "opacities": np.ones(500)}
        wall |= {name: getattr(place, name)[:500] for name in ("quats", "sh")}
        place = Gaussians(**{name: np.concatenate([getattr(place, name), wall[name]]) for name in FIELDS})
    with pytest.warns(ts.InputWarning, match="camera"):
        data = ts.compress(place, cameras=cameras)
    found = ts.decompress(data)
    assert found.count == place.count and not found.viewpoints


def test_a_list_in_the_folders_of_3dgs_finds_its_cameras(place, tmp_path: Path):
    folder = tmp_path / "model" / "point_cloud" / "iteration_30000"
    folder.mkdir(parents=True)
    ts.save_gaussians(folder / "point_cloud.ply", place)
    entries = [
        {"id": number, "img_name": f"{number:05d}", "width": camera.width, "height": camera.height}
        | {"position": camera.centre.tolist(), "rotation": camera.rotation.T.tolist()}
        | {"fx": camera.K[0, 0], "fy": camera.K[1, 1]}
        for number, camera in enumerate(cameras_within(12))
    ]
    (tmp_path / "model" / "cameras.json").write_text(json.dumps(entries))
    out = tmp_path / "place.tsplat"
    assert main(["compress", str(folder / "point_cloud.ply"), "-o", str(out)]) == 0
    assert len(ts.load_gaussians(out).viewpoints) == 12
    other = tmp_path / "other.tsplat"
    (tmp_path / "here.ply").write_bytes((folder / "point_cloud.ply").read_bytes())
    command = ["compress", str(tmp_path / "here.ply"), "-o", str(other)]
    assert main([*command, "--cameras", str(tmp_path / "model" / "cameras.json")]) == 0
    assert other.read_bytes() == out.read_bytes()
    (tmp_path / "model" / "cameras.json").write_text("[{}]")
    with pytest.warns(ts.InputWarning, match=r"cameras\.json"):
        assert not ts.load_gaussians(folder / "point_cloud.ply").viewpoints


def test_cameras_of_other_tools_beside_a_list_are_found_and_said(place, tmp_path: Path, capsys):
    """OpenSplat's and nerfstudio's, whose Gaussians lie where it moved them before it trained."""
    cameras, turn = cameras_within(12), np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    expected = [camera.c2w for camera in cameras]
    ts.save_gaussians(tmp_path / "splat.ply", place)
    applied, whole = np.eye(4), np.eye(4)
    applied[:3, 3], whole[:3, :3], whole[:3, 3] = [1, 2, 3], turn, [0.5, 0, 0]
    before = np.linalg.inv(whole @ np.linalg.inv(applied))
    frames = []
    for number, camera in enumerate(cameras):
        c2w = camera.c2w @ np.diag([1.0, -1, -1, 1])
        c2w[:3, 3] /= 0.25
        frames.append({"file_path": f"{number}.jpg", "transform_matrix": (before @ c2w).tolist()})
    document = {"w": 96, "h": 72, "fl_x": 90, "cx": 48, "cy": 36, "frames": frames}
    document |= {"applied_transform": applied[:3].tolist(), "applied_scale": 2}
    (tmp_path / "transforms.json").write_text(json.dumps(document))
    moved = {"transform": whole[:3].tolist(), "scale": 0.5}
    (tmp_path / "dataparser_transforms.json").write_text(json.dumps(moved))
    for found, c2w in zip(ts.load_gaussians(tmp_path / "splat.ply").viewpoints, expected, strict=True):
        np.testing.assert_allclose(found.c2w, c2w, atol=1e-9)
    entries = [camera_entry(f"{number}", camera) for number, camera in enumerate(cameras)]
    (tmp_path / "cameras.json").write_text(json.dumps({"frames": entries}))
    assert main(["compress", str(tmp_path / "splat.ply"), "-o", str(tmp_path / "place.tsplat")]) == 0
    assert "cameras.json: used as cameras of 12 photos" in capsys.readouterr().err
    assert len(ts.load_gaussians(tmp_path / "place.tsplat").viewpoints) == 12


def test_cameras_move_along_and_other_formats_of_ours_keep_them(place, tmp_path: Path):
    path = tmp_path / "place.npz"
    ts.save_gaussians(path, replace(place, viewpoints=cameras_within(3)))
    assert main(["convert", str(path), "--translate", "1,2,3", "-o", str(tmp_path / "moved.npz")]) == 0
    for found, given in zip(ts.load_gaussians(tmp_path / "moved.npz").viewpoints, cameras_within(3), strict=True):
        np.testing.assert_allclose(found.centre, np.add(given.centre, (1, 2, 3)))
        assert (found.K == given.K).all() and (found.width, found.height) == (96, 72)
