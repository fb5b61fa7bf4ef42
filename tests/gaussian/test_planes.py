"""What a plane class is, and the sizes, steps and blocks that follow from HEVC."""

from __future__ import annotations

import numpy as np
import pytest

from tinysplat_runtime.gaussian.planes import (
    BACK_TO_FRONT,
    BIT_DEPTH,
    CODING_ORDER,
    GEOMETRY,
    GEOMETRY_CHANNELS,
    MAX_CODE,
    MAX_QP,
    PASSES,
    Channel,
    LayerPlan,
    PlaneClass,
    Reduction,
    hevc_step,
    padded_size,
    qp_block_side,
)

FACTS = {
    "depth": (0, b"DEPT", (0, 1), 1, (0, 2), 1e30, 2048, -4),
    "color": (1, b"COLO", None, 3, (0, 3), 1e30, 1024, 3),
    "opacity": (2, b"OPAC", (10, 11), 1, (1, 1), 1e30, 256, 0),
    "scale": (3, b"SCAL", (3, 6), 3, (1, 1), 1e30, 256, 0),
    "rotation": (4, b"ROTA", (6, 10), 4, (2, 2), 1e15, 256, 9),
    "offset": (5, b"OFFS", (1, 3), 2, (2, 2), 1e30, 256, 12),
}
"""Number, section, channels, base, passes and bound of docs/FORMAT.md, then α and Q_c of arXiv 2506.09479."""


def test_classes_are_what_the_format_and_the_paper_say() -> None:
    for label, wanted in FACTS.items():
        plane_class = PlaneClass[label.upper()]
        facts = plane_class.facts
        assert plane_class.label == label
        assert (plane_class.value, facts.section, facts.geometry, facts.base, facts.passes, facts.largest, facts.alpha,
                facts.class_qp) == wanted  # fmt: skip
    assert [int(c) for c in CODING_ORDER] == [0, 1, 2, 3, 4, 5] and PASSES == (0, 1, 2, 3)
    assert PlaneClass.OPACITY.facts.passes[0] == BACK_TO_FRONT == PlaneClass.SCALE.facts.passes[0]
    assert GEOMETRY_CHANNELS == 11 and PlaneClass.COLOR not in GEOMETRY
    assert sorted(n for channels in GEOMETRY.values() for n in range(channels.start, channels.stop)) == list(range(11))


def test_pictures_depend_most_on_colours_and_least_on_rotations() -> None:
    order = (PlaneClass.COLOR, PlaneClass.OPACITY, PlaneClass.OFFSET, PlaneClass.SCALE, PlaneClass.ROTATION)
    found = [c.facts.sensitivity for c in order]
    assert None not in found and found == sorted(found, reverse=True)  # type: ignore[type-var]
    assert 0 < found[-1] < found[0] < 0.1  # type: ignore[operator]
    assert PlaneClass.DEPTH.facts.sensitivity is None
    assert all(0 < c.facts.flat < 1e-3 for c in PlaneClass)


@pytest.mark.parametrize(("qp", "step"), [(4, 16), (10, 32), (-2, 8), (7, 16 * 2**0.5), (51, 16 * 2 ** (47 / 6))])
def test_a_step_of_12_bits_is_16_codes_at_qp_4_and_doubles_every_6(qp: float, step: float) -> None:
    assert hevc_step(qp) == pytest.approx(step)
    assert (BIT_DEPTH, MAX_CODE, MAX_QP) == (12, 4095, 51)


@pytest.mark.parametrize(
    ("size", "side"),
    [((1, 1), 16), ((512, 512), 16), ((513, 512), 32), ((512, 513), 32), ((16, 16384), 16), ((16, 16385), 32),
     ((1024, 1024), 32), ((1025, 1024), 64), ((4096, 4096), 128), ((16, 1 << 16), 64)],
)  # fmt: skip
def test_a_plane_has_at_most_1024_blocks_of_the_least_side_that_allows_it(size: tuple[int, int], side: int) -> None:
    assert qp_block_side(*size) == side


@pytest.mark.parametrize(
    ("size", "padded"), [((1, 1), (16, 16)), ((16, 17), (16, 24)), ((17, 33), (24, 40)), ((24, 8), (24, 16))]
)
def test_planes_are_coded_at_multiples_of_8_and_16_at_least(size: tuple[int, int], padded: tuple[int, int]) -> None:
    assert padded_size(*size) == padded


def test_channels_and_plans_tell_of_themselves() -> None:
    channel = Channel(PlaneClass.SCALE, 2, np.zeros((1, 2, 3), np.float32), 0.5, (0.0, 1.0))
    assert channel.name == "scale2" and channel.offsets is None and 0 < channel.flat_share < 1
    assert Reduction(np.zeros((9, 4), np.float16), np.zeros((9, 4)), 0.1, 2.0).k == 4
    plan = LayerPlan((channel,), 1, (1.0, 2.0))
    assert not plan.inverse_depth and plan.refine_depth is None and plan.reduction is None
