"""Searches for a size and a fidelity, on curves that a formula draws."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import refusing

from tinysplat_runtime.codec.profiles import PROFILES, Profile
from tinysplat_runtime.codec.search import PSNR_TOLERANCE, SIZE_TOLERANCE, Coder, code_to_psnr, code_to_size
from tinysplat_runtime.errors import InputError

LIMIT, LARGEST = 60.0, 1 << 18


@dataclass
class Curve(Coder):
    """Files of as many bytes as a curve has at Q_g, which they begin with; `start` is where it says to look first."""

    size: Callable[[float], float]
    start: float = 0.0
    second: Coder | None = None
    profile: Profile = PROFILES["balanced"]
    asked: list[float] = field(default_factory=list)

    def code(self, qp: float) -> bytes:
        assert -LIMIT <= qp <= LIMIT
        self.asked.append(qp)
        return repr(qp).encode().ljust(min(round(self.size(qp)), LARGEST), b" ")

    def expect(self, size: float) -> tuple[float, float]:
        return self.start, super().expect(size)[1]

    def other(self, qp: float) -> Coder | None:
        return self.second


def octaves(middle: float, slope: float, bend: float) -> Callable[[float], float]:
    """Sizes that fall by `slope` octaves of 40,000 bytes by Q_g, faster or more slowly away from `middle`."""
    return lambda qp: 4_000 * 2 ** -(slope * (qp - middle) + bend * math.tanh((qp - middle) / 8))


def quality(data: bytes) -> float:
    """40 dB at Q_g = 0, 0.95 less by each."""
    return 40 - 0.95 * float(data)


SIZES = st.builds(octaves, st.floats(-20, 20), st.floats(0.06, 0.18), st.floats(0, 0.5))


@given(size=SIZES, share=st.floats(0.1, 8), start=st.floats(-30, 30))
def test_the_largest_file_within_a_size_is_found_soon(size, share, start):
    target, coder = int(4_000 * share), Curve(size, start)
    data = code_to_size(coder, target)
    assert (1 - SIZE_TOLERANCE) * target <= len(data) + 1 <= target + 1
    assert len(coder.asked) <= 12
    assert len(data) == max(len(Curve(size).code(qp)) for qp in coder.asked if len(Curve(size).code(qp)) <= target)


@given(fall=st.floats(0.5, 1.9), at=st.floats(-40, 40), wanted=st.floats(20, 60))
def test_the_fidelity_is_reached_and_hardly_passed(fall, at, wanted):
    coder = Curve(octaves(0, 0.1, 0))
    asked = []

    def measure(data: bytes) -> float:
        asked.append(min(max(40 - fall * (float(data) - at), 0), 100))
        return asked[-1]

    if not -LIMIT < at + (40 - wanted - PSNR_TOLERANCE) / fall < at + (40 - wanted) / fall < LIMIT:
        return  # beyond the ends of Q_g
    data = code_to_psnr(coder, wanted, measure)
    assert wanted <= measure(data) <= wanted + PSNR_TOLERANCE
    assert len(coder.asked) <= 8


def test_curves_that_jump_give_the_nearest_file_on_the_right_side():
    coder = Curve(lambda qp: 1000 if qp > 3 else 5000)
    assert len(code_to_size(coder, 4000)) == 1000
    data = code_to_psnr(Curve(octaves(0, 0.1, 0)), 30.0, lambda data: 50.0 if float(data) < 3 else 20.0)
    assert 0 < float(data) < 3


@dataclass
class Settling(Curve):
    """What is settled at Q_g has a curve of its own, of steps alone, through the point that this one has there."""

    near: tuple[float, float] = (0.3, 0.05)
    steps: float = 0.05

    def settled(self, qp: float) -> Curve:
        self.asked.append(qp)
        return Curve(lambda at: self.size(qp) * 2 ** (self.steps * (qp - at)))


@given(fall=st.floats(0.1, 0.2), share=st.floats(0.2, 5), start=st.floats(-10, 10), steps=st.floats(0.04, 0.08))
def test_what_takes_long_is_settled_few_times_on_the_way_to_a_size(fall, share, start, steps):
    target = int(4_000 * share)
    coder = Settling(octaves(0, fall, 0), start, steps=steps)
    data = code_to_size(coder, target)
    assert (1 - SIZE_TOLERANCE) * target <= len(data) + 1 <= target + 1
    assert len(coder.asked) <= 4


@given(wanted=st.floats(20, 60), given_back=st.floats(0, 2))
def test_a_fidelity_is_reached_that_steps_do_not_give_back(wanted, given_back):
    class Losing(Settling):
        def settled(self, qp: float) -> Curve:
            settled = Curve(self.size)
            settled.code = lambda at: repr(40 - 0.7 * qp - 0.3 * max(at, qp - given_back)).encode()
            return settled

    assert float(code_to_psnr(Losing(octaves(0, 0.1, 0)), wanted, float)) >= wanted


@pytest.mark.parametrize("better", [True, False])
def test_another_coder_is_taken_where_its_file_is_smaller(better):
    one, two = Curve(octaves(0, 0.1, 0)), Curve(octaves(-1 if better else 1, 0.1, 0))
    one.second = two
    data = code_to_psnr(one, 38.0, quality)
    assert quality(data) >= 38 and two.asked
    assert data == min(
        (coder.code(qp) for coder in (one, two) for qp in [*coder.asked] if 40 - 0.95 * qp >= 38), key=len
    )


def test_what_no_file_reaches_is_refused_with_the_nearest():
    with refusing(InputError, "target_size: 100 500"):
        code_to_size(Curve(lambda qp: 500 + 1000 * 2 ** (-qp)), 100)
    with refusing(InputError, "target_psnr: 99 97"):
        code_to_psnr(Curve(octaves(0, 0.1, 0)), 99, lambda data: 40 - 0.95 * float(data))
    assert len(code_to_size(Curve(lambda qp: 900.0), 5000)) == 900
