"""Paper's plan and the encoder's checks by hand, what libavcodec is told, and which views are read and kept."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tinysplat_runtime.codec.paper import paper_plan
from tinysplat_runtime.codec.profiles import PAPER
from tinysplat_runtime.codec.ranges import ranges_of
from tinysplat_runtime.gaussian.planes import CODING_ORDER, PlaneClass


def planes_of(counts: dict[PlaneClass, int]) -> dict[PlaneClass, np.ndarray]:
    rng = np.random.default_rng(0)
    return {c: rng.normal(3, 1 + n, (2, n, 16, 20)).astype(np.float32) for c, n in counts.items()}


COUNTS = {PlaneClass.DEPTH: 1, PlaneClass.OPACITY: 1, PlaneClass.SCALE: 3, PlaneClass.ROTATION: 4, PlaneClass.OFFSET: 2}


@pytest.mark.parametrize("is_reduced", [True, False])
def test_paper_s_steps_are_sigma_over_alpha_at_the_class_s_qp(is_reduced: bool) -> None:
    planes = planes_of(COUNTS)
    geometry = np.zeros((2, 11, 16, 20), np.float32)
    geometry[:, 0] = planes[PlaneClass.DEPTH][:, 0]
    projected: Any = SimpleNamespace(planes=planes.__getitem__, geometry=geometry)
    colors = (
        np.random.default_rng(1).normal(size=(2, 3, 16, 20)).astype(np.float32) * np.float32([1, 4, 2])[:, None, None]
    )
    plan = paper_plan(projected, colors, "maps" if is_reduced else None, 2, PAPER, 5.0)  # type: ignore[arg-type]
    assert [c.plane_class for c in plan.channels] == [
        c for c in CODING_ORDER for _ in range(3 if c == PlaneClass.COLOR else COUNTS[c])
    ]
    for channel in plan.channels:
        is_color = channel.plane_class == PlaneClass.COLOR
        values = (colors if is_color else planes[channel.plane_class])[:, channel.target]
        sigma = float(values.std(dtype=np.float64))
        if is_color:
            sigma = float(colors.std(axis=(0, 2, 3), dtype=np.float64)[0 if is_reduced else 1])
        integer = sigma / PAPER.alpha[channel.plane_class]
        assert channel.step == pytest.approx(integer * 64 * 2 ** ((PAPER.class_qp[channel.plane_class] + 5 - 4) / 6))
        low, high = float(values.min()), float(values.max())
        assert channel.window == pytest.approx((low, min(high, low + 16383 * integer)))
    depth = planes[PlaneClass.DEPTH]
    assert plan.depth_limits == (float(depth.min()), float(depth.max())) and plan.degree == 2
    assert plan.reduction == ("maps" if is_reduced else None)


# ---- files in parts -------------------------------------------------------------------------------------------------


def test_files_that_were_opened_are_closed_and_those_given_are_not(tmp_path) -> None:
    (tmp_path / "f").write_bytes(bytes(range(10)))
    own = ranges_of(tmp_path / "f")
    assert own.read([(2, 3), (8, 5)]) == [b"\2\3\4", b"\x08\x09"]
    own.close()
    with pytest.raises(ValueError):
        own.read([(0, 1)])
    with (tmp_path / "f").open("rb") as file:
        given = ranges_of(file)
        given.close()
        assert given.read([(9, 1)]) == [b"\x09"]
