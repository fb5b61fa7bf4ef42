"""Refinement gains at photos that it never saw, knows when it does not, and refuses photos that do not fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from measure.evaluation_scenes import write_eval_scene
from scenes import make_cameras, make_smooth_gaussians, refusing, tells

import tinysplat_runtime as ts
from tinysplat_runtime.cli import main
from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.refine.stats import RefineStats
from tinysplat_runtime.render import DEFINITION, Renderer
from tinysplat_runtime.scene.intake.cameras_json import camera_entry
from tinysplat_runtime.scene.intake.layouts import load_scene
from tinysplat_runtime.scene.pictures import write_png
from tinysplat_runtime.scene.scenes import Frame, Scene

SIZE = 40, 48


def truth(views: int) -> ts.Gaussians:
    """A smooth surface of one colour a place, seen by `views` cameras."""
    gaussians = make_smooth_gaussians(views, *SIZE, degree=0)
    return replace(gaussians, opacities=np.full_like(gaussians.opacities, 0.8))


def worn(gaussians: ts.Gaussians, seed: int = 0) -> ts.Gaussians:
    """What a network might have made of it: colours, sizes and opacities off, and some floaters near the cameras."""
    rng = np.random.default_rng(seed)
    centres = np.stack([camera.centre for camera in gaussians.cameras])[:, None, None]
    shape = gaussians.opacities.shape
    nearer = np.where(rng.uniform(size=shape) < 0.05, 0.7, 1.0)[..., None]
    return replace(
        gaussians,
        means=centres + nearer * (gaussians.means - centres),
        scales=0.8 * gaussians.scales,
        opacities=(gaussians.opacities - 0.2 * rng.uniform(size=shape)).astype(np.float32),
        sh=gaussians.sh + 0.15 * rng.normal(size=gaussians.sh.shape),
    )


def photographed(folder: Path, gaussians: ts.Gaussians, cameras: list[ts.Camera]) -> Scene:
    renderer = Renderer(gaussians)
    frames = []
    for n, camera in enumerate(cameras):
        write_png(folder / f"{n}.png", renderer.render(camera))
        frames.append(Frame(camera, folder / f"{n}.png"))
    return Scene(folder, tuple(frames), 1.0, 10.0)


def psnr(gaussians: ts.Gaussians, scene: Scene, **drawn: str) -> float:
    renderer = Renderer(gaussians, **drawn)
    errors = [np.mean((renderer.render(frame.camera) - frame.image()) ** 2) for frame in scene.frames]
    return float(np.mean([-10 * np.log10(error) for error in errors]))


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> tuple[ts.Gaussians, Scene, Scene]:
    """Worn Gaussians of three views, their photos, and photos from between that refinement is not shown."""
    whole = truth(3)
    photos = photographed(tmp_path_factory.mktemp("photos"), whole, list(whole.cameras))
    between = photographed(tmp_path_factory.mktemp("between"), whole, make_cameras(4, *SIZE, spacing=0.1))
    return worn(whole), photos, between


def test_photos_that_it_never_saw_come_nearer(case: tuple[ts.Gaussians, Scene, Scene]) -> None:
    start, photos, between = case
    stats = RefineStats()
    refined = ts.refine(start, photos, 15, stats=stats)
    assert psnr(refined, between) > psnr(start, between)
    assert psnr(refined, between, **DEFINITION) > psnr(start, between, **DEFINITION)
    assert psnr(refined, photos) == pytest.approx(stats.after, abs=0.01)
    checks = {step: dB for step, dB, _ in stats.looks}
    assert stats.kept > 0 and checks[stats.kept] > checks[0]
    assert tells(refined.notes.refined, f"{stats.kept} 3")


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> tuple[ts.Gaussians, Scene, Scene]:
    """What a network makes of ten photos of a plane, the photos, and others from between."""
    whole = load_scene(write_eval_scene(tmp_path_factory.mktemp("capture") / "plane", frames=19))
    photos, between = whole.views(range(0, 19, 2)), whole.views(range(3, 19, 4))
    return ts.Runtime(threads=1).predict(photos, "sweep"), photos, between


def test_a_capture_comes_nearer_to_photos_that_it_never_saw(capture: tuple[ts.Gaussians, Scene, Scene]) -> None:
    found, photos, between = capture
    start, stats = worn(found), RefineStats()
    start = replace(start, sh=start.sh - 0.35)  # too dark, too
    refined = ts.refine(start, photos, stats=stats)
    assert psnr(refined, between) > psnr(start, between)
    assert stats.kept > 0 and stats.after > stats.before


def test_a_capture_with_photos_a_stop_darker_comes_nearer_too(
    capture: tuple[ts.Gaussians, Scene, Scene], tmp_path: Path
) -> None:
    found, photos, between = capture
    start, frames = worn(found), list(photos.frames)
    for v in range(1, len(frames), 3):
        write_png(tmp_path / f"{v}.png", frames[v].image() / 2)
        frames[v] = replace(frames[v], path=tmp_path / f"{v}.png")
    assert psnr(ts.refine(start, replace(photos, frames=tuple(frames))), between) > psnr(start, between)


def test_a_capture_whose_photos_agree_about_nothing_more_is_left_as_it_is(
    capture: tuple[ts.Gaussians, Scene, Scene], tmp_path: Path
) -> None:
    found, photos, _ = capture
    stats = RefineStats()
    assert ts.refine(found, contradicting(found, photos, 0.3, tmp_path), stats=stats) is found
    assert stats.kept == 0 and stats.reason


def test_photos_that_the_others_hardly_show_leave_a_window_as_it_is(
    case: tuple[ts.Gaussians, Scene, Scene], tmp_path: Path
) -> None:
    """Fitting them, every step shows each better from the Gaussians of the others, and nothing else."""
    start, photos, _ = case
    start, stats = (
        replace(start, sh=3 * start.sh),
        RefineStats(),
    )  # with contrast, so that they are known for what they are
    assert ts.refine(start, contradicting(start, photos, 0.25, tmp_path), 6, stats=stats) is start
    assert stats.steps == 0 and tells(stats.reason, "contradict")


def contradicting(gaussians: ts.Gaussians, scene: Scene, noise: float, folder: Path) -> Scene:
    """Photos of these Gaussians with noise of their own, which one may fit without showing any other better."""
    renderer, rng, frames = Renderer(gaussians), np.random.default_rng(2), []
    for number, frame in enumerate(scene.frames):
        picture = renderer.render(frame.camera)
        coarse = rng.normal(size=(picture.shape[0] // 4, picture.shape[1] // 4, 3)).repeat(4, axis=0).repeat(4, axis=1)
        write_png(folder / f"{number}.png", (picture + noise * coarse).clip(0, 1))
        frames.append(replace(frame, path=folder / f"{number}.png"))
    return replace(scene, frames=tuple(frames))


def test_results_are_the_same_on_any_number_of_threads(case: tuple[ts.Gaussians, Scene, Scene]) -> None:
    start, photos, _ = case
    one, other = (ts.Runtime(threads=n).refine(start, photos, 3) for n in (1, 3))
    assert all((getattr(one, name) == getattr(other, name)).all() for name in FIELDS)


def test_gaussians_stay_on_their_rays_and_turn_no_way(case: tuple[ts.Gaussians, Scene, Scene]) -> None:
    start, photos, _ = case
    refined = ts.refine(start, photos, 5)
    for view, camera in enumerate(start.cameras):
        before, after = start.means[view] - camera.centre, refined.means[view] - camera.centre
        away = (after * before).sum(axis=-1) / (before**2).sum(axis=-1)
        assert (away > 0).all() and np.abs(away - 1).max() > 1e-3
        np.testing.assert_allclose(after, away[..., None] * before, atol=1e-5)
    np.testing.assert_array_equal(refined.quats, start.quats)


def test_what_is_right_already_is_handed_back_as_it_is(tmp_path: Path) -> None:
    whole = truth(2)
    photos = photographed(tmp_path, whole, list(whole.cameras))
    stats = RefineStats()
    assert ts.refine(whole, photos, 4, stats=stats) is whole
    assert stats.kept == 0 and stats.text and not whole.notes.refined


def test_two_photos_gain_too(tmp_path: Path) -> None:
    whole = truth(2)
    photos, start, stats = photographed(tmp_path, whole, list(whole.cameras)), worn(whole), RefineStats()
    refined = ts.refine(start, photos, 9, stats=stats)
    assert stats.kept > 0 and psnr(refined, photos) > psnr(start, photos)


def test_a_photo_of_another_scene_is_left_out_and_the_rest_refined(
    case: tuple[ts.Gaussians, Scene, Scene], tmp_path: Path
) -> None:
    start, photos, _ = case
    write_png(tmp_path / "other.png", np.random.default_rng(1).uniform(size=(*SIZE, 3)))
    strange = replace(photos, frames=(*photos.frames[:2], replace(photos.frames[2], path=tmp_path / "other.png")))
    refined = ts.refine(start, strange, 3, stats=(stats := RefineStats()))
    assert stats.left_out == (2,) and refined.cameras == start.cameras[:2]
    ts.refine(start, photos, 1, stats=stats)
    assert not stats.left_out


def test_frames_are_found_by_their_poses(case: tuple[ts.Gaussians, Scene, Scene]) -> None:
    start, photos, between = case
    crowd = replace(photos, frames=(*between.frames, *photos.frames[::-1]))
    one, other = ts.refine(start, photos, 1), ts.refine(start, crowd, 1)
    assert all((getattr(one, name) == getattr(other, name)).all() for name in FIELDS)


def moved(frame: Frame, **changes) -> Frame:
    return replace(frame, camera=replace(frame.camera, **changes))


def test_photos_that_do_not_fit_are_refused_by_view(case: tuple[ts.Gaussians, Scene, Scene]) -> None:
    start, photos, _ = case
    few = replace(photos, frames=photos.frames[:2])
    with refusing(ts.InputError, "view 2"):
        ts.refine(start, few)
    K = photos.frames[1].camera.K * np.array([[1.2], [1.2], [1]])
    longer = replace(photos, frames=(photos.frames[0], moved(photos.frames[1], K=K), photos.frames[2]))
    with refusing(ts.InputError, "view 1: photo 1"):
        ts.refine(start, longer)
    with pytest.raises(ts.InputError) as caught:
        ts.refine(start.flat(), photos)
    assert caught.value.where == "gaussians"
    with pytest.raises(ts.InputError):
        fields = {name: getattr(start, name)[:1] for name in FIELDS}
        ts.refine(replace(start, **fields, cameras=start.cameras[:1]), photos)


@pytest.mark.parametrize(
    "budget", [{"steps": 0}, {"steps": 1.5}, {"seconds": -1.0}, {"seconds": 0}, {"steps": 3, "seconds": 3.0}]
)
def test_budgets_out_of_range_are_refused(case: tuple[ts.Gaussians, Scene, Scene], budget: dict) -> None:
    with pytest.raises(ts.InputError) as caught:
        ts.refine(case[0], case[1], **budget)
    assert caught.value.where in (*budget, "refine")


def test_seconds_end_it(case: tuple[ts.Gaussians, Scene, Scene]) -> None:
    stats = RefineStats()
    ts.refine(*case[:2], seconds=1e-6, stats=stats)
    assert stats.steps == 0


def test_the_commands_refine_report_and_say_so(
    case: tuple[ts.Gaussians, Scene, Scene], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import json

    start, photos, _ = case
    ts.save_gaussians(tmp_path / "g.npz", start)
    entries = [camera_entry(frame.path.name, frame.camera) for frame in photos.frames]
    (photos.path / "cameras.json").write_text(json.dumps({"frames": entries, "near": 1, "far": 10}))
    raw, out, report = (str(tmp_path / name) for name in ("g.npz", "r.tsplat", "r.json"))
    scene = ["--photos", str(photos.path)]
    assert main(["compress", raw, *scene, "--refine", "3", "-o", out, "--report", report]) == 0
    document = json.loads(Path(report).read_text())
    assert document["seconds"]["refine"] > 0 and 0 < (kept := document["refine"]["kept"]) <= 3
    assert any(tells(line, f"{kept}") for line in capsys.readouterr().out.splitlines() if "refine" in line)
    note = ts.inspect(Path(out).read_bytes())["refined"]
    assert tells(note, f"{kept} 3") and main(["info", out]) == 0
    assert note in capsys.readouterr().out
    for words in (["--refine", "3"], scene):
        assert main(["compress", raw, "-o", str(tmp_path / "x.tsplat"), *words]) == 2
    assert not (tmp_path / "x.tsplat").exists()
