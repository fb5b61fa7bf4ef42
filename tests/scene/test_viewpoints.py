"""Cameras that photos corrected: one is drawn as those beside it were corrected, wherever the scene is moved to."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import make_cameras, make_smooth_gaussians

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.editing import similarity
from tinysplat_runtime.render import DEFINITION, render
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.viewpoints import Viewpoint, corrected

TURN, SHIFT = np.array([0.02, -0.01, 0.03]), np.array([0.1, 0.2, -0.3])


def at(camera: Camera, turn: np.ndarray = TURN, shift: np.ndarray = SHIFT, is_alone: bool = False) -> Viewpoint:
    return Viewpoint.of(camera, turn=turn, shift=shift, is_alone=is_alone)


def moved_by(turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """(4, 4) of a rotation vector and a shift: the exponential of the rotation's generator, term by term."""
    x, y, z = turn
    generator, term, total = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]), np.eye(3), np.eye(3)
    for n in range(1, 12):
        term = term @ generator / n
        total = total + term
    return np.vstack([np.column_stack([total, shift]), [0, 0, 0, 1]])


def test_where_a_photo_was_taken_its_own_step_counts():
    cameras = make_cameras(3)
    found, _ = corrected(cameras[1], [at(cameras[0], -TURN), at(cameras[1]), cameras[2]])
    np.testing.assert_allclose(found.c2w, cameras[1].c2w @ moved_by(TURN, SHIFT), atol=1e-6)
    assert (found.K == cameras[1].K).all() and (found.width, found.height) == (cameras[1].width, cameras[1].height)


def test_between_photos_both_count_alike():
    left, middle, right = make_cameras(3, turn=0)
    found, _ = corrected(middle, [at(left, TURN, 0 * SHIFT), at(right, -TURN, 2 * SHIFT)])
    np.testing.assert_allclose(found.c2w, middle.c2w @ moved_by(0 * TURN, SHIFT), atol=1e-12)


def test_a_step_that_is_a_photos_alone_counts_for_no_other_camera():
    left, middle, right = make_cameras(3, turn=0)
    seen = [at(left, TURN, SHIFT), at(middle, -TURN, SHIFT, True), at(right, TURN, SHIFT)]
    beside = replace(middle, c2w=middle.c2w @ moved_by(0 * TURN, np.array([0.01, 0, 0])))
    np.testing.assert_allclose(corrected(beside, seen)[0].c2w, beside.c2w @ moved_by(TURN, SHIFT), atol=1e-12)
    np.testing.assert_allclose(corrected(middle, seen)[0].c2w, middle.c2w @ moved_by(-TURN, SHIFT), atol=1e-6)


def test_a_camera_stays_where_no_photo_has_a_step():
    cameras = make_cameras(3)
    assert corrected(cameras[0], cameras)[0] is cameras[0] and corrected(cameras[0], ())[0] is cameras[0]


def test_a_picture_to_be_held_against_a_photo_is_as_bright_as_those_beside_it():
    flat = make_smooth_gaussians().flat()
    left, middle, right = make_cameras(3, turn=0)
    dark, warm = (np.array(gain) for gain in ([0.25, 0.25, 0.25], [0.64, 0.36, 0.16]))
    known = flat.changed(viewpoints=(Viewpoint.of(left, gain=dark), Viewpoint.of(right, gain=warm)))
    steady, at_photo, between = (
        render(known, camera, exposed=exposed) for camera, exposed in ((left, False), (left, True), (middle, True))
    )
    assert steady.max() > 0.2
    np.testing.assert_allclose(steady, render(flat, left), atol=1e-6)
    np.testing.assert_allclose(at_photo, steady * dark, atol=1e-5)
    np.testing.assert_allclose(between, render(flat, middle) * [0.4, 0.3, 0.2], atol=1e-5)


def test_a_scene_that_is_moved_takes_steps_along():
    flat = make_smooth_gaussians().flat()
    camera = flat.viewpoints[0]
    stepped = flat.changed(viewpoints=tuple(at(one, 0.3 * TURN, 0.1 * SHIFT) for one in flat.viewpoints))
    motion = {"rotation": [[0.0, -1, 0], [1, 0, 0], [0, 0, 1]], "scale": 2.0, "translation": [1.0, 2, 3]}
    before, after = (
        render(given, seen.viewpoints[0], **DEFINITION)
        for given, seen in ((stepped, flat), (similarity(stepped, **motion), similarity(flat, **motion)))
    )
    assert np.abs(before - render(flat, camera, **DEFINITION)).max() > 0.01
    np.testing.assert_allclose(after, before, atol=2e-3)


@pytest.mark.parametrize("fault", [{"turn": np.array([0, np.nan, 0])}, {"shift": np.zeros(2)}, {"gain": np.zeros(3)}])
def test_a_step_is_three_and_three_finite_numbers_and_gains_are_positive(fault):
    with pytest.raises(InputError) as caught:
        Viewpoint.of(make_cameras(1)[0], **fault)
    assert caught.value.where == next(iter(fault))
