"""Paper's plan and the encoder's checks by hand, what libavcodec is told, and which views are read and kept."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tinysplat_runtime.codec import parts
from tinysplat_runtime.codec.encoder import map_channel
from tinysplat_runtime.codec.hevc import PictureDecoder, PlaneDecoder, encode_plane
from tinysplat_runtime.codec.paper import paper_plan
from tinysplat_runtime.codec.profiles import PAPER, EncoderSettings
from tinysplat_runtime.errors import FormatError, NumericError
from tinysplat_runtime.gaussian.planes import CODING_ORDER, Channel, PlaneClass


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


# ---- the encoder ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("values", [[-2e15, 0], [0, 2e15], [0, np.inf]])
def test_values_beyond_1e15_are_refused_by_their_channel_s_name(values: list[float]) -> None:
    planes = np.array(values, np.float32).reshape(1, 1, 2)
    with pytest.raises(NumericError, match=r"^scale2: values from .* to .*, at most 1e\+15 can be coded"):
        map_channel(Channel(PlaneClass.SCALE, 2, planes, 1.0, (min(values), max(values))))


# ---- pictures -------------------------------------------------------------------------------------------------------


CODES = np.full((16, 24), 2000, np.uint16)


@pytest.mark.parametrize(
    ("payload", "words"),
    [(b"\x28\x01", "not a single HEVC intra slice"), (b"\x02\x01\x00", "not a single HEVC intra slice"),
     (b"\x28\x01\x00\x00\x01", "not a single HEVC intra slice")],
)  # fmt: skip
def test_what_is_no_slice_is_said(payload: bytes, words: str) -> None:
    decoder = PictureDecoder(encode_plane(CODES, 20, EncoderSettings("ultrafast")).parameter_sets, 16, 24, "gray12le")
    with pytest.raises(FormatError) as error:
        decoder.decode(payload)
    assert str(error.value) == f"plane: {words}"


def test_pictures_of_another_size_or_format_are_said() -> None:
    coded = encode_plane(CODES, 20, EncoderSettings("ultrafast"))
    for expected, words in (
        ((24, 16, "gray12le"), "24x16 gray12le, expected 16x24 gray12le"),
        ((16, 24, "gray10le"), "24x16 gray12le, expected 24x16 gray10le"),
    ):
        with pytest.raises(FormatError) as error:
            PictureDecoder(coded.parameter_sets, *expected).decode(coded.payload)
        assert str(error.value) == f"plane: picture is {words}"
    out = np.zeros((16, 24), np.uint16)
    PlaneDecoder(coded.parameter_sets, 16, 24).decode_into(coded.payload, out)
    assert np.abs(out.astype(int) - 2000).max() <= 16 * 2 ** ((20 - 4) / 6) / 2  # half a step


# ---- files in parts -------------------------------------------------------------------------------------------------


def test_files_that_were_opened_are_closed_and_those_given_are_not(tmp_path) -> None:
    (tmp_path / "f").write_bytes(bytes(range(10)))
    own = parts.ranges_of(tmp_path / "f")
    assert own.read([(2, 3), (8, 5)]) == [b"\2\3\4", b"\x08\x09"]
    own.close()
    with pytest.raises(ValueError):
        own.read([(0, 1)])
    with (tmp_path / "f").open("rb") as file:
        given = parts.ranges_of(file)
        given.close()
        assert given.read([(9, 1)]) == [b"\x09"]
