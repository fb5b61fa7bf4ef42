"""One task, three doors: the command, Python and a batch make the very same file of the same options."""

import sys
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from networks.two_planes import FAR, NEAR, trace, write_traced
from scenes import Heard, make_smooth_gaussians, psnr, refusing, tells, write_scene

import tinysplat_runtime as ts
from tinysplat_runtime.cli import main
from tinysplat_runtime.formats.table import load_gaussians
from tinysplat_runtime.list.training import MOST_GAUSSIANS
from tinysplat_runtime.recipe.encode import encode
from tinysplat_runtime.recipe.forecast import list_forecast
from tinysplat_runtime.recipe.kinds import chosen
from tinysplat_runtime.recipe.request import EncodeRequest
from tinysplat_runtime.render import DEFINITION

VIEWS, HEIGHT, WIDTH = 7, 500, 660
RUNTIME = ts.Runtime(threads=2)


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Seven photos larger than networks are given, and cameras that state no depths."""
    folder = tmp_path_factory.mktemp("many")
    traced = trace(VIEWS, HEIGHT, WIDTH, spacing=0.12, subpixels=1)
    return write_traced(folder, traced)


def commanded(folder: Path, target: Path, *words: str) -> bytes:
    assert main(["encode", str(folder), "-o", str(target), *words]) == 0
    return target.read_bytes()


def test_python_gives_the_very_bytes_of_the_command(
    many: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("--views", "auto:2", "--model", "sweep", "--profile", "fast", "--licence", "CC0-1.0")
    data = commanded(many, tmp_path / "a.tsplat", *words)
    said = capsys.readouterr().err
    assert tells(said, f"{WIDTH}x{HEIGHT}")
    options = {"views": "auto:2", "model": "sweep", "profile": "fast", "licence": "CC0-1.0"}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert ts.encode(ts.load_scene(many), **options) == data
    doubted = [line.replace(": warning: ", ": ") for line in said.splitlines() if ": warning: " in line]
    assert [str(one.message) for one in caught if one.category is ts.SceneWarning] == doubted
    described = ts.inspect(data)
    assert described["views"] == 2 and described["height"] * described["width"] <= 640 * 480


@pytest.mark.parametrize(
    ("words", "options"),
    [
        (
            ("--views", "0,3", "--size", "64x48", "--near", "2", "--far", "9"),
            {"views": [0, 3], "size": (48, 64), "near": 2, "far": 9.0},
        ),
        (
            ("--views", "auto:3", "--size", "64x48", "--target-size", "9KB"),
            {"views": "auto:3", "size": "64x48", "target_size": "9KB"},
        ),
        (("--size", "64x48", "--mode", "photos", "--qp", "3"), {"size": [48, 64], "mode": "photos", "qp": 3}),
        (("--size", "64x48", "--lossless", "--unit", "metre"), {"size": [48, 64], "lossless": True, "unit": "metre"}),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_every_option_says_the_same_at_both_doors(many: Path, tmp_path: Path, words, options) -> None:
    data = commanded(many, tmp_path / "a.tsplat", "-q", "--model", "sweep", *words)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ts.SceneWarning)
        assert ts.encode(str(many), "sweep", **options) == data


def test_a_file_to_be_like_may_be_a_path_or_bytes(many: Path, tmp_path: Path) -> None:
    scene = ts.load_scene(many, near=2, far=12).views([0, 3]).resized(48, 64)
    first = RUNTIME.encode(scene, "sweep", "fast", 6)
    (tmp_path / "first.tsplat").write_bytes(first)
    again = RUNTIME.encode(scene, "sweep", like=tmp_path / "first.tsplat")
    assert again == RUNTIME.encode(scene, "sweep", like=first)
    assert (ts.inspect(again)["profile"], ts.inspect(again)["qp"]) == ("fast", 6)


def test_doubts_are_warnings_of_the_line_that_asked(tmp_path: Path) -> None:
    scene = ts.load_scene(write_scene(tmp_path / "noise", views=2, height=48, width=64))
    with pytest.warns(ts.SceneWarning, match=r"0000\.png") as caught:
        ts.encode(scene, "sweep")
    assert caught[0].filename == __file__ and str(caught[0].message).startswith(f"{scene.path}: ")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        RUNTIME.encode(scene, "sweep", gaussians=RUNTIME.predict(scene, "sweep"))


def test_python_refuses_what_memory_does_not_suffice_for(many: Path, free_memory: Callable[..., None]) -> None:
    free_memory(300_000_000)
    with refusing(ts.InputError, "GB"):
        ts.encode(many, "sweep")


def test_who_listens_is_told_in_order_and_gets_what_was_coded(tmp_path: Path) -> None:
    scene = ts.load_scene(write_scene(tmp_path / "noise", views=2, height=32, width=48))
    heard = Heard()
    coded = encode(EncodeRequest(scene, model="sweep", save_gaussians=tmp_path / "g.npz"), RUNTIME, heard, keep=True)
    assert ts.load_gaussians(tmp_path / "g.npz").opacities.shape == (2, 32, 48)
    assert heard.kinds[-2:] == ["step", "step"] and heard.kinds.count("doubt") == len(coded.doubts) > 0
    assert coded.gaussians is not None and coded.raw_bytes > len(coded.data) and coded.seconds > 0
    assert encode(EncodeRequest(scene, model="sweep"), RUNTIME).gaussians is None


def test_a_list_is_foretold_from_its_photos(tmp_path: Path) -> None:
    """Two figures and seconds, the more the more there is to show, and no more than is asked for."""

    def foretold(
        side: int, views: int, at_most: int | None = None, train: str | None = None, copies: int = 1
    ) -> list[float]:
        folder = tmp_path / f"{side} {views} {at_most} {train} {copies}"
        scene = ts.load_scene(write_scene(folder, views=views, height=side, width=side))
        scene = replace(scene, frames=scene.frames * copies)
        line = list_forecast(EncodeRequest(scene, at_most=at_most, train=train), scene)
        assert line.startswith(f"{views * copies} photos of {side}x{side}:")
        words = line.replace(",", "").split()
        return [float(words[words.index(unit) - 1]) for unit in ("Gaussians", "KB", "CPU")]

    one, larger, more = foretold(192, 3), foretold(288, 3), foretold(192, 9)
    for other in (larger, more):
        assert all(a < b for a, b in zip(one, other, strict=True))
    assert foretold(192, 9, at_most=120)[0] == 120
    assert all(foretold(192, 9, train=train)[2] < more[2] for train in ("100", "1s"))
    assert foretold(288, 9, copies=400)[0] < MOST_GAUSSIANS / 2


@pytest.mark.parametrize("mode", ["gaussians", "list"])
def test_a_run_takes_the_steps_that_it_planned(many: Path, mode: str) -> None:
    """Seconds left of the whole run are right as long as it does."""
    pytest.importorskip("numba")
    heard = Heard()
    sizes = {"size": (48, 64), "near": 2, "far": 9, "train": 20 if mode == "list" else None}
    data = encode(EncodeRequest(many, mode=mode, **sizes), RUNTIME, heard).data
    assert (ts.inspect(data)["refined"] or "").startswith("20 steps on " if mode == "list" else "")
    *planned, compared = heard.planned
    assert compared == "comparing photos"  # which is the command's
    assert [step for step in planned if step in heard.steps] == heard.steps
    assert set(planned) <= set(heard.steps)


def test_wrong_types_are_told_what_is_accepted(many: Path, tmp_path: Path) -> None:
    scene = ts.load_scene(many)
    for call, named in (
        (lambda: ts.predict("desk"), "scene: Scene"),
        (lambda: ts.encode(3), "scene: 3 Scene"),
        (lambda: ts.compress("desk"), "gaussians: Gaussians"),
        (lambda: ts.decompress("f.tsplat"), "data:"),
        (lambda: ts.load_scene(b"desk"), "scene:"),
        (lambda: ts.load_gaussians(3), "path:"),
        (lambda: ts.save_gaussians(3, make_smooth_gaussians(1, 8, 8, 0)), "path:"),
        (lambda: ts.convert(3, "o.ply"), "source:"),
        (lambda: ts.Runtime(threads="two"), "threads: .*two"),
        (lambda: ts.load_scene(None), "scene: NoneType"),
        (lambda: scene.views(3), "views:"),
        (lambda: scene.views([0.5, 1]), "views: 0.5"),
    ):
        with refusing(ts.InputError, named):
            call()
    assert len(scene.views(np.array([0, 2])).frames) == 2
    shown = repr(scene)
    assert "\n" not in shown and all(str(number) in shown for number in (VIEWS, WIDTH, HEIGHT))


def test_a_capture_becomes_one_list_for_other_viewers_and_coded(many: Path, tmp_path: Path) -> None:
    pytest.importorskip("numba")
    file = tmp_path / "room.spz"
    words = ("--size", "64x48", "--at-most", "900", "--train", "40", "--near", "2", "--far", "9", "-q")
    commanded(many, file, *words, "--model", "sweep")
    data = commanded(many, tmp_path / "room.tsplat", *words, "--model", "sweep")
    scene = ts.load_scene(many).resized(48, 64)
    photos = [frame.image() for frame in scene.frames]
    for found in (ts.load_gaussians(file), ts.decompress(data)):
        assert 0 < found.count <= 900 and not found.is_per_pixel and len(found.viewpoints) == VIEWS
        shown = [ts.render(found, camera, **DEFINITION) for camera in scene.cameras]
        assert np.mean([psnr(one, other) for one, other in zip(shown, photos, strict=True)]) > 18


def test_what_only_a_tsplat_file_has_is_refused_of_a_list_and_the_reverse(
    many: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words, option in (
        (["room.spz", "--qp", "3"], "--qp"),
        (["a.tsplat", "--at-most", "9", "--mode", "gaussians"], "--at-most"),
        (["room.spz", "--fast"], "--fast"),
        (["a.tsplat", "--mode", "list", "--lossless"], "--mode"),
    ):
        assert main(["encode", str(many), "-o", str(tmp_path / words[0]), *words[1:]]) == 2
        assert tells(capsys.readouterr().err, option)


def test_two_photos_become_a_list_where_that_is_asked_for(many: Path, tmp_path: Path) -> None:
    pytest.importorskip("numba")
    path = tmp_path / "two.spz"
    options = ["--size", "64x48", "--train", "10", "--quiet"]
    assert main(["encode", str(many), "-o", str(path), "--views", "0,3", *options]) == 0
    assert 0 < load_gaussians(path).count < 2 * 64 * 48
    scene = ts.load_scene(many, near=2, far=9).views([0, 3]).resized(48, 64)
    data = RUNTIME.encode(scene, gaussians=RUNTIME.predict(scene), mode="list", train=10)
    assert ts.inspect(data)["mode"] == "list" and 0 < ts.decompress(data).count < 2 * 64 * 48


def test_photos_with_one_of_another_scene_are_those_without_it(tmp_path: Path) -> None:
    pytest.importorskip("numba")
    traced = trace(5, 48, 64, spacing=0.12, subpixels=1)
    traced.images[2] = np.random.default_rng(0).uniform(size=(6, 8, 3)).repeat(8, axis=0).repeat(8, axis=1)
    scene = ts.load_scene(write_traced(tmp_path, traced, depths=(NEAR, FAR)))
    heard, kept = Heard(), [0, 1, 3, 4]
    planes = encode(EncodeRequest(scene, fast=True), RUNTIME, heard)
    assert planes.photos.cameras == scene.views(kept).cameras and any(tells(line, "0002.png") for line in heard.lines)
    assert [*heard.steps, "comparing photos"] == heard.planned  # again, from what is left
    assert planes.data == encode(EncodeRequest(scene, views=kept, mode="gaussians"), RUNTIME).data
    trained = encode(EncodeRequest(scene, train=5), RUNTIME)
    assert trained.photos.cameras == planes.photos.cameras and len(ts.decompress(trained.data).viewpoints) == 4
    assert len(encode(EncodeRequest(scene, mode="photos"), RUNTIME).photos.cameras) == 5


@pytest.mark.parametrize(
    ("views", "asked", "mode"),
    [
        (3, {}, "list"),
        (2, {}, "gaussians"),
        (3, {"target_size": 90_000}, "list"),
        *[(3, asked, "gaussians") for asked in ({"lossless": True}, {"fast": True}, {"joint": False})],
        *[(3, asked, "gaussians") for asked in ({"model": "sweep"}, {"profile": "paper"}, {"mode": "gaussians"})],
        *[(2, asked, "list") for asked in ({"mode": "list"}, {"train": 9}, {"at_most": 900})],
        (3, {"model": "sweep", "at_most": 900}, "list"),
        (3, {"mode": "photos"}, "photos"),
    ],
    ids=str,
)
def test_three_photos_become_a_list_where_nobody_asks_for_what_planes_alone_have(
    tmp_path: Path, views: int, asked: dict, mode: str
) -> None:
    pytest.importorskip("numba")
    scene = ts.load_scene(write_scene(tmp_path / "scene", views=views, height=32, width=40))
    found = chosen(EncodeRequest(scene, **asked), scene, heard := Heard())
    assert found.mode == mode
    assert ("--fast" in " ".join(heard.lines)) == (mode == "list" and asked.keys() <= {"target_size"})


def test_without_numba_photos_become_planes_and_a_line_says_what_brings_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "numba", None)
    scene, heard = ts.load_scene(write_scene(tmp_path / "scene", views=3, height=32, width=40)), Heard()
    assert chosen(EncodeRequest(scene), scene, heard).mode == "gaussians"
    (line,) = heard.lines
    assert 'pip install "tinysplat[fast]"' in line
    assert chosen(EncodeRequest(scene, fast=True), scene, heard).mode == "gaussians" and len(heard.lines) == 1
    with refusing(ts.InputError, "mode: numba tinysplat[fast]"):
        chosen(EncodeRequest(scene, mode="list"), scene, heard)
