"""What a step is held to: exposures photo by photo, sizes that weigh alike, and a gain that pays for its bytes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_smooth_gaussians

from tinysplat_runtime.codec.profiles import find_profile
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.refine import loop as loop_module
from tinysplat_runtime.refine import refine as refine_module
from tinysplat_runtime.refine.loop import JUDGED, Loop
from tinysplat_runtime.refine.photos import matched
from tinysplat_runtime.refine.refine import Refining, _other
from tinysplat_runtime.refine.schedule import Turn
from tinysplat_runtime.refine.settings import settings_for
from tinysplat_runtime.render import Renderer
from tinysplat_runtime.render.gradient import MovableGaussians, PhotoError, Target
from tinysplat_runtime.render.near import DRAWN
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.images import write_png
from tinysplat_runtime.scene.scenes import Frame, Scene
from tinysplat_runtime.system.threads import Crew


def begun(views: int = 3, sizes: tuple[int, ...] = (1,)) -> Loop:
    """A loop on photos that show what Gaussians do, at multiples of the views' size."""
    gaussians = make_smooth_gaussians(views, 16, 20, degree=0)
    renderer = Renderer(gaussians, 1, compiled=True)
    targets = []
    for size in sizes:
        cameras = [camera.resized(16 * size, 20 * size) for camera in gaussians.cameras]
        targets.append([Target(camera, renderer.render(camera)) for camera in cameras])
    settings = replace(settings_for(3), price=0.0)
    return Loop(MovableGaussians(gaussians, Crew(1).map), targets, {}, settings, Crew(1).map)


def test_every_photo_has_an_exposure_of_its_own_and_their_mean_stays() -> None:
    loop = begun()
    for view, (by_gain, by_offset) in enumerate(((90.0, 0.0), (-90.0, 30.0), (0.0, -30.0))):
        loop._expose(view, PhotoError(1.0, 1.0, by_gain, by_offset, 100.0))
    step = loop.settings.exposure
    np.testing.assert_allclose(loop.exposures[:, 0] - 1, [-step, step, 0], atol=0.02 * step)
    np.testing.assert_allclose(loop.exposures[:, 1], [0, -step, step], atol=0.02 * step)


def test_photos_of_twice_the_size_weigh_as_much_as_the_others() -> None:
    loop = begun(sizes=(1, 2))
    loop._regularise = lambda grid: None  # type: ignore[method-assign]
    weights = []

    def measure(target: Target, *, weight: float, **options: object) -> PhotoError:
        weights.append(weight * target.photo.size)
        return PhotoError(1.0, 1.0, 0.0, 0.0, 1.0)

    loop.field.measure = measure  # type: ignore[method-assign]
    for _ in range(2):
        loop.step()
    assert len(weights) == 6 and set(weights) == {3 * 3 * 16 * 20}  # of three photos that each view is seen in


def test_a_state_is_judged_by_some_photos_spread_over_all() -> None:
    loop, seen = begun(19), []
    measure = loop.field.measure

    def counted(target: Target, **options: object) -> PhotoError:
        seen.append(loop._sizes[0].index(target))
        return measure(target, **options)

    loop.field.measure = counted  # type: ignore[method-assign]
    loop.photo_psnr()
    assert len(seen) == JUDGED and (seen[0], seen[-1]) == (0, 18) and set(np.diff(seen)) == {2, 3}


def test_large_photos_are_judged_by_tiles_spread_over_them(monkeypatch: pytest.MonkeyPatch) -> None:
    gaussians = make_smooth_gaussians(3, 130, 520, degree=0)
    targets = [Target(camera, np.full((130, 520, 3), 0.5, np.float32)) for camera in gaussians.cameras]
    loop = Loop(MovableGaussians(gaussians, Crew(1).map), [targets], {}, settings_for(3), Crew(1).map)
    monkeypatch.setattr(loop_module, "COVERED", 2.0)
    monkeypatch.setattr(loop_module, "JUDGED_PIXELS", 130 * 520 // 4)
    seen = [loop._checked(view) for view in loop.judged]
    again = [loop._checked(view) for view in loop.judged]
    known = sum(~np.isnan(loop._covered[view].photo[..., 0]) for view in loop.judged)
    assert seen == again and known.max() == 1  # no two photos by the same tiles
    for view, error in enumerate(seen):
        is_known = ~np.isnan(loop._covered[view].photo[..., 0])
        tiles = is_known[::32, ::128]
        assert error.known == is_known.sum() == pytest.approx(130 * 520 / 4, rel=0.3)
        assert (np.repeat(np.repeat(tiles, 32, 0), 128, 1)[:130, :520] == is_known).all()
        assert tiles.any(axis=0).sum() >= 3 and tiles.any(axis=1).sum() >= 2


def test_of_a_capture_a_photo_corrects_and_costs_no_more_than_what_it_sees() -> None:
    loop = begun(12)
    before, placed = loop.field.values.copy(), []
    place = loop.field.place

    def noted(views: set[int]) -> None:
        placed.append(views)
        place(views)

    loop.field.place = noted  # type: ignore[method-assign, assignment]
    loop._learn([6], Turn(0, 0))
    changed = {
        grid.view for grid in loop.field.grids if (loop.field.values[:, grid.rows] != before[:, grid.rows]).any()
    }
    assert placed == [changed] and len(changed) == DRAWN and 6 in changed
    assert np.flatnonzero(loop._corrections).tolist() == sorted(changed)
    assert loop._drawn == DRAWN


@pytest.mark.parametrize(("together", "corrections"), [(1, 3), (2, 2), (3, 1)])
def test_gaussians_are_corrected_after_every_photo_or_so_many(together: int, corrections: int) -> None:
    loop, states = begun(3), []
    loop.settings = replace(loop.settings, together=together)
    measure = loop.field.measure

    def noted(target: Target, **options: object) -> PhotoError:
        states.append(loop.field.values.copy())
        return measure(target, **options)

    loop.field.measure = noted  # type: ignore[method-assign]
    loop.step()
    assert len({state.tobytes() for state in states}) == corrections
    assert (loop._corrections == corrections).all() and loop.exposures[:, 0].mean() == pytest.approx(1)


def test_what_is_hidden_from_a_photo_is_not_corrected_by_it() -> None:
    loop, asked = begun(3), []
    measure = loop.field.measure

    def noted(target: Target, **options: object) -> PhotoError:
        asked.append(options.pop("hidden"))
        return measure(target, **options)

    loop.field.measure = noted  # type: ignore[method-assign]
    loop.step()
    assert asked == [settings_for(3).hidden] * 3 and settings_for(3).hidden > settings_for(2).hidden == 0


@pytest.fixture
def scene(tmp_path) -> Scene:
    gaussians = make_smooth_gaussians(3, 16, 20, degree=0)
    frames = []
    for n, camera in enumerate(gaussians.cameras):
        write_png(tmp_path / f"{n}.png", Renderer(gaussians, 1).render(camera))
        frames.append(Frame(camera, tmp_path / f"{n}.png"))
    return Scene(tmp_path, tuple(frames), 1.0, 10.0)


def test_a_step_is_kept_for_the_least_gain_and_for_no_less(scene: Scene) -> None:
    gaussians = make_smooth_gaussians(3, 16, 20, degree=0)
    refining = Refining(gaussians, scene, find_profile("balanced"), 0.0, Crew(1).map)
    least, score = settings_for(3).least_gain, refining.stats.looks[0][1]
    kept = []
    for step, check in enumerate((score + 0.9 * least, score + 1.1 * least, score + 2 * least), start=1):
        refining._loop.check = lambda check=check: check  # type: ignore[union-attr, method-assign]
        refining.stats.steps = step
        refining._look()
        kept.append(refining.stats.kept)
    assert kept == [0, 2, 2]


def test_photos_of_a_camera_that_turns_on_the_spot_are_told_apart(scene: Scene) -> None:
    gaussians = make_smooth_gaussians(3, 16, 20, degree=0)
    first = gaussians.cameras[0]
    c2w = first.c2w.copy()
    c2w[:3, :3] = c2w[:3, :3] @ np.array([[np.cos(0.1), 0, np.sin(0.1)], [0, 1, 0], [-np.sin(0.1), 0, np.cos(0.1)]])
    turned = Frame(Camera(first.K, c2w, first.width, first.height), scene.frames[1].path)
    found = matched(gaussians, Scene(scene.path, (turned, *scene.frames), 1.0, 10.0))
    assert [frame.path.name for frame in found.frames] == ["0.png", "1.png", "2.png"]


def test_exposures_follow_adam_by_hand() -> None:
    """Two photos; of the second nothing changes but by the mean, which goes back to 1 and 0."""
    loop = begun(2)
    settings = loop.settings = replace(loop.settings, momentum=0.5, memory=0.75, exposure=0.1)
    wanted, first, second = np.array([1.0, 0.0]), np.zeros(2), np.zeros(2)
    for count, (by_gain, by_offset) in enumerate(((30.0, -60.0), (-15.0, -90.0)), start=1):
        loop._expose(0, PhotoError(1.0, 1.0, by_gain, by_offset, 10.0))
        slope = np.array([by_gain, by_offset]) / 30
        first, second = 0.5 * first + 0.5 * slope, 0.75 * second + 0.25 * slope**2
        step = 0.1 * (first / (1 - 0.5**count)) / (np.sqrt(second / (1 - 0.75**count)) + 1e-3)
        wanted = wanted - step / 2  # half of it goes to the other photo, the other way
        loop._count += 1
        np.testing.assert_allclose(loop.exposures, [wanted, 2 * np.array([1, 0]) - wanted], rtol=1e-9)
    assert settings.exposure == 0.1


def test_depth_may_change_where_colours_do() -> None:
    loop = begun(2)
    grid = loop.field.grids[1]
    colours = loop.field.values[3:, grid.rows].reshape(3, grid.height, grid.width).astype(np.float64)
    across, down = loop._edge_weights(grid)
    scale = 10.0 * 0.28209479177387814
    wanted = np.exp(-scale * np.abs(colours[:, :, 1:] - colours[:, :, :-1]).mean(axis=0))
    np.testing.assert_allclose(across[:, :-1], wanted, rtol=1e-5)
    np.testing.assert_allclose(
        down[:-1], np.exp(-scale * np.abs(colours[:, 1:] - colours[:, :-1]).mean(axis=0)), rtol=1e-5
    )
    assert not across[:, -1].any() and not down[-1].any() and across.dtype == down.dtype == np.float32


@pytest.mark.parametrize(("explained", "is_other"), [(0.24, True), (0.26, False)])
def test_a_photo_of_which_less_than_a_quarter_is_explained_is_of_something_else(
    explained: float, is_other: bool
) -> None:
    photo = np.random.default_rng(0).uniform(size=(4, 5, 3)).astype(np.float32)
    camera = make_smooth_gaussians(1, 4, 5, degree=0).cameras[0]
    variance = float(sum(np.square(photo[..., c] - photo[..., c].mean()).sum() for c in range(3)))
    targets = [Target(camera, photo)] * 2
    errors = [PhotoError(1.0, share * variance, 0, 0, 20.0) for share in (0.5, 1 - explained)]
    assert _other(errors, targets) == (1 if is_other else None)


@pytest.mark.parametrize(("off", "fits"), [(0.49, True), (0.51, False)])
def test_intrinsics_may_be_half_a_pixel_off(scene: Scene, off: float, fits: bool) -> None:
    gaussians = make_smooth_gaussians(3, 16, 20, degree=0)
    K = scene.frames[1].camera.K.copy()
    K[1, 2] += off
    moved = replace(scene.frames[1], camera=replace(scene.frames[1].camera, K=K))
    given = replace(scene, frames=(scene.frames[0], moved, scene.frames[2]))
    if fits:
        assert len(matched(gaussians, given).frames) == 3
    else:
        with pytest.raises(InputError, match=r"view 1: photo 1 at 20x16 has other intrinsics, 0\.51 px off"):
            matched(gaussians, given)


def test_shares_of_places_between_go_round() -> None:
    loop = begun(4)
    fronts = loop._fronts[1]
    assert len(fronts) == 2
    for place in range(4):
        np.testing.assert_array_equal(loop._shares(1, place).front, fronts[place % 2].front)
    assert not loop._shares(1, None).has_front and loop._drawn == 4
    assert loop.judged == [0, 1, 2, 3] and len(begun(2)._fronts[0]) == 1


@pytest.mark.parametrize(
    ("step", "took", "costs"), [("step", {}, 8.0), ("small step", {}, 3.0), ("step", {"step": 5.0}, 5.0)]
)
def test_a_step_begins_where_it_a_look_and_the_end_may_be_expected_to_fit(
    step: str, took: dict[str, float], costs: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Six photos, three of them drawn in 1 s: a first step costs as much as drawing all four times, a small one 1.5."""
    refining = object.__new__(Refining)
    refining._sizes, refining._seconds = [[None] * 6], {"look": 2.0, "judging": 1.0, **took}  # type: ignore[list-item]
    refining._loop = object.__new__(Loop)
    refining._loop.judged = [0, 2, 5]
    monkeypatch.setattr(refine_module.time, "perf_counter", lambda: 100.0)
    assert refining._has_time(step, 100 + costs + 3.01) and not refining._has_time(step, 100 + costs + 2.99)


def test_the_check_counts_pixels_of_which_others_left_at_most_four_tenths_at_first() -> None:
    loop, asked = begun(3), []
    left_there = np.linspace(0, 1, 16 * 20, dtype=np.float32).reshape(16, 20)

    def measure(target: Target, *, shares, shown=None, most_left=1.0) -> PhotoError:
        asked.append((target, shares, shown is not None, most_left))
        if shown is not None:
            shown[..., 3] = left_there
        return PhotoError(1.0, 0.03, 0.0, 0.0, float(len(asked) % 2))

    loop.field.measure = measure  # type: ignore[method-assign, assignment]
    loop.exposures[1] = 1.5, 0.25
    loop._checked(1)
    loop._checked(1)
    (first, shares, with_left, most), (again, later, without, _) = asked
    assert (with_left, most, without) == (True, 0.4, False)
    assert shares.whole[1] == 0 == later.whole[1] and shares.whole[0] > 0
    assert (first.gain, first.offset) == (again.gain, again.offset) == (1.5, 0.25)
    np.testing.assert_array_equal(np.isnan(again.photo).all(axis=-1), left_there > 0.4)
    np.testing.assert_array_equal(again.photo[left_there <= 0.4], first.photo[left_there <= 0.4])
    asked.clear()
    assert loop.check() == pytest.approx(20)  # photos of which nothing is known say nothing
    assert len(asked) == 3


def test_how_things_stand_is_said_in_few_words() -> None:
    refining = object.__new__(Refining)
    refining._smaller, refining._loop = None, None
    assert refining.note() == ""
    refining._loop = begun(2)
    assert refining.note() == ""
    refining._loop.errors = tuple(PhotoError(1, squared, 0, 0, 1) for squared in (0.03, 0.003))
    assert refining.note() == "photos 25.00 dB"
