"""A capture as few Gaussians: pictures by 3DGS' definition come to fit its photos, however these were exposed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scenes import make_cameras, tells

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.list.training.descent import Pace
from tinysplat_runtime.list.training.settings import PACE, Budget, Settings
from tinysplat_runtime.list.training.train import TrainStats, trained
from tinysplat_runtime.render import DEFINITION, render
from tinysplat_runtime.render.gradient import Target

AT_MOST = 700
"""Of 5,376."""


def wall(away: np.ndarray, height: int = 24, width: int = 32) -> tuple[Gaussians, list[Target]]:
    """Views of a painted wall at a depth of 3, each of which has it at its own, and photos of it."""
    cameras = make_cameras(len(away), height, width, turn=0, shift=(0, 0))
    y, x = np.mgrid[:height, :width] + 0.5
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(cameras[0].K).T
    centres = np.stack([camera.centre for camera in cameras])[:, None, None]
    painted = 3 * rays + centres
    paint = np.stack([np.sin(3 * painted[..., 0]), np.cos(4 * painted[..., 1]), np.sin(5 * painted.sum(-1))], axis=-1)
    lead = paint.shape[:3]
    quats, scales = np.broadcast_to([1.0, 0, 0, 0], (*lead, 4)), np.full((*lead, 3), 0.05)
    means = away[:, None, None, None] * rays + centres
    capture = Gaussians(means, quats, scales, np.full(lead, 0.6), paint[..., None, :], tuple(cameras))
    photos = (0.5 + 0.2820948 * paint).clip(0, 1).astype(np.float32)
    return capture, [Target(camera, photo) for camera, photo in zip(cameras, photos, strict=True)]


@pytest.fixture(scope="module")
def torn() -> tuple[Gaussians, list[Target]]:
    return wall(3 * (1 + 0.15 * np.random.default_rng(0).standard_normal(7)))


def psnr(drawn: Gaussians, target: Target, **options: Any) -> float:
    """dB of the picture by 3DGS' definition."""
    picture = render(drawn, target.camera, **DEFINITION, **options)
    return float(-10 * np.log10(np.square(picture - target.photo).mean()))


def mean_psnr(drawn: Gaussians, targets: list[Target], **options: Any) -> float:
    return float(np.mean([psnr(drawn, target, **options) for target in targets]))


def test_few_gaussians_show_the_photos_where_all_of_the_capture_do_not(torn) -> None:
    capture, targets = torn
    found = trained(capture, targets, Budget(AT_MOST, 140), threads=2, stats=(stats := TrainStats()))
    assert 0 < found.count == stats.kept <= AT_MOST < capture.count == stats.given
    assert mean_psnr(found, targets) > mean_psnr(capture.flat(), targets) + 3
    assert np.mean(stats.psnr) == pytest.approx(mean_psnr(found, targets), abs=1)
    assert stats.steps == stats.planned == 140 and not stats.is_cut_short
    for seen, given in zip(found.viewpoints, capture.cameras, strict=True):
        assert (seen.c2w == given.c2w).all() and (seen.K == given.K).all()
        assert (seen.width, seen.height) == (given.width, given.height)
    assert tells(stats.text.replace(",", ""), f"{capture.count} {stats.kept}")


def test_a_list_for_a_small_file_has_few_gaussians(torn) -> None:
    many, few = (trained(*torn, Budget(steps=20, size=size), threads=2).count for size in (None, 2_000))
    assert 0 < few < 2_000 / 4 < many  # no coder takes fewer than four bytes for one


def test_photos_of_different_exposure_are_as_good_as_others(torn) -> None:
    capture, targets = torn
    gains = np.array([1, 0.8, 1.15, 1, 0.9, 1.1, 1.05])
    darker = [replace(one, photo=np.float32(gain) * one.photo) for one, gain in zip(targets, gains, strict=True)]
    found = trained(capture, darker, Budget(AT_MOST, 210), threads=2)
    assert np.corrcoef([np.mean(seen.gain) for seen in found.viewpoints], gains)[0, 1] > 0.9
    assert mean_psnr(found, darker, exposed=True) > mean_psnr(found, darker) + 3


def test_the_mean_of_the_last_steps_shows_photos_better_than_the_last_step(torn) -> None:
    capture, targets = torn
    noise = np.random.default_rng(0)
    noisy = [
        replace(one, photo=one.photo + noise.normal(0, 0.1, one.photo.shape).astype(np.float32)) for one in targets
    ]
    mean, last = (
        trained(capture, noisy, Budget(AT_MOST, 420), threads=2, settings=Settings(pace=replace(PACE, averaged=share)))
        for share in (PACE.averaged, 0.0)
    )
    assert mean_psnr(mean, targets) > mean_psnr(last, targets) + 0.03


def test_a_dark_photo_makes_no_other_darker_or_brighter(torn) -> None:
    capture, targets = torn
    dark = [replace(one, photo=np.float32(0.3) * one.photo) if n == 2 else one for n, one in enumerate(targets)]
    found = trained(capture, dark, Budget(AT_MOST, 140), threads=2)
    gains = np.array([seen.gain for seen in found.viewpoints])
    assert gains[2] == pytest.approx((0.3,) * 3, abs=0.05) and np.median(gains) == pytest.approx(1, abs=0.01)
    even = trained(capture, targets, Budget(AT_MOST, 140), threads=2)
    assert mean_psnr(found, targets) > mean_psnr(even, targets) - 3


def test_what_moved_between_photos_is_not_learnt_and_changes_no_exposure() -> None:
    capture, targets = wall(np.full(9, 3.0), 48, 64)
    moved = [replace(one, photo=one.photo.copy()) for one in targets]
    for n in (1, 4, 6):
        moved[n].photo[13:39, 7 * n : 7 * n + 18] = 1, 1, 0.9
    colours = np.stack([one.photo for one in moved])[..., None, :]
    capture = replace(capture, sh=(colours - np.float32(0.5)) / np.float32(0.2820948))
    found = trained(capture, moved, Budget(AT_MOST, 270), threads=2, stats=(stats := TrainStats()))
    plain = trained(capture, moved, Budget(AT_MOST, 270), threads=2, settings=Settings(agreed=1))
    assert mean_psnr(found, targets) > mean_psnr(plain, targets) + 1
    assert np.allclose([seen.gain for seen in found.viewpoints], 1, atol=0.03)
    assert [n for n, share in enumerate(stats.contradicted) if share > 0.1] == [1, 4, 6]


def looking_lower(target: Target, pixels: float) -> Target:
    """The photo with a camera that is said to look so many pixels lower than it did."""
    c2w, angle = target.camera.c2w.copy(), pixels / target.camera.focal
    c2w[:3, :3] @= [[1, 0, 0], [0, np.cos(angle), np.sin(angle)], [0, -np.sin(angle), np.cos(angle)]]
    return replace(target, camera=replace(target.camera, c2w=c2w))


def test_cameras_that_drift_are_corrected_and_so_is_one_between_them() -> None:
    capture, targets = wall(np.full(9, 3.0))
    others = [0, 1, 2, 3, 5, 6, 7, 8]
    *photos, left_out = [looking_lower(targets[n], 1.5 * np.sin(0.7 * n)) for n in (*others, 4)]
    fields = {name: getattr(capture, name)[others] for name in FIELDS}
    given = replace(capture, **fields, cameras=tuple(photo.camera for photo in photos))
    found, fixed = (
        trained(given, photos, Budget(AT_MOST, 480), threads=2, settings=Settings(place=place)) for place in (0.05, 0.0)
    )
    assert mean_psnr(found, photos) > mean_psnr(fixed, photos) + 3
    assert psnr(found, left_out) > psnr(fixed, left_out) + 2


def test_what_photos_do_not_know_is_left_out(torn) -> None:
    capture, targets = torn
    holes = [replace(one, photo=one.photo.copy()) for one in targets]
    for one in holes:
        one.photo[4:9, 10:20] = np.nan
    found = trained(capture, holes, Budget(AT_MOST, 30), threads=1)
    assert np.isfinite(found.means).all() and np.isfinite(found.sh).all()


def test_the_same_steps_give_the_same_on_any_number_of_threads_and_what_fades_goes(torn) -> None:
    capture, targets = torn
    fast = Settings(pace=Pace(move=0, log_scale=0, sh=0, logit=2, last=1), start=1.0)  # so that many fade
    one, three = (trained(capture, targets, Budget(AT_MOST, 30), threads=n, settings=fast) for n in (1, 3))
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(three, name))
    assert one.count < trained(capture, targets, Budget(AT_MOST, 1), threads=1, settings=fast).count


def test_seconds_end_it_and_that_is_said(torn) -> None:
    capture, targets = torn
    trained(capture, targets, Budget(AT_MOST, 10**6, 0.5), threads=1, stats=(stats := TrainStats()))
    assert (
        1 <= stats.steps < stats.planned == 10**6 and stats.is_cut_short and tells(stats.text, f"{stats.steps} {10**6}")
    )


def test_seconds_end_it_long_before_all_of_many_photos_had_their_turn() -> None:
    capture, targets = wall(np.full(90, 3.0))
    trained(capture, targets, Budget(AT_MOST, seconds=1e-3), threads=1, stats=(stats := TrainStats()))
    assert stats.steps < 45 and stats.is_cut_short


@pytest.mark.parametrize(
    ("change", "options", "where"),
    [
        (lambda capture, targets: (capture.flat(), targets), {}, "capture"),
        (lambda capture, targets: (capture, targets[1:]), {}, "capture"),
        (lambda *given: given, {"seconds": 0.0}, "seconds"),
        (lambda *given: given, {"seconds": float("nan")}, "seconds"),
        (lambda *given: given, {"steps": 0}, "steps"),
        (lambda *given: given, {"gaussians": 0}, "gaussians"),
    ],
)
def test_what_cannot_be_trained_is_said(torn, change, options: dict, where: str) -> None:
    with pytest.raises(InputError) as caught:
        trained(*change(*torn), Budget(**options))
    assert caught.value.where == where


def test_what_is_before_nothing_is_seen_through_not_black(torn) -> None:
    capture, targets = wall(np.full(7, 3.0))
    right = np.zeros((24, 32), np.float32)
    right[:, 16:] = 1
    black = [replace(one, photo=one.photo * (1 - right[..., None])) for one in targets]
    masked = [replace(one, nothing=right) for one in black]
    covered = {}
    for name, given in (("black", black), ("nothing", masked)):
        found = trained(capture, given, Budget(AT_MOST, 140), threads=2)
        covered[name] = [
            render(found, one.camera, **DEFINITION, outputs=("alpha",))["alpha"][:, 20:].mean() for one in targets
        ]
    assert np.mean(covered["nothing"]) < 0.8 * np.mean(covered["black"]) and np.mean(covered["black"]) > 0.95


def test_before_an_object_of_its_own_nothing_floats_in_few_photos_but_what_they_alone_show() -> None:
    capture, targets = wall(np.full(3, 3.0), 48, 64)
    means, scales = capture.means.copy(), capture.scales.copy()
    for speck in ((2, slice(20, 23), slice(30, 32)), (0, slice(20, 23), slice(2))):  # so near that one photo has it
        means[speck] = capture.cameras[speck[0]].centre + (means[speck] - capture.cameras[speck[0]].centre) / 15
        scales[speck] /= 15
    masked = [replace(one, nothing=np.zeros(one.photo.shape[:2], np.float32)) for one in targets]
    whole = Settings(start=1.0, grown=0.0, detail=100, worth_of_few=0)
    left = {}
    for name, given in (("all", targets), ("object", masked)):
        stats, changed = TrainStats(), capture.changed(means=means, scales=scales)
        found = trained(changed, given, Budget(9_216, 2), threads=1, settings=whole, stats=stats)
        near = found.means[found.means[:, 2] < 1, 0]
        left[name] = (near < -0.2).sum(), (near > -0.2).sum(), stats.floating > 0, "floaters" in stats.text
    assert left == {"all": (6, 6, False, False), "object": (6, 0, True, True)}
