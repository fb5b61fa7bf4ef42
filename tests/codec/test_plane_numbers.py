"""Numbers that codes, steps and pictures of photos come to, by hand or by an independent computation."""

from __future__ import annotations

import math
import zlib
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.codec import exact, photos, rate
from tinysplat_runtime.codec.adaptive import (
    _fineness,
    _turn_to_principal,
    class_step,
    known_steps,
    with_enough_depth_pictures,
)
from tinysplat_runtime.codec.base import add_colours, as_codes, fitted_sh
from tinysplat_runtime.codec.depth_step.blocks import dct
from tinysplat_runtime.codec.encoder import SceneEncoder
from tinysplat_runtime.codec.profiles import ADAPTIVE, PROFILES
from tinysplat_runtime.codec.quantise import CodeMap, choose_code_map, mean_and_spread
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.errors import FormatError, InputError
from tinysplat_runtime.gaussian.planes import Channel, PlaneClass
from tinysplat_runtime.graphs.inference import GraphStore

# ---- codes ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("low", "high", "mean", "step", "scale", "offset", "qp"),
    [
        (0.0, 4095.0, 2048.0, 16.0, 1.0, 0.0, 4),  # a code a unit: the step of QP 4 is 16
        (0.0, 4095.0, 2048.0, 15.999, 15.999 / (16 * 2 ** (-1 / 6)), None, 3),
        (0.0, 4095.0, 2048.0, 1.0, 1.0, 0.0, 0),  # finer than 12 bits have
        (-1.0, 1.0, 0.5, 1000.0, 1000 / (16 * 2 ** (20 / 6)), None, 24),  # coarser than the highest QP
        (0.0, 1.0, 0.0, 16 * 1.42 / 4095, 1.42 / 4095 / 2 ** (3 / 6), None, 7),
    ],
)  # fmt: skip
def test_code_maps_by_hand(low, high, mean, step, scale, offset, qp) -> None:
    found = choose_code_map(low, high, mean, step)
    assert found.qp == qp and found.scale == pytest.approx(scale, rel=1e-6)
    expected = max(min(mean - 2048 * found.scale, low), high - 4095 * found.scale) if offset is None else offset
    assert found.offset == pytest.approx(expected, rel=1e-5, abs=1e-5)
    assert found.step == pytest.approx(16 * 2 ** ((qp - 4) / 6) * found.scale)


def test_values_are_rounded_and_clipped_to_12_bits() -> None:
    codes, clipped = CodeMap(0.5, -1.0, 9).quantise(
        np.array([[-1.3, -1.25, -0.74, 0], [2046.5, 2046.74, 2046.8, 9e9]], np.float32)
    )
    assert codes.dtype == np.uint16 and codes.tolist() == [[0, 0, 1, 2], [4095, 4095, 4095, 4095]] and clipped == 3
    np.testing.assert_array_equal(CodeMap(0.5, -1.0, 9).dequantise(codes[0]), np.array([-1, -1, -0.5, 0], np.float32))


def test_mean_and_spread_are_those_of_all_views() -> None:
    values = np.random.default_rng(0).normal(3, 2, (3, 50, 700)).astype(np.float32)
    mean, spread = mean_and_spread(values)
    assert (mean, spread) == pytest.approx((values.mean(dtype=np.float64), values.std(dtype=np.float64)), rel=1e-12)


def test_planes_are_two_codes_of_16_bits_and_their_worth() -> None:
    numbers = np.random.default_rng(0).normal(size=(2, 3, 4, 5)) * np.array([1, 100, 0])[:, None, None]
    planes = numbers.astype(np.float32)
    codes, mix = as_codes(planes)
    assert codes.shape == (2, 6, 4, 5) and codes.dtype == np.uint16 and mix.shape == (3, 7)
    back = np.einsum("pc,vchw->vphw", mix[:, :-1], codes.astype(np.float64)) + mix[:, -1][:, None, None]
    span = np.ptp(planes, axis=(0, 2, 3))
    assert (np.abs(back - planes).max(axis=(0, 2, 3)) <= span * 2.0**-32 + 1e-30).all()
    assert codes[:, :2].max() == 65535 and (np.count_nonzero(mix[:, :-1], axis=1) == 2).all()


def test_coefficients_are_cut_or_filled_up_and_added() -> None:
    sh = np.arange(12.0, dtype=np.float32).reshape(1, 4, 3)
    assert fitted_sh(sh, (1, 1, 3)).tolist() == [[[0, 1, 2]]]
    wide = fitted_sh(sh, (1, 9, 3))
    assert wide.shape == (1, 9, 3) and (wide[:, :4] == sh).all() and not wide[:, 4:].any()
    np.testing.assert_array_equal(add_colours(wide, sh)[:, :4], 2 * sh)


# ---- lossless planes ------------------------------------------------------------------------------------------------


def naive_prediction(ordered: np.ndarray) -> np.ndarray:
    """Sample by sample as FORMAT has it: the median of left, above and left + above − corner."""
    height, width = ordered.shape
    plane = ordered.astype(int)
    out = np.zeros_like(plane)
    for r in range(height):
        for c in range(width):
            if r == 0:
                out[r, c] = plane[r, c - 1] if c else 0
            elif c == 0:
                out[r, c] = plane[r - 1, c]
            else:
                left, above, corner = plane[r, c - 1], plane[r - 1, c], plane[r - 1, c - 1]
                out[r, c] = sorted((left, above, left + above - corner))[1]
    return out


def test_a_plane_s_bytes_are_those_of_the_format() -> None:
    plane = np.random.default_rng(0).normal(size=(6, 7)).astype(np.float16)
    plane[0, 0], plane[2, 3], plane[3, 3] = -0.0, 65504, -65504
    bits = plane.view(np.uint16).astype(int)
    ordered = np.where(bits & 0x8000, 0xFFFF - bits, bits + 0x8000)
    rest = (ordered - naive_prediction(ordered) + 0x8000) % 0x10000 - 0x8000
    folded = np.where(rest < 0, -2 * rest - 1, 2 * rest).ravel()
    octets = bytes((folded & 255).astype(np.uint8)) + bytes((folded >> 8).astype(np.uint8))
    found = exact.pack(plane)
    assert zlib.decompress(found) == octets and found == zlib.compress(octets, 9)
    assert exact.unpack(found, (6, 7), "").tobytes() == plane.tobytes()
    for wrong in (zlib.compress(octets[:-1]), zlib.compress(octets + b"\0"), found + b"\0", found[:-1], b"x"):
        with pytest.raises(FormatError, match=r"^plane 3: (does not come to 84 bytes|zlib: )"):
            exact.unpack(wrong, (6, 7), "plane 3")


@pytest.mark.parametrize(("shape", "value"), [((1, 1), 3.0), ((1, 5), -2.0), ((5, 1), 0.5)])
def test_lines_and_points_are_planes(shape: tuple[int, int], value: float) -> None:
    plane = np.full(shape, value, np.float16)
    assert (exact.unpack(exact.pack(plane), shape, "") == plane).all()


def test_planes_hold_no_nan(monkeypatch: pytest.MonkeyPatch) -> None:
    layer = read_container(ts.compress(make_smooth_gaussians(1, 4, 4, degree=0), lossless=True)).body.layers[0]
    monkeypatch.setattr(exact, "unpack", lambda *_: np.full((4, 4), np.nan, np.float16))
    with pytest.raises(FormatError, match="SHA-256"):
        exact.decode_exact(layer, 1)
    monkeypatch.setattr(exact, "sha256", lambda data: SimpleNamespace(digest=lambda: layer.sha256))
    with pytest.raises(FormatError, match="exact planes: holds NaN or infinity"):
        exact.decode_exact(layer, 1)


# ---- photos ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("qp", "expected"), [(0, 20), (3.4, 23), (-3.6, 16), (-30, 0), (31, 51), (60, 51)])
def test_photos_have_a_qp_of_20_that_q_g_moves(qp: float, expected: int) -> None:
    assert photos.photo_qp(qp) == expected


@pytest.mark.parametrize(
    ("size", "coded"), [((16, 16), (16, 16)), ((17, 32), (32, 32)), ((1, 33), (16, 48)), ((48, 15), (48, 16))]
)
def test_photos_are_coded_in_multiples_of_16(size, coded) -> None:
    assert photos.coded_photo_size(*size) == coded


COLOURS = {
    (1, 1, 1): (1, 0, 0), (0, 0, 0): (0, 0, 0), (1, 0, 0): (0.2126, -0.2126 / 1.8556, 0.5),
    (0, 1, 0): (0.7152, -0.7152 / 1.8556, -0.7152 / 1.5748), (0, 0, 1): (0.0722, 0.5, -0.0722 / 1.5748),
}  # fmt: skip
"""Y, Cb and Cr by ITU-R BT.709."""


@pytest.mark.parametrize("rgb", COLOURS)
def test_photos_are_planes_of_bt_709_and_back(rgb: tuple[int, int, int]) -> None:
    planes = photos._planes(np.full((5, 7, 3), rgb, np.float32))
    assert [plane.shape for plane in planes] == [(16, 16), (8, 8), (8, 8)]
    y, cb, cr = COLOURS[rgb]
    for plane, value in zip(planes, (y * 1023, cb * 1023 + 512, cr * 1023 + 512), strict=True):
        assert plane.dtype == np.uint16 and (plane == min(max(round(value), 0), 1023)).all()
    image = photos._image(planes, 5, 7)
    assert image.shape == (5, 7, 3) and np.abs(image - rgb).max() < 2e-3


def test_chroma_is_the_mean_of_four_and_comes_back_by_three_quarters_and_one() -> None:
    image = np.full((16, 16, 3), 0.5, np.float32)
    image[4:6, 4:6, 2] = np.array([[0.1, 0.3], [0.5, 0.9]])
    blue = photos._planes(image)[1].astype(int)
    luma = 0.2126 * 0.5 + 0.7152 * 0.5 + 0.0722 * 0.45
    assert blue[2, 2] == round((0.45 - luma) / 1.8556 * 1023 + 512) and blue[2, 3] == blue[3, 2] == 512
    pair = photos._doubled(np.array([[4.0, 8], [0, 16]]), 1)
    assert pair.tolist() == [[4, 5, 7, 8], [0, 4, 12, 16]]
    assert photos._doubled(np.array([[4.0, 8], [0, 16]]), 0).tolist() == [[4, 8], [3, 10], [1, 14], [0, 16]]


def test_photos_are_padded_with_their_border() -> None:
    image = np.zeros((3, 2, 3), np.float32)
    image[2, 1] = 1
    luma = photos._planes(image)[0]
    assert (luma[2:, 1:] == 1023).all() and not luma[:2].any() and not luma[:, 0].any()


# ---- steps ----------------------------------------------------------------------------------------------------------


def test_steps_of_a_class_are_gain_over_the_root_of_its_sensitivity() -> None:
    for plane_class, sensitivity in ADAPTIVE.sensitivity.items():
        assert class_step(ADAPTIVE, plane_class) == pytest.approx(ADAPTIVE.gain / math.sqrt(sensitivity))
    mix = np.eye(3), np.full(3, 0.5)
    first, behind = (known_steps(mix, n, ADAPTIVE) for n in (0, 2))
    assert {c: step * 1.41 for c, step in first.items()} == pytest.approx(behind)
    assert PlaneClass.DEPTH not in first and PlaneClass.OPACITY not in first


def test_scales_are_turned_to_their_principal_axes() -> None:
    rng = np.random.default_rng(0)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    numbers = rng.normal(size=(2, 3, 20, 30)) * np.array([3, 1, 0.1])[:, None, None]
    scales = (np.einsum("pc,vchw->vphw", turn, numbers) + np.array([5, 6, 7])[:, None, None]).astype(np.float32)
    planes = scales.copy()
    mix, mean = _turn_to_principal(planes)
    np.testing.assert_allclose(mean, scales.mean(axis=(0, 2, 3)), rtol=1e-5)
    np.testing.assert_allclose(mix.T @ mix, np.eye(3), atol=1e-6)
    np.testing.assert_allclose(np.einsum("pc,vchw->vphw", mix, planes) + mean[:, None, None], scales, atol=1e-4)
    spread = planes.std(axis=(0, 2, 3))
    np.testing.assert_allclose(spread, [3, 1, 0.1], rtol=0.1)
    assert (np.take_along_axis(mix, np.abs(mix).argmax(axis=0)[None], axis=0) > 0).all()


def channel(
    plane_class: PlaneClass = PlaneClass.COLOR, step: float = 0.1, size: tuple[int, ...] = (2, 20, 28)
) -> Channel:
    values = np.random.default_rng(5).normal(1, 2, size).astype(np.float32)
    return Channel(plane_class, 0, values, step, (float(values.min()), float(values.max())))


def test_fineness_is_a_step_in_the_finest_of_12_bits() -> None:
    """16·2^(−4/6) codes of 4,095 over the range."""
    one = channel()
    low, high = one.window
    assert _fineness(one) == pytest.approx(0.1 / (16 * 2 ** (-4 / 6) * (high - low) / 4095))
    assert _fineness(Channel(PlaneClass.DEPTH, 0, one.values, 0.1, (1.0, 1.0))) == math.inf


@pytest.fixture(scope="module")
def coder() -> SceneEncoder:
    return SceneEncoder(make_smooth_gaussians(2, 32, 40, degree=1), PROFILES["balanced"], GraphStore(), threads=1)


def test_depth_has_two_pictures_below_half_the_finest_step(coder: SceneEncoder) -> None:
    (plan,) = coder.plan(0)
    one = rate.with_depth_pictures(plan, 1)
    depth = next(c for c in one.channels if c.plane_class == PlaneClass.DEPTH)
    for share, two in ((0.501, False), (0.499, True)):
        step = depth.step * share / _fineness(depth)
        channels = tuple(rate.replace(c, step=step) if c is depth else c for c in one.channels)
        found = with_enough_depth_pictures(rate.replace(one, channels=channels))
        assert (found.refine_depth is not None) == two
        assert rate.depth_fineness(found) == pytest.approx(share)
    for share, other in ((0.149, None), (0.151, 1), (0.499, 1), (0.501, 2), (0.999, 2), (1.001, None)):
        step = depth.step * share / _fineness(depth)
        channels = tuple(rate.replace(c, step=step) if c is depth else c for c in one.channels)
        assert rate._other_pictures([with_enough_depth_pictures(rate.replace(one, channels=channels))]) == other
    assert rate._other_pictures([]) is None


# ---- the model of rates ---------------------------------------------------------------------------------------------


def by_hand(values: np.ndarray) -> np.ndarray:
    """(blocks, 64) magnitudes of the orthonormal DCT, the first half the difference to the block on the left."""
    basis = np.array([[math.cos((2 * n + 1) * k * math.pi / 16) for n in range(8)] for k in range(8)]) / 2
    basis[0] /= math.sqrt(2)
    rows = []
    for view in values.astype(np.float64):
        for r in range(view.shape[0] // 8):
            before = view[8 * r : 8 * r + 8, 8:16].mean()  # of the first block in a row, the second
            for c in range(view.shape[1] // 8):
                block = view[8 * r : 8 * r + 8, 8 * c : 8 * c + 8]
                magnitudes = np.abs(basis @ block @ basis.T).ravel()
                magnitudes[0] = abs(block.mean() - before) * 4
                before = block.mean()
                rows.append(magnitudes)
    return np.array(rows)


def test_a_plane_s_sample_is_the_dct_of_its_blocks() -> None:
    values = channel().values
    found, per_sample = rate._sampled_dct(values)
    expected = by_hand(values)
    expected[0::3, 0] = found[0::3, 0]  # whose neighbour is another one: see below
    np.testing.assert_allclose(found, expected, atol=1e-5)
    assert per_sample == 1 and found.shape == (12, 64)
    means = values[:, :16, :24].reshape(2, 2, 8, 3, 8).mean(axis=(2, 4), dtype=np.float64)
    np.testing.assert_allclose(
        found[3::3, 0], 4 * np.abs(means[..., 0] - np.roll(means[..., 0], 1, axis=1)).ravel()[1:], atol=1e-5
    )
    block = np.random.default_rng(0).normal(size=(8, 8, 3)).astype(np.float32)
    np.testing.assert_allclose(np.square(dct(block)).sum(), np.square(block).sum(), rtol=1e-5)


def test_of_many_blocks_about_a_thousand_are_looked_at() -> None:
    for rows, columns, stride in ((32, 32, 1), (32, 33, 3), (64, 64, 5), (100, 100, 11)):
        values = np.zeros((1, 8 * rows, 8 * columns), np.float32)
        found, per_sample = rate._sampled_dct(values)
        assert len(found) == -(-rows * columns // stride)
        assert per_sample == rows * columns / len(found)
    assert rate._sampled_dct(np.ones((2, 3, 17), np.float32))[0].shape == (4, 64)


def test_bytes_of_a_channel_follow_from_its_coefficients() -> None:
    """3 bits for each above 0.6 steps, 1.05 for an octave above one step, 0.9 a block; within the width of a bin."""
    one = channel(step=0.8)
    coefficients, _ = rate._sampled_dct(one.values)
    for refine, shift in ((None, 0), (None, 6), (0.3, 0), (0.3, -3)):
        step = choose_code_map(*one.window, float(one.values.mean()), 0.8 * 2 ** (shift / 6)).step
        above = coefficients[coefficients > 0.6 * step]
        bits = 3 * len(above) + 1.05 * np.log2(above / step).sum() + 0.9 * len(coefficients)
        if refine:
            fine = refine * 2 ** (shift / 6)
            rest = np.abs(coefficients - step * np.floor(coefficients / step + 1 / 3))
            kept = rest[rest > 0.6 * fine]
            bits += 3 * len(kept) + 1.05 * np.log2(kept / fine).sum() + 0.9 * len(coefficients)
        assert rate.ChannelModel(one, refine).bytes_at(shift) == pytest.approx(bits / 8, rel=0.03)
    assert rate.ChannelModel(Channel(PlaneClass.COLOR, 0, one.values * 0 + 1, 0.8, (1.0, 1.0))).bytes_at(0) == 0


class Model:
    """Bytes that halve with six of a shift."""

    def __init__(self, size: float) -> None:
        self.size = size

    def bytes_at(self, shift: float) -> float:
        return self.size * 2 ** (-shift / 6)


def test_as_few_channels_as_will_do_are_moved_the_largest_first() -> None:
    models: Any = [Model(50), Model(10), Model(100), Model(0)]
    found = [100, 50, 200, 0]
    least = [(350, {2}), (292, {2}), (291, {0, 2}), (263, {0, 2}), (261, {0, 1, 2})]
    for wanted, moved in (*least, (432, {2}), (434, {0, 2}), (473, {0, 2}), (475, {0, 1, 2})):
        chosen, shift = rate._fewest_moved(models, found, wanted)
        assert {*chosen} == moved
        total = sum(size * 2 ** (-shift / 6) if n in moved else size for n, size in enumerate(found))
        assert total == pytest.approx(wanted, rel=1e-3) and abs(shift) <= 3
    chosen, shift = rate._fewest_moved(models, found, 100)
    assert {*chosen} == {0, 1, 2, 3} and 350 * 2 ** (-shift / 6) == pytest.approx(100, rel=1e-3)
    chosen, shift = rate._fewest_moved(models, found, 1e9)
    assert shift == -120  # from one end of Q_g to the other


def test_plans_are_scaled_channel_by_channel(coder: SceneEncoder) -> None:
    (plan,) = coder.plan(0)
    two = rate.with_depth_pictures(plan, 2)
    shifts = [float(n) for n in range(len(two.channels))]
    found = rate._scaled(two, shifts)
    depth = next(n for n, c in enumerate(two.channels) if c.plane_class == PlaneClass.DEPTH)
    assert [c.step for c in found.channels] == pytest.approx(
        [c.step * 2 ** (n / 6) for n, c in enumerate(two.channels)]
    )
    assert found.refine_depth == pytest.approx(two.refine_depth * 2 ** (depth / 6))
    assert [c.step for c in rate._scaled(plan, 6).channels] == pytest.approx([2 * c.step for c in plan.channels])


def test_files_say_what_each_channel_takes_and_what_else_there_is(coder: SceneEncoder) -> None:
    plans = [rate.with_depth_pictures(plan, 2) for plan in coder.plan(-6)]
    data = coder.code(plans, -6)
    sizes = rate._bytes_by_channel(plans, data)
    by_class = ts.inspect(data)["bytes_by_class"]
    for plane_class in (PlaneClass.DEPTH, PlaneClass.OPACITY, PlaneClass.COLOR):
        mine = [n for n, c in zip(sizes, plans[0].channels, strict=True) if c.plane_class == plane_class]
        assert sum(mine) == by_class[plane_class.label]
    assert abs(rate._metadata_bytes(coder, plans) - (len(data) - sum(sizes))) < 0.2 * len(data)


@pytest.mark.parametrize(
    ("size", "target", "fits"), [(97, 100, True), (96, 100, False), (100, 100, True), (101, 100, False)]
)
def test_a_file_fits_from_97_percent_of_its_target_on(size: int, target: int, fits: bool) -> None:
    assert rate._fits(bytes(size), target) == fits
    assert rate._better(bytes(50), bytes(size), target) == bytes(size if size <= target else 50)
    assert rate._better(bytes(size), bytes(50), target) == bytes(size)


class Coder:
    """Files of 1000·2^(−Q_g / 6) bytes, whose plans are the Q_g that they were made for."""

    profile = PROFILES["fast"]

    def __init__(self, monkeypatch: pytest.MonkeyPatch, error: float) -> None:
        self.sizes: list[int] = []
        monkeypatch.setattr(rate, "_plan_for", lambda encoder, size: ([], -6 * math.log2(error * size / 1000)))
        monkeypatch.setattr(
            rate, "_corrected", lambda plans, data, target: ([], 6 * math.log2(len(data) / (0.985 * target)))
        )

    def code(self, plans: object, qp: float) -> bytes:
        self.sizes.append(round(1000 * 2 ** (-qp / 6)))
        return bytes(self.sizes[-1])

    def encode(self, qp: float) -> bytes:
        assert qp == 60
        return bytes(77)


@pytest.mark.parametrize(("error", "count"), [(1, 1), (1.014, 1), (1.1, 2), (0.9, 2)])
def test_a_size_is_aimed_at_a_little_below_the_target(
    monkeypatch: pytest.MonkeyPatch, error: float, count: int
) -> None:
    coder = Coder(monkeypatch, error)
    data = rate.encode_to_size(coder, 500)  # type: ignore[arg-type]
    assert len(coder.sizes) == count and coder.sizes[0] == pytest.approx(error * 492.5, abs=1)
    assert len(data) == coder.sizes[-1] and (count == 1 or len(data) == pytest.approx(492.5, abs=1))


def test_the_coarsest_file_is_the_last_resort(monkeypatch: pytest.MonkeyPatch) -> None:
    coder = Coder(monkeypatch, 1)
    monkeypatch.setattr(coder, "code", lambda plans, qp: bytes(90))
    assert rate.encode_to_size(coder, 80) == bytes(77)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="target_size: 70 bytes; profile fast codes this scene to 77 at least"):
        rate.encode_to_size(coder, 70)  # type: ignore[arg-type]
