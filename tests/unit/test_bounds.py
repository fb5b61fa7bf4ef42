"""What metadata lets decoding come to: files at the end of float32 are refused, and files short of it are not.

Files are written by hand here: constants alone, so that nothing but the metadata speaks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from sections import file_of, sections_of

from tinysplat_runtime.container import layout as L
from tinysplat_runtime.container.bounds import MAX_DECODED
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.container.records import Container
from tinysplat_runtime.container.writer import CodedChannel, CodedLayer, write_container
from tinysplat_runtime.errors import FormatError
from tinysplat_runtime.gaussian.planes import LayerPlan, PlaneClass
from tinysplat_runtime.scene.cameras import Camera

Record = tuple[PlaneClass, int, float]
"""A channel that is one number: class, target, value."""


def _file(
    records: Sequence[Record] = (), *, size: tuple[int, int] = (2, 3), focal: tuple[float, float] = (100.0, 100.0),
    centre: tuple[float, float] = (0.0, 0.0), depths: tuple[float, float] = (1.0, 2.0), position: float = 0.0,
) -> bytes:  # fmt: skip
    """A file of one layer of (height, width) whose channels are constants."""
    c2w = np.eye(4)
    c2w[0, 3] = position
    K = [[focal[0], 0, centre[0]], [0, focal[1], centre[1]], [0, 0, 1]]
    camera = Camera(K, c2w, size[1], size[0])
    channels = tuple(CodedChannel(c, target, 0, 0.0, value) for c, target, value in records)
    layer = CodedLayer(*size, 0, LayerPlan((), 0, depths), channels, b"", (camera,))
    return write_container([layer], [camera], np.zeros(3), "paper", 0.0)


def _read(**options: object) -> Container:
    return read_container(_file(**options))  # type: ignore[arg-type]


def test_records_of_one_target_add_up():
    depth = PlaneClass.DEPTH
    assert len(_read(records=[(depth, 0, 0.4e30), (depth, 0, -0.5e30)]).layers[0].channels) == 2
    with pytest.raises(FormatError, match=r"depth can decode to 1\.6e\+30"):
        _read(records=[(depth, 0, 0.8e30), (depth, 0, -0.8e30)])


@pytest.mark.parametrize("axis", [0, 1])
def test_a_mean_s_reach_counts_every_part_of_its_ray(axis):
    """(pixel + offset + principal point) / focal length times depth, on either axis; 0.1 of it stays in, 2 does not."""

    def along(value: float) -> tuple[float, float]:
        return (value, 1e9) if axis == 0 else (1e9, value)

    far = (1.0, MAX_DECODED / 10)
    sides = ((2, 20), (20, 2))[axis]
    centre = (19.0, 0.0) if axis == 0 else (0.0, 19.0)
    offset = [(PlaneClass.OFFSET, axis, 20.0)]
    for options in ({"size": sides}, {"centre": centre}, {"records": offset}):
        assert _read(depths=far, focal=along(20.0), **options)
        with pytest.raises(FormatError, match="means of view 0"):
            _read(depths=far, focal=along(1.0), **options)


def test_a_mean_s_reach_counts_depth_itself():
    slanted = {"focal": (1e9, 1e9), "centre": (0.5e9, 0.0)}  # a ray of slope 0.5
    assert _read(depths=(1.0, 0.6e30), **slanted)
    with pytest.raises(FormatError, match="means of view 0"):
        _read(depths=(1.0, 0.8e30), **slanted)


@pytest.mark.parametrize("depths", [(1e-31, 1.0), (1.0, 1.1e30)])
def test_depths_whose_inverse_or_self_leaves_the_bounds_are_refused(depths):
    with pytest.raises(FormatError, match="depths"):
        _read(depths=depths)


def test_scales_count_as_planes_and_as_sizes_in_the_world():
    wide = [(PlaneClass.SCALE, 2, 1e10)]
    assert _read(records=wide, depths=(1.0, 1e19), focal=(1.0, 1.0))
    with pytest.raises(FormatError, match="scales of view 0"):
        _read(records=wide, depths=(1.0, 1e21), focal=(1.0, 1.0))


def test_rotations_whose_squares_leave_float32_are_refused():
    assert _read(records=[(PlaneClass.ROTATION, 3, -0.9e15)])
    with pytest.raises(FormatError, match="rotation"):
        _read(records=[(PlaneClass.ROTATION, 3, -1.1e15)])


def _with_records(records: Sequence[Record], order: Sequence[int]) -> bytes:
    """The file of such constants whose records stand in another order, or more than once."""
    sections = sections_of(_file(records))
    layer = next(section for section in sections if section[0] == L.LAYER)
    size = L.CHANNEL.size
    start = len(layer[3]) - size * len(records)
    rows = [layer[3][start + i * size : start + (i + 1) * size] for i in range(len(records))]
    fields = list(L.LAYER_FIXED.unpack(layer[3][: L.LAYER_FIXED.size]))
    fields[6] = len(order)
    layer[3] = L.LAYER_FIXED.pack(*fields) + layer[3][L.LAYER_FIXED.size : start] + b"".join(rows[i] for i in order)
    return file_of(sections)


def test_channels_stand_by_rising_class_and_each_once():
    records = [(PlaneClass.DEPTH, 0, 1.5), (PlaneClass.OPACITY, 0, 0.5), (PlaneClass.OFFSET, 0, 0.0),
               (PlaneClass.OFFSET, 1, 0.0)]  # fmt: skip
    kept = read_container(_with_records(records, [0, 1, 2, 3])).layers[0].channels
    assert [(c.plane_class, c.target) for c in kept] == [record[:2] for record in records]
    assert read_container(_with_records(records, [0, 0, 1, 2, 3]))  # depth's refinement is a second record
    with pytest.raises(FormatError, match="out of order"):
        read_container(_with_records(records, [0, 2, 1, 3]))
    with pytest.raises(FormatError, match="opacity0 stands twice"):
        read_container(_with_records(records, [0, 1, 1, 2, 3]))
    with pytest.raises(FormatError, match="twice"):
        read_container(_with_records(records, [0, 1, 2, 3, 2]))
