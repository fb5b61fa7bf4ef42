"""When what is done: order, turns and smaller copies by hand; what values may become; what is said of it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.sh import C0
from tinysplat_runtime.refine.refine import MAX_STEPS, _limit
from tinysplat_runtime.refine.schedule import Turn, order, steps_below, turn
from tinysplat_runtime.refine.settings import FOR_TWO, LIMITS, STEPS, Settings, settings_for
from tinysplat_runtime.refine.stats import RefineStats


@pytest.mark.parametrize(
    ("step", "photos", "wanted"),
    [
        (0, 1, [0]),
        (3, 2, [1, 0]),
        (0, 5, [0, 3, 1, 4, 2]),  # 0.618·5 is about 3
        (0, 8, [0, 5, 2, 7, 4, 1, 6, 3]),
        (1, 10, [1, 8, 5, 2, 9, 6, 3, 0, 7, 4]),  # 6 shares a factor with 10, 7 does not
        (12, 5, [2, 0, 3, 1, 4]),
    ],
)
def test_photos_are_taken_in_strides_of_the_golden_section(step, photos, wanted) -> None:
    assert order(step, photos) == wanted


def test_turns_by_hand() -> None:
    assert [turn(step, 1) for step in range(4)] == [Turn(0, 0), Turn(0, None), Turn(0, 1), Turn(0, None)]
    assert [turn(step, 3) for step in (0, 2, 3, 5, 6, 9)] == [
        Turn(0, 0), Turn(2, 0), Turn(0, None), Turn(2, None), Turn(0, 1), Turn(0, None)
    ]  # fmt: skip


def test_copies_are_stepped_on_from_96_by_96_pixels_and_take_two_thirds_of_the_steps() -> None:
    limits = {1: 0, 2: 1, 3: 2, 4: 2, 5: 3, 6: 3, 100: 3}
    assert {limit: steps_below(96 * 96, 3, limit) for limit in limits} == limits
    assert steps_below(96 * 96 - 1, 3, 100) == steps_below(96 * 96, 2, 100) == 0


def test_values_stay_within_what_is_documented() -> None:
    """Half to twice the depth, an eighth to seven times the size, any opacity, and colours from −0.6 to 2.8."""
    depth, size, logit, *colours = LIMITS
    np.testing.assert_allclose(np.exp(depth), [0.5, 2], rtol=0.02)
    np.testing.assert_allclose(np.exp(size), [1 / 7.4, 7.4], rtol=0.01)
    assert 1 / (1 + np.exp(-logit[0])) < 1e-9 and 1 - 1e-5 < 1 / (1 + np.exp(-logit[1])) < 1
    assert len(set(colours)) == 1 and len(LIMITS) == 6
    np.testing.assert_allclose(0.5 + C0 * np.array(colours[0]), [-0.6, 2.8], atol=0.05)


def test_two_photos_have_settings_of_their_own() -> None:
    assert settings_for(2) is FOR_TWO and settings_for(3) == settings_for(64) == Settings()
    large = Settings(log_depth=1, log_size=2, logit=3, sh=4, half_after=5)
    assert large.step_sizes(0) == (1, 2, 3, 4, 4, 4) and large.step_sizes(5) == (0.5, 1, 1.5, 2, 2, 2)
    assert large.step_sizes(10) == pytest.approx([0.2, 0.4, 0.6, 0.8, 0.8, 0.8])  # the square of the steps
    assert FOR_TWO.step_sizes(3) == FOR_TWO.step_sizes(0)
    for settings in (Settings(), FOR_TWO):  # Adam's, and steps that are small against what they change
        assert 0 < settings.momentum < settings.memory < 1 and 0 < settings.noise < 0.1
        assert (
            0 <= min(settings.step_sizes(0)) <= max(settings.step_sizes(0)) <= 0.2
            and settings.look_every >= 1 <= settings.patience
        )
        assert 0 <= settings.hidden < 0.1 and 0 < settings.price < 0.1 and 0 < settings.least_gain < 0.1
        assert 0 < settings.exposure < 0.01 and 0 < settings.variation < 1
    assert FOR_TWO.log_depth == FOR_TWO.hidden == 0  # two photos say nothing more about depth
    assert FOR_TWO.most_steps == 4 < STEPS < Settings().most_steps == MAX_STEPS


def test_settings_are_those_that_the_laboratory_kept() -> None:
    """docs/lab/refine.md, "kept"."""
    many = Settings()
    assert (many.logit, many.log_size, many.momentum, many.noise, many.price) == (0.2, 0.1, 0.8, 2e-3, 0.005)
    assert (many.hidden, many.together, FOR_TWO.logit, FOR_TWO.sh, FOR_TWO.together) == (0.03, 1, 0.05, 4e-3, 2)
    assert many.look_every == FOR_TWO.look_every == 2 and (many.patience, FOR_TWO.patience) == (3, 1)
    assert (many.half_after, FOR_TWO.half_after) == (8, math.inf)


def test_budgets_are_accepted_to_their_ends() -> None:
    assert [_limit(steps, None) for steps in (1, 10_000, np.int64(7), None)] == [1, 10_000, 7, STEPS]
    assert [_limit(None, seconds) for seconds in (1e-9, 86_399.9)] == [10_000] * 2
    for steps in (0, 10_001, True, 2.0):
        with pytest.raises(InputError, match=f"steps: {steps!r}, expected a whole number from 1 to 10000"):
            _limit(steps, None)
    for seconds in (0.0, 86_400.0, float("nan")):
        with pytest.raises(InputError, match=f"seconds: {seconds:g} s, expected more than 0 and less than a day"):
            _limit(None, seconds)
    with pytest.raises(InputError, match="contradicts"):
        _limit(1, 1.0)


def test_what_was_done_is_said_in_a_line() -> None:
    done = RefineStats(5, 4, [(0, 20.111), (2, 21.222), (4, 22.333), (5, 21.9)], 25.123, 26.987)
    assert (
        done.text
        == "refined in 4 steps: photos 25.12 to 26.99 dB, from the Gaussians of the other photos 20.11 to 22.33"
    )
    nothing = RefineStats(5, 0, [(0, 20.1)], 25.1, reason="no reason")
    assert nothing.text == "refinement leaves the Gaussians as they are: no reason"
    fresh = RefineStats()
    assert (fresh.steps, fresh.kept, fresh.looks) == (0, 0, []) and np.isnan([fresh.before, fresh.after]).all()
