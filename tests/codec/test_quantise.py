"""The mapping from wanted steps to 12-bit codes and QPs."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tinysplat_runtime.codec.quantise import (
    MAX_MAPPED_QP,
    OUTLIER_RATIO,
    OUTLIER_SHARE,
    choose_code_map,
    without_outliers,
)
from tinysplat_runtime.gaussian.planes import MAX_CODE, hevc_step

STEPS_WITH_A_QP = st.floats(np.log10(0.0025), np.log10(0.039)).map(lambda exponent: 10**exponent)
"""Steps, as shares of the range, whose QP lies between 0 and the highest: what planes are coded at."""


@given(
    low=st.floats(-1e6, 1e6),
    span=st.floats(1e-6, 1e6),
    share=st.floats(0, 1),
    relative_step=st.one_of(st.floats(1e-6, 1e3), STEPS_WITH_A_QP),
)
def test_codes_never_overflow_and_steps_are_as_wanted_unless_12_bits_are_too_few(low, span, share, relative_step):
    high = low + span
    span = high - low
    if not span > 1e-5 * abs(low):
        return  # float32 planes cannot hold such a range
    step = relative_step * span
    code_map = choose_code_map(low, high, low + share * span, step)
    assert 0 <= code_map.qp <= MAX_MAPPED_QP
    ends = (np.array([low, high]) - code_map.offset) / code_map.scale
    slack = 2 + 1e-6 * abs(code_map.offset) / code_map.scale  # offset and scale are rounded to float32
    assert ends.min() >= -slack and ends.max() <= MAX_CODE + slack
    finest = hevc_step(0) * span / MAX_CODE
    assert code_map.step == pytest.approx(max(step, finest), rel=1e-5)
    values = np.linspace(low + 0.05 * span, high - 0.05 * span, 50, dtype=np.float32)
    codes, clipped = code_map.quantise(values)
    rounding = 5e-7 * max(abs(low), abs(high))
    assert clipped == 0 and np.abs(code_map.dequantise(codes) - values).max() <= 0.51 * code_map.scale + rounding


@given(
    count=st.integers(1, 5000),
    strays=st.lists(st.floats(-300, 300), max_size=4),
    spread=st.floats(0.1, 30),
    step=st.sampled_from([1.0, 1e-4, 1e4]),
)
def test_strays_are_cut_where_four_times_finer_codes_are_the_gain(count, strays, spread, step):
    """`spread` and strays in ranges of 12 bits at the step."""
    reach = step * MAX_CODE / hevc_step(0)
    values = reach * np.concatenate([np.linspace(0, spread, count), strays])
    low, high = float(values.min()), float(values.max())
    kept = without_outliers(values, low, high, step)
    few, ordered = max(1, int(len(values) * OUTLIER_SHARE / 2)), np.sort(values)
    assert low <= kept[0] < kept[1] <= high or kept == (low, high)
    assert np.count_nonzero(values < kept[0]) <= few and np.count_nonzero(values > kept[1]) <= few
    inner = float(ordered[-1 - few] - ordered[few]) if len(values) > 2 * few + 1 else high - low
    if kept != (low, high):
        assert OUTLIER_RATIO * max(kept[1] - kept[0], reach) < high - low and inner < kept[1] - kept[0]
    else:
        assert high - low <= OUTLIER_RATIO * 2 * max(inner, reach)
