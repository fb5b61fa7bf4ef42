"""Mode free by hand: octrees byte by byte, channels number by number, classes of weight, grids and steps."""

from __future__ import annotations

import lzma
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scenes import make_free_gaussians

from tinysplat_runtime.codec.free import encoder, search
from tinysplat_runtime.codec.free.attributes import Columns, companded, contracted, expanded, from_columns, to_columns
from tinysplat_runtime.codec.free.levels import LEVELS, WHOLE, Tiers
from tinysplat_runtime.codec.free.octree import CodedPoints, cells_of, decode_points, encode_points, morton_keys
from tinysplat_runtime.codec.free.orders import choose_classes, classes_of, order_by, reached
from tinysplat_runtime.codec.free.planes import plane_shape, to_plane
from tinysplat_runtime.codec.profiles import PROFILES
from tinysplat_runtime.container.records import WeightClasses
from tinysplat_runtime.errors import FormatError, InputError
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.gaussian.planes import PlaneClass

FILTERS: list[dict[str, Any]] = [
    {"id": lzma.FILTER_LZMA2, "preset": 6, "lc": 0, "lp": 0, "pb": 0, "nice_len": 32, "dict_size": 1 << 16}
]


def packed(data: bytes) -> bytes:
    return lzma.compress(data, lzma.FORMAT_RAW, filters=FILTERS)


def unpacked(stream: bytes) -> bytes:
    return lzma.decompress(stream, lzma.FORMAT_RAW, filters=FILTERS)


CELLS = np.array([[0, 0, 0], [1, 0, 0], [0, 3, 0], [3, 3, 3], [2, 3, 3], [3, 2, 3], [3, 3, 2], [2, 2, 2]], float)
"""Of 4 × 4 × 4; in the first part of eight lie two, in the third one, in the last five."""


def test_keys_hold_the_bits_of_x_y_and_z_in_turns() -> None:
    cells = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [2, 0, 0], [5, 3, 6], [(1 << 21) - 1] * 3], float)
    assert morton_keys(cells).tolist() == [1, 2, 4, 8, 0b101_110_011, (1 << 63) - 1]
    np.testing.assert_array_equal(cells_of(morton_keys(cells)), cells)


def tree() -> tuple[CodedPoints, np.ndarray]:
    """The cells, of which the first holds 3 points, and the last 300."""
    keys = np.sort(morton_keys(np.concatenate([CELLS, CELLS[:1], CELLS[:1], np.repeat(CELLS[3:4], 299, axis=0)])))
    return encode_points(keys, 2), keys


def test_an_octree_is_a_byte_a_cell_in_the_stream_of_its_parent_s_parts() -> None:
    points, _ = tree()
    assert (points.levels, points.leaves, points.escapes) == ((1, 3), 8, 1)
    first, second, last = 0b11, 0b100, 1 | 1 << 7 | 1 << 6 | 1 << 5 | 1 << 3
    streams = [b"", b"", bytes([first, second, last]), bytes([1 | 1 << 2 | 1 << 7])]
    streams += [bytes([2, 0, 0, 0, 0, 0, 0, 255]), (299).to_bytes(4, "little")]
    assert [unpacked(stream) for stream in points.streams] == streams
    assert list(points.streams) == [packed(stream) for stream in streams]


def test_an_octree_is_read_back_or_says_where_it_is_wrong() -> None:
    points, keys = tree()
    streams, count = list(points.streams), len(keys)
    assert (decode_points(streams, (1, 3), 8, 1, count) == keys).all()
    for number, data, levels, leaves, escapes, points_, words in (
        (0, b"\1", (1, 3), 8, 1, count, "5 cells, announced are 4"),
        (2, b"\3\4", (1, 3), 8, 1, count, "3 cells, announced are 4"),
        (2, b"\3\4\xe9\1", (1, 3), 8, 1, count, "5 cells, announced are 4"),
        (2, b"\3\0\xe9", (1, 3), 8, 1, count, "an empty cell in level 1"),
        (2, b"\3\4\xe8", (1, 3), 8, 1, count, "level 2 does not have the 8 cells announced"),
        (3, b"\5", (1, 3), 8, 1, count, "level 1 does not have the 3 cells announced"),
        (3, b"\x85", (1, 3), 9, 1, count, "level 2 does not have the 9 cells announced"),
        (4, bytes(7), (1, 3), 8, 1, count, "points per cell are not those announced"),
        (4, bytes(8), (1, 3), 8, 1, count, "points per cell are not those announced"),
        (4, bytes(9), (1, 3), 8, 1, count, "a stream does not come to 8 bytes or less"),
        (5, bytes(3), (1, 3), 8, 1, count, "points per cell are not those announced"),
        (5, bytes(5), (1, 3), 8, 1, count, "a stream does not come to 4 bytes or less"),
        (5, bytes([44, 1, 0, 0]), (1, 3), 8, 1, count, f"{count + 1} points, announced are {count}"),
        (3, b"\x85", (1, 3), 8, 1, count - 1, f"{count} points, announced are {count - 1}"),
        (3, b"\x85", (1, 3), 8, 0, count, "points per cell are not those announced|comes? to 0 bytes"),
    ):
        changed = [*streams]
        changed[number] = packed(data)
        with pytest.raises(FormatError, match=words) as error:
            decode_points(changed, levels, leaves, escapes, points_)
        assert error.value.where == "positions"
    swapped = [streams[2], *streams[1:2], packed(b""), streams[3], *streams[4:]]
    with pytest.raises(FormatError, match="stream 2 ends in level 1"):
        decode_points(swapped, (1, 3), 8, 1, count)
    for damage in (streams[2][:-1], streams[2] + b"\0", b"\xff" * 9):
        with pytest.raises(FormatError, match=r"LZMA: |does not come to"):
            decode_points([*streams[:2], damage, *streams[3:]], (1, 3), 8, 1, count)


def test_254_further_points_need_no_number_of_their_own_and_255_do() -> None:
    for count, escapes in ((255, 0), (256, 1)):
        points = encode_points(np.zeros(count, np.uint64), 1)
        assert points.escapes == escapes and unpacked(points.streams[4]) == bytes([count - 1])
        found = decode_points(points.streams, points.levels, points.leaves, points.escapes, count)
        assert len(found) == count


def test_lists_are_pictures_along_a_z() -> None:
    sizes = {1: (16, 16), 256: (16, 16), 257: (32, 32), 1025: (64, 64), 4096: (64, 64), 4097: (64, 128),
             8193: (128, 128), 16384: (128, 128), 16385: (128, 192), 24577: (192, 192)}  # fmt: skip
    assert {count: plane_shape(count) for count in sizes} == sizes
    plane = to_plane(np.arange(300))
    assert plane[:4, :4].tolist() == [[0, 1, 4, 5], [2, 3, 6, 7], [8, 9, 12, 13], [10, 11, 14, 15]]
    assert plane[0, 16] == 256 and plane[16, 0] == 299 and plane[31, 31] == 299
    wide = to_plane(np.arange(9000))
    assert wide.shape == (128, 128) and [wide[0, 64], wide[64, 0], wide[64, 64]] == [4096, 8192, 8999]


# ---- channels -------------------------------------------------------------------------------------------------------


def one(scales: list[float], quat: list[float], opacity: float = 0.25) -> Columns:
    g = Gaussians(
        np.zeros((1, 3)), np.array([quat]), np.array([scales]), np.array([opacity]), np.arange(3.0).reshape(1, 1, 3)
    )
    return to_columns(g)


def test_channels_of_a_gaussian_by_hand() -> None:
    c = one([0.5, 0.25, 0.0625], [1, 0, 0, 0])
    assert (c.roots[0], c.lengths[0], c.thins[0]) == pytest.approx((0.5, math.log(2), math.log(4)), rel=1e-6)
    assert c.sizes[0] == pytest.approx(math.log(0.5 * 0.25) / 2, rel=1e-6)
    assert c.turns.tolist() == [[0, 0, 0]] and c.sh.tolist() == [[0, 1, 2]]
    c = one([0.25, 0.5, 0.0625], [1, 0, 0, 0])  # the longer axis is y: a quarter turn about z, either way
    np.testing.assert_allclose(np.abs(c.turns), [[0, 0, math.sqrt(0.5)]], atol=1e-7)
    c = one([0.0625, 0.5, 0.25], [2e18, 0, 0, 0])  # x, y, z become z, x, y: a third of a turn about the diagonal
    np.testing.assert_allclose(np.abs(c.turns), [[0.5] * 3], atol=1e-7)
    c = one([1e9, 1, 1e-9], [1, 0, 0, 0])
    assert (c.lengths[0], c.thins[0]) == (14, 14)
    c = one([0, 0, 0], [1, 0, 0, 0])
    assert (c.sizes[0], c.lengths[0], c.thins[0]) == pytest.approx((math.log(2e-30), 0, 0))


def columns(**fields: Any) -> Columns:
    plain = {"roots": 0.5, "sizes": 0.0, "lengths": 0.0, "thins": 0.0}
    arrays = {name: np.array([fields.get(name, value)], float) for name, value in plain.items()}
    return Columns(**arrays, turns=np.array([fields.get("turns", [0, 0, 0])], float), sh=np.zeros((1, 3)))


def test_gaussians_of_channels_by_hand() -> None:
    found = from_columns(columns(sizes=1.0, lengths=0.5, thins=0.25, turns=[0.1, 0.2, 0.3]))
    np.testing.assert_allclose(np.log(found["scales"]), [[1.25, 0.75, 0.5]], rtol=1e-6)
    np.testing.assert_allclose(found["quats"], [[math.sqrt(1 - 0.14), 0.1, 0.2, 0.3]], rtol=1e-6)
    assert found["opacities"].tolist() == [0.25] and found["sh"].shape == (1, 1, 3)
    np.testing.assert_allclose(np.log(from_columns(columns(sizes=1.0), 0.5)["scales"]), [[1.5] * 3], rtol=1e-6)
    assert from_columns(columns(roots=1.5))["opacities"] == 1 and from_columns(columns(roots=-1.0))["opacities"] == 0
    found = from_columns(columns(lengths=-3.0, thins=-1.0, turns=[0, 3, 4]))
    np.testing.assert_allclose(found["scales"], [[1, 1, 1]])
    np.testing.assert_allclose(found["quats"], [[0, 0, 0.6, 0.8]], rtol=1e-6)
    sphere = columns(sizes=1.0, lengths=0.6, thins=0.3, turns=[0.1, 0, 0]).as_spheres()
    assert (sphere.sizes[0], sphere.lengths[0], sphere.thins[0]) == pytest.approx((0.8, 0, 0))
    whole = np.log(from_columns(columns(sizes=1.0, lengths=0.6, thins=0.3))["scales"]).sum()
    assert 3 * sphere.sizes[0] == pytest.approx(whole, rel=1e-5)  # the same volume


def test_maps_of_sizes_and_places_by_hand() -> None:
    knee = 2 * math.log(8)
    given = np.array([0, knee, knee + 1, -knee, -knee - 8, 2.0])
    np.testing.assert_allclose(companded(given + 3, 3.0), [2, 16, 24, 0.25, -0.75, 2 * math.e], rtol=1e-12)
    np.testing.assert_allclose(expanded(np.array([2, 16, 24, 0.25, -0.75]), 3.0), given[:5] + 3, rtol=1e-12)
    np.testing.assert_allclose(contracted(np.array([0.5, 1, math.e, -(math.e**2)])), [0.5, 1, 2, -3], rtol=1e-12)


# ---- classes of weight ----------------------------------------------------------------------------------------------


def test_gaussians_reach_thresholds_and_two_make_a_class() -> None:
    thresholds = [np.array([1, 2, 3], np.float32), np.array([0.5], np.float32)]
    found = reached([np.array([0, 1, 2.5, 9]), np.array([0.5, 0.4, 9, 0])], thresholds)
    assert found.tolist() == [1, 1, 3, 3]
    assert classes_of(np.array([0, 1, 2, 3, 4, 5, 20], np.uint16), 1, 3).tolist() == [0, 0, 0, 0, 1, 1, 2]
    order = order_by(np.array([5, 0, 4, 20, 1], np.uint16), WeightClasses(1, (2.0, 1.0, 0.5)))
    assert order.rows.tolist() == [1, 4, 0, 2, 3] and order.gains.tolist() == [1, 2, 1, 0.5, 2]
    assert order.restored(order.sorted(np.arange(5))).tolist() == [0, 1, 2, 3, 4]


def test_gains_are_what_a_class_weighs_less_than_the_mean() -> None:
    counts, logs = np.array([8, 9, 10, 12, 30]), np.array([0.0, 1, 2, 4, 8])
    found = choose_classes(
        counts, logs, 3
    )  # halves 4, 4, 5, 6, 15: the middle is 7, the classes 6 and less, 7, 8 and more
    assert found.first == 6
    np.testing.assert_allclose(found.gains, [2 ** (3 - 7 / 4), 1, 2**-1.5], rtol=1e-6)
    assert choose_classes(np.array([0, 1]), np.zeros(2)).first == 0
    assert len(choose_classes(counts, logs).gains) == 7 and choose_classes(counts, logs).first == 4


def test_thresholds_are_half_octaves_of_what_they_are_for() -> None:
    roots = encoder._root_thresholds()
    np.testing.assert_allclose(roots, [2 ** (-n / 2) for n in range(8, -1, -1)], rtol=1e-6)
    np.testing.assert_allclose(encoder._length_thresholds(), np.log([2, 4, 8, 16]), rtol=1e-6)
    sizes = np.linspace(-1.5, 2.5, 1001) * math.log(2)
    np.testing.assert_allclose(
        encoder._size_thresholds(sizes, 0.5), companded(np.arange(-2, 4) * math.log(2), 0.5), rtol=1e-6
    )
    assert len(encoder._size_thresholds(np.array([-60.0, 60]), 0.0)) <= 128
    assert encoder._middle(np.log([4.0, 16.0])) == pytest.approx(math.log(9))  # roots of 2 and 4, of mean 3


def test_weights_are_root_opacity_and_the_roots_of_both_larger_scales() -> None:
    c = columns(roots=0.25, sizes=math.log(4), lengths=math.log(16))
    assert [float(encoder._log_weight(c, n)[0]) for n in range(3)] == pytest.approx([-2, 1, 2])
    assert encoder._log_weight(columns(roots=0.0), 0)[0] == pytest.approx(math.log2(1e-9))


# ---- grids, steps and searches --------------------------------------------------------------------------------------


def test_a_grid_s_cell_is_half_the_radius_over_the_root_of_how_many_there_are() -> None:
    means = np.random.default_rng(0).uniform(-1, 1, (10_000, 3)) * [3, 4, 12] + [1, 2, 3]
    grid, space = encoder._grid_of(means, 0.5)
    low, high = np.percentile(means, (5, 95), axis=0)
    np.testing.assert_allclose(grid.centre, (low + high) / 2)
    assert grid.radius == pytest.approx(np.linalg.norm(high - low) / 2)
    assert grid.cell == pytest.approx(0.5 * 0.5 / 100)
    np.testing.assert_allclose(space.min(axis=0), 0, atol=1e-12)
    np.testing.assert_allclose(space + grid.low, contracted((means - grid.centre) / grid.radius), atol=1e-12)
    assert encoder._with_cell(grid, 7.0, space).cell == 0.25
    assert encoder._with_cell(grid, 0, space).cell == pytest.approx(space.max() / (2**21 - 1))
    assert encoder._cells(replace(grid, cell=0.1), np.array([0.04, 0.06, 1e9])).tolist() == [0, 1, 2**21 - 1]
    point, _ = encoder._grid_of(np.ones((5, 3)), 1.0)
    assert point.radius == 1


def test_equal_cells_are_sorted_by_all_that_gaussians_have() -> None:
    g = make_free_gaussians(6, 0, np.random.default_rng(0))
    g = Gaussians(np.zeros((6, 3)), g.quats, g.scales, g.opacities, g.sh)
    keys = np.array([5, 5, 1, 5, 0, 0], np.uint64)
    order = encoder._settled_order(keys, g)
    assert keys[order].tolist() == [0, 0, 1, 5, 5, 5] and order[2] == 2
    for part in (order[:2], order[3:]):
        rows = [tuple(g.quats[n][::-1]) for n in part]
        assert rows == sorted(rows)


STEPS = {
    (PlaneClass.OPACITY, 0): 0.08, (PlaneClass.SCALE, 0): 0.28, (PlaneClass.SCALE, 1): 0.68, (PlaneClass.SCALE, 2): 1.5,
    (PlaneClass.ROTATION, 0): 0.12, (PlaneClass.ROTATION, 1): 0.12, (PlaneClass.ROTATION, 2): 0.12,
    (PlaneClass.COLOR, 0): 0.33, (PlaneClass.COLOR, 1): 0.165, (PlaneClass.COLOR, 2): 0.165,
    (PlaneClass.COLOR, 3): 0.33,
}  # fmt: skip
"""At Q_g = 0; colours behind the third have the first one's."""


@pytest.mark.parametrize(("channel", "step"), STEPS.items())
def test_channels_are_rounded_to_their_steps(channel: tuple[PlaneClass, int], step: float) -> None:
    coder = encoder._ChannelCoder(0.5, None, 1)
    values = np.array([-8.0, -1, 1, 8])
    found = coder.one(*channel, values, encoder.along_the_curve(4), 3.0).values
    away = np.abs(values) / (1.5 * step)
    np.testing.assert_allclose(found, np.sign(values) * 1.5 * step * np.floor(away + 1 / 3), rtol=1e-6)


def test_channels_that_vary_less_than_a_share_of_their_step_are_numbers() -> None:
    order, values = encoder.along_the_curve(4), np.array([1.0, 1, 3, 3])
    for step, is_flat in ((1 / 0.1201, False), (1 / 0.1199, True)):
        found = encoder._code_channel(PlaneClass.OPACITY, 0, values, step, order, PROFILES["fast"].encoder)
        assert (found.payload is None) == is_flat and found.channel.centre == 2
        if is_flat:
            assert found.values.tolist() == [2, 2, 2, 2] and found.channel.record.qp == 0


def test_the_basis_of_colours_is_that_of_weighted_means() -> None:
    sh = np.array([[1.0, 0, 0], [-1, 0, 0], [3, 2, 0], [3, -2, 0]])
    gains = np.array([1.0, 1, 2, 2])
    mean, basis, parts = encoder._colours(sh, gains, 1e-6)
    np.testing.assert_allclose(mean, [(1 - 1 + 3 / 4 + 3 / 4) / 2.5, 0, 0], rtol=1e-6)
    np.testing.assert_array_equal(basis, [[1, 0], [0, 1], [0, 0]])
    np.testing.assert_allclose(np.stack(parts), [sh[:, 0] - 0.6, sh[:, 1]], atol=1e-6)
    assert encoder._colours(sh, gains, 1e6)[1].shape == (3, 0)


def test_what_is_far_brighter_than_the_rest_is_cut() -> None:
    """At 32 times the 99th percentile of what they differ by, or at 32 from the median."""
    sh = np.zeros((400, 3))
    sh[::2], sh[1::2, 0] = 4, -4
    sh[7] = 1e6
    _, _, parts = encoder._colours(sh, np.ones(400), 1e-6)
    mean, basis, _ = encoder._colours(sh, np.ones(400), 1e-6)
    back = mean + basis.astype(float) @ np.stack(parts)[:, 7]
    middle = np.median(sh, axis=0)
    most = 32 * np.maximum(np.percentile(np.abs(sh - middle), 99, axis=0), 1)
    np.testing.assert_allclose(back, middle + most, rtol=2e-3)


def test_tiers_of_some_gaussians_are_tiers_unless_one_is_empty() -> None:
    tiers = Tiers(LEVELS, np.array([0, 1, 2, 2, 1]), (0.1, 0.2))
    some = tiers.of(np.array([0, 1, 3]))
    assert some.numbers.tolist() == [0, 1, 2] and some.growths == (0.1, 0.2) and some.levels is LEVELS
    none = tiers.of(np.array([1, 3]))
    assert none.levels is WHOLE and none.numbers.tolist() == [0, 0] and none.growths == ()
    assert [(level.share, level.steps, level.cell) for level in WHOLE] == [(1, 1, 1)]
    shares = [level.share for level in LEVELS]
    assert (
        shares == sorted(shares)
        and shares[-1] == 1
        and [level.steps for level in LEVELS] == sorted(x.steps for x in LEVELS)
    )


class Scripted:
    """A coder whose files have 2^(10 − Q_g / 10) bytes."""

    profile = PROFILES["fast"]

    def __init__(self) -> None:
        self.asked: list[float] = []

    def code(self, qp: float) -> bytes:
        self.asked.append(qp)
        return bytes(round(2 ** (10 - qp / 10)))


def test_sizes_are_searched_by_octaves() -> None:
    coder = Scripted()
    data = search.code_to_size(coder, 500)
    assert 485 <= len(data) <= 500 and len(coder.asked) == 2
    with pytest.raises(InputError, match=r"target_size: 5 bytes; profile fast codes this scene to 16 at least"):
        search.code_to_size(Scripted(), 5)
    assert len(search.code_to_size(Scripted(), 10**6)) == 2**16


def test_decibels_are_searched_with_an_eye_on_their_typical_fall() -> None:
    coder = Scripted()
    data = search.code_to_psnr(coder, 35.0, lambda data: 40 - 0.95 * 10 * (10 - math.log2(len(data))))
    assert len(coder.asked) == 2 and 35 <= 40 - 9.5 * (10 - math.log2(len(data))) <= 35.2
    with pytest.raises(InputError, match=r"target_psnr: 99 dB; profile fast reaches 60\.00 dB here at most"):
        search.code_to_psnr(Scripted(), 99.0, lambda data: math.log2(len(data)) * 60 / 16)
