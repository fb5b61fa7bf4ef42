"""Planes as the paper, HEVC and docs/FORMAT.md have them: sizes, steps, channels."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tinysplat_runtime.gaussian.planes import PLANE_CLASSES, hevc_step, padded_size

SIDE = st.integers(1, 70) | st.integers(1, 5000)


@given(SIDE, SIDE)
def test_planes_are_coded_at_the_next_multiple_of_8_from_16_on(height: int, width: int) -> None:
    for side, padded in zip((height, width), padded_size(height, width), strict=True):
        assert padded % 8 == 0 and max(16, side) <= padded < max(17, side + 8)


def test_a_step_is_one_code_of_8_bits_at_qp_4_and_doubles_every_six() -> None:
    assert hevc_step(4) == 2 ** (12 - 8)
    assert [hevc_step(qp + 6) / hevc_step(qp) for qp in (-4, 0, 22.5, 45)] == pytest.approx([2] * 4)


def test_alpha_and_qp_of_classes_are_those_of_the_papers_table() -> None:
    found = {one.label: (facts.alpha, facts.class_qp) for one, facts in PLANE_CLASSES.items()}
    assert found.pop("depth") == (2048, -4) and found.pop("color") == (1024, 3)
    assert found == {"opacity": (256, 0), "scale": (256, 0), "rotation": (256, 9), "offset": (256, 12)}
