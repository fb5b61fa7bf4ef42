"""Paper's plan and the encoder's checks by hand, what libavcodec is told, and which views are read and kept."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.codec import encoder, hevc, one_colour, parts, recode
from tinysplat_runtime.codec.encoder import SceneEncoder, check_qp, check_readable, map_channel
from tinysplat_runtime.codec.hevc import PictureDecoder, PlaneDecoder, encode_picture, encode_plane, rectangles
from tinysplat_runtime.codec.paper import paper_plan
from tinysplat_runtime.codec.profiles import PAPER, PROFILES, EncoderSettings, find_profile
from tinysplat_runtime.codec.residual import check_prediction
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.errors import FormatError, InputError, NumericError, TinySplatError
from tinysplat_runtime.gaussian.planes import CODING_ORDER, Channel, PlaneClass
from tinysplat_runtime.graphs.inference import GraphStore


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


def test_windows_of_14_bits_are_cut_where_values_go_beyond() -> None:
    planes = planes_of(COUNTS)
    planes[PlaneClass.OPACITY][0, 0, 0, 0] = 1e6
    projected: Any = SimpleNamespace(planes=planes.__getitem__, geometry=np.ones((2, 11, 1, 1)))
    settings = encoder.replace(PAPER, alpha=dict.fromkeys(PAPER.alpha, 10_000))
    plan = paper_plan(projected, planes[PlaneClass.SCALE], None, 0, settings, 0)
    (opacity,) = (c for c in plan.channels if c.plane_class == PlaneClass.OPACITY)
    sigma = planes[PlaneClass.OPACITY].std(dtype=np.float64)
    assert opacity.window[1] == pytest.approx(opacity.window[0] + 16383 * sigma / 10_000)


# ---- the encoder ----------------------------------------------------------------------------------------------------


def test_q_g_reaches_from_minus_60_to_60() -> None:
    check_qp(60), check_qp(-60.0)
    for qp in (60.001, -61, float("nan")):
        with pytest.raises(InputError) as error:
            check_qp(qp)
        assert str(error.value) == f"qp: {qp:g}, accepted are -60 to 60"


def test_what_has_no_pixels_or_too_many_views_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    g = make_smooth_gaussians(2, 4, 4, degree=0)
    with pytest.raises(InputError, match=r"^gaussians: belong to no pixels; expected \(V, H, W, …\)"):
        SceneEncoder(g.flat(), PROFILES["fast"], GraphStore(), threads=1)
    monkeypatch.setattr(encoder, "MAX_VIEWS", 1)
    with pytest.raises(InputError, match=r"^cameras: 2 views, accepted are 1 to 1$"):
        SceneEncoder(g, PROFILES["fast"], GraphStore(), threads=1)


def test_files_that_no_reader_takes_are_not_handed_out() -> None:
    data = ts.compress(make_smooth_gaussians(1, 8, 8, degree=0))
    check_readable(data)
    with pytest.raises(NumericError, match="beyond what a file can hold: "):
        check_readable(data[:-1])


@pytest.mark.parametrize("values", [[-2e15, 0], [0, 2e15], [0, np.inf]])
def test_values_beyond_1e15_are_refused_by_their_channel_s_name(values: list[float]) -> None:
    planes = np.array(values, np.float32).reshape(1, 1, 2)
    with pytest.raises(NumericError, match=r"^scale2: values from .* to .*, at most 1e\+15 can be coded"):
        map_channel(Channel(PlaneClass.SCALE, 2, planes, 1.0, (min(values), max(values))))


def test_profiles_are_found_by_name() -> None:
    assert find_profile("max").name == "max"
    with pytest.raises(InputError) as error:
        find_profile("best")
    assert str(error.value) == "profile: 'best', accepted are paper, fast, balanced, max"


def test_a_prediction_has_the_layer_s_grid() -> None:
    layer: Any = SimpleNamespace(cameras=[1, 2], height=3, width=4)

    def check(*shape: int) -> None:
        found: Any = SimpleNamespace(opacities=np.zeros(shape))
        check_prediction(layer, found, 1)

    check(2, 3, 4)
    for shape in ((1, 3, 4), (2, 4, 4), (2, 3, 5)):
        with pytest.raises(FormatError) as error:
            check(*shape)
        assert str(error.value) == f"layer 1: 4x3, but the network gives {shape[2]}x{shape[1]} for it"


# ---- pictures -------------------------------------------------------------------------------------------------------


def test_rectangles_are_runs_continued_downwards() -> None:
    offsets = np.array([[1, 1, 0, 2], [1, 1, 0, 2], [1, 3, 3, 2], [0, 0, 0, 0]])
    found = [(r.start, r.stop, c.start, c.stop, value) for r, c, value in rectangles(offsets)]
    assert sorted(found) == [(0, 2, 0, 2, 1), (0, 3, 3, 4, 2), (2, 3, 0, 1, 1), (2, 3, 1, 3, 3)]
    assert rectangles(np.zeros((3, 3), int)) == []


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


def test_more_slices_than_one_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hevc, "_IDR_TYPES", (32, 33))
    with pytest.raises(TinySplatError, match="libx265 gave 2 slices for one picture, expected 1"):
        encode_picture([CODES], "gray12le", 20, EncoderSettings("ultrafast"))


def test_room_is_asked_for_every_picture_under_way(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    monkeypatch.setattr(hevc, "np", SimpleNamespace(empty=lambda size, kind: asked.append(size), uint8=np.uint8))
    with hevc._room_for(100):
        with hevc._room_for(7):
            pass
        with pytest.raises(ValueError), hevc._room_for(9):
            raise ValueError
    assert hevc._under_way == []
    one = 150_000_000
    assert asked == [one + 3200, 2 * one + 32 * 107, 2 * one + 32 * 109]


# ---- files in parts -------------------------------------------------------------------------------------------------


def test_depths_are_those_in_front_of_the_own_camera() -> None:
    g = make_smooth_gaussians(2, 6, 8, degree=0, origin=(50, 0, 0))
    pairs = zip(g.cameras, g.means.astype(np.float64) + g.origin, strict=True)
    z = np.stack([(means - camera.centre) @ camera.c2w[:3, 2] for camera, means in pairs])
    assert parts._depths(g) == pytest.approx((z.min(), z.max()), rel=1e-5)
    behind = encoder.replace(g, means=g.means - 100 * g.cameras[0].c2w[:3, 2].astype(np.float32))
    assert parts._depths(behind) == (1.0, 1.0)
    g.means[0, 0, 0] -= 100 * g.cameras[0].c2w[:3, 2].astype(np.float32)  # one behind does not count
    assert parts._depths(g) == pytest.approx((np.delete(z.ravel(), 0).min(), z.max()), rel=1e-5)


def test_bytes_of_gaussians_are_those_of_their_arrays() -> None:
    """44 of geometry and 12 of each function of SH a Gaussian; of a second layer too."""
    assert parts._bytes_of(make_smooth_gaussians(2, 6, 8, degree=1)) == 96 * (44 + 48)
    assert parts._bytes_of(make_smooth_gaussians(1, 8, 8, degree=0, layers=2)) == (64 + 9) * (44 + 12)


@pytest.mark.parametrize("source", [3, None, [b"bytes"]])
def test_sources_are_paths_addresses_or_open_files(source: Any) -> None:
    with pytest.raises(InputError) as error:
        parts.ranges_of(source)
    assert str(error.value) == f"source: {type(source).__name__}, expected a path, an address or an open binary file"


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


def test_addresses_that_nothing_reaches_are_refused() -> None:
    with pytest.raises(InputError, match=r"^nowhere://a: "):
        parts.ranges_of("nowhere://a")


def test_files_whose_codes_are_worth_next_to_nothing_are_no_model(monkeypatch: pytest.MonkeyPatch) -> None:
    g = make_smooth_gaussians(1, 8, 8, degree=0)
    container = read_container(ts.compress(g))
    (layer,) = container.body.layers
    number = next(n for n, c in enumerate(layer.channels) if c.streams)
    for scale, is_fine in ((1.1e-30, True), (1e-30, False)):
        channels = list(layer.channels)
        channels[number] = encoder.replace(channels[number], scale=scale)
        body = encoder.replace(container.body, layers=(encoder.replace(layer, channels=tuple(channels)),))
        changed = encoder.replace(container, body=body)
        if is_fine:
            assert recode._checked(g, changed)[1].name == "balanced"
        else:
            with pytest.raises(InputError) as error:
                recode._checked(g, changed)
            name = channels[number].name
            said = f"like: plane {name} of layer 0 has 1e-30 units per code, expected more than 1e-30"
            assert str(error.value) == said


def test_colours_beyond_float32_stay_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    g = make_smooth_gaussians(2, 8, 8, degree=1)
    monkeypatch.setattr(one_colour, "disagreement", lambda layer: 0.0)
    assert one_colour.as_seen(g, 0.0).degree == 0
    g.sh[1, 2, 3, 0, 1] = np.inf
    assert one_colour.as_seen(g, 0.0) is None
