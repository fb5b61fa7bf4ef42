"""What metadata lets decoding come to: files at the end of float32 are refused, and files short of it are not.

Files are written by hand here: constants alone, so that nothing but the metadata speaks.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
import pytest
from scenes import refusing
from sections import file_of, sections_of

from tinysplat_runtime.container import layout as L
from tinysplat_runtime.container.body import Container
from tinysplat_runtime.container.bounds import MAX_DECODED, decoding_bytes
from tinysplat_runtime.container.layers import CodedChannel, CodedLayer
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.container.records import Limits
from tinysplat_runtime.container.sections import NewSection
from tinysplat_runtime.container.writer import write_container
from tinysplat_runtime.errors import FormatError
from tinysplat_runtime.gaussian.planes import LayerPlan, PlaneClass
from tinysplat_runtime.scene.cameras import Camera

Record = tuple[PlaneClass, int, float]
"""A channel that is one number: class, target, value."""


def _file(
    records: Sequence[Record] = (),
    *,
    size: tuple[int, int] = (2, 3),
    focal: tuple[float, float] = (100.0, 100.0),
    centre: tuple[float, float] = (0.0, 0.0),
    depths: tuple[float, float] = (1.0, 2.0),
    position: float = 0.0,
) -> bytes:
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
    assert len(_read(records=[(depth, 0, 0.4e30), (depth, 0, -0.5e30)]).body.layers[0].channels) == 2
    with refusing(FormatError, "depth"):
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
        with refusing(FormatError, "means"):
            _read(depths=far, focal=along(1.0), **options)


def test_a_mean_s_reach_counts_depth_itself():
    slanted = {"focal": (1e9, 1e9), "centre": (0.5e9, 0.0)}  # a ray of slope 0.5
    assert _read(depths=(1.0, 0.6e30), **slanted)
    with refusing(FormatError, "means"):
        _read(depths=(1.0, 0.8e30), **slanted)


@pytest.mark.parametrize("depths", [(1e-31, 1.0), (1.0, 1.1e30)])
def test_depths_whose_inverse_or_self_leaves_the_bounds_are_refused(depths):
    with refusing(FormatError, "LAYR[0]"):
        _read(depths=depths)


def test_scales_count_as_planes_and_as_sizes_in_the_world():
    wide = [(PlaneClass.SCALE, 2, 1e10)]
    assert _read(records=wide, depths=(1.0, 1e19), focal=(1.0, 1.0))
    with refusing(FormatError, "scales"):
        _read(records=wide, depths=(1.0, 1e21), focal=(1.0, 1.0))


def test_rotations_whose_squares_leave_float32_are_refused():
    assert _read(records=[(PlaneClass.ROTATION, 3, -0.9e15)])
    with refusing(FormatError, "1e+15"):
        _read(records=[(PlaneClass.ROTATION, 3, -1.1e15)])


def test_limits_are_the_most_that_is_accepted():
    data = _file()
    memory = decoding_bytes(read_container(data).body.layers[0])
    assert read_container(data, Limits(max_pixels=6, max_memory_bytes=memory, max_views=1, max_layers=1))
    for limits, words in (
        (Limits(max_pixels=5), "6 5"),
        (Limits(max_memory_bytes=memory - 1), f"{memory} {memory - 1}"),
        (Limits(max_views=0), "1 views"),
        (Limits(max_layers=0), "1 layers"),
    ):
        with refusing(FormatError, words):
            read_container(data, limits)


def _with_header(**fields: object) -> bytes:
    """The file without channels, some numbers of its layer's header replaced."""
    sections = sections_of(_file())
    layer = next(section for section in sections if section[0] == L.LAYER)
    names = ("height", "width", "degree", "source_degree", "flags", "sets", "channels", "k", "z_min", "z_max", "lost",
             "condition")  # fmt: skip
    values = dict(zip(names, L.LAYER_FIXED.unpack(layer[3][: L.LAYER_FIXED.size]), strict=True))
    tail = fields.pop("tail", b"")
    layer[3] = L.LAYER_FIXED.pack(*{**values, **fields}.values()) + tail
    return file_of(sections)


_CONSTANT = struct.Struct("<BBBBff")
_OVER, _INFINITE, _NAN = np.float32(1.01e30), np.inf, np.nan


@pytest.mark.parametrize(
    ("accepted", "refused", "words"),
    [
        ({"height": 1}, {"height": 0}, "grid 3 0"),
        ({"width": 1}, {"width": 0}, "grid 0 2"),
        ({"height": 65536}, {"height": 65537}, "grid 3 65537"),
        ({"width": 65536}, {"width": 65537}, "grid 65537 2"),
        ({"source_degree": 4}, {"source_degree": 5}, "SH degree 0 of 5"),
        ({"z_min": 2.0}, {"z_min": 2.001}, "LAYR[0]"),
        ({"z_min": 1e-29}, {"z_min": 0.0}, "LAYR[0]"),
        ({"z_max": 9e29}, {"z_max": _INFINITE}, "LAYR[0]"),
        ({"lost": -1.0}, {"lost": _NAN}, "LAYR[0]"),
        ({"condition": 1e-30}, {"condition": 0.0}, "LAYR[0]"),
        ({"condition": 1e30}, {"condition": _INFINITE}, "LAYR[0]"),
        ({"flags": 1}, {"flags": 32}, "unknown flags 0x20"),
        ({"k": 0}, {"k": 1}, "degree 0 without a basis"),
        ({"channels": 0}, {"channels": 257}, "257 channels, at most 256"),
        ({"channels": 256, "tail": _CONSTANT.pack(0, 0, 0, 0, 1, 0) * 256},
         {"channels": 256, "tail": _CONSTANT.pack(0, 0, 0, 0, 1, 0) * 255}, "needs 12 bytes"),
        ({"channels": 1, "tail": _CONSTANT.pack(5, 1, 0, 51, -9e29, 0)},
         {"channels": 1, "tail": _CONSTANT.pack(5, 1, 0, 52, 0, 0)}, "QP 52"),
        ({"channels": 1, "tail": _CONSTANT.pack(5, 1, 0, 0, 9e29, 0)},
         {"channels": 1, "tail": _CONSTANT.pack(5, 2, 0, 0, 0, 0)}, "offset has no channel 2"),
        ({"channels": 1, "tail": _CONSTANT.pack(1, 2, 0, 0, 0, 0)},
         {"channels": 1, "tail": _CONSTANT.pack(1, 3, 0, 0, 0, 0)}, "color has no channel 3"),
        ({"channels": 1, "tail": _CONSTANT.pack(5, 0, 0, 0, 0, 0)},
         {"channels": 1, "tail": _CONSTANT.pack(6, 0, 0, 0, 0, 0)}, "plane class 6, known are 0 to 5"),
        ({"channels": 1, "tail": _CONSTANT.pack(5, 0, 0, 0, 0, 0)},
         {"channels": 1, "tail": _CONSTANT.pack(5, 0, 2, 0, 0, 0)}, "coding 2 is unknown"),
        ({"channels": 1, "tail": _CONSTANT.pack(0, 0, 0, 0, 0, 9e29)},
         {"channels": 1, "tail": _CONSTANT.pack(0, 0, 0, 0, 0, -_OVER)}, "depth0"),
        ({"channels": 1, "tail": _CONSTANT.pack(0, 0, 0, 0, 9e29, 0)},
         {"channels": 1, "tail": _CONSTANT.pack(0, 0, 0, 0, _OVER, 0)}, "depth0"),
        ({"flags": 2, "tail": struct.pack("<4f", 1.0009, 0, 0, 0)},
         {"flags": 2, "tail": struct.pack("<4f", 1.0011, 0, 0, 0)}, "LAYR[0]"),
        ({"flags": 2, "tail": struct.pack("<4f", 0, 0, -0.9991, 0)},
         {"flags": 2, "tail": struct.pack("<4f", 0, 0, -0.9989, 0)}, "LAYR[0]"),
        ({"flags": 4, "tail": struct.pack("<12f", *range(12))},
         {"flags": 4, "tail": struct.pack("<12f", *range(11), _NAN)}, "LAYR[0]"),
        ({"flags": 8, "k": 3, "tail": bytes(18)}, {"flags": 8, "k": 4, "tail": bytes(24)}, "4 1 3"),
        ({"flags": 8, "k": 1, "tail": bytes(6)}, {"flags": 8, "k": 0}, "0 1 3"),
        ({"flags": 8, "k": 1, "tail": bytes(6)}, {"flags": 8, "k": 1, "tail": b"\0\x7e" * 3}, "LAYR[0]"),
        ({"flags": 8, "degree": 4, "source_degree": 4, "k": 75, "tail": bytes(75 * 150)},
         {"flags": 8, "degree": 4, "source_degree": 3, "k": 75, "tail": bytes(75 * 150)}, "SH degree 4 of 3"),
        ({"flags": 0}, {"tail": b"\0"}, "1 bytes too many"),
    ],
)  # fmt: skip
def test_every_number_of_a_layer_is_accepted_to_its_bound_and_no_further(accepted, refused, words):
    """docs/FORMAT.md, section LAYR, either side of each of its bounds."""
    assert read_container(_with_header(**accepted)).body.layers
    with refusing(FormatError, words):
        read_container(_with_header(**refused))


def test_the_scale_mix_counts_as_its_largest_row_and_mean():
    """Rows whose magnitudes sum to 6, 15 and 24, scales of up to 1e28, means of 1e29: at most 3.4e29 of 1e30."""
    mix = struct.pack("<12f", *(-1e29 * (n == 11) if n > 8 else n + 1.0 for n in range(12)))
    records = _CONSTANT.pack(3, 0, 0, 0, 0, -1e28)
    assert read_container(_with_header(flags=4, channels=1, tail=mix + records))
    with refusing(FormatError, "scales"):
        read_container(_with_header(flags=4, channels=1, tail=mix + _CONSTANT.pack(3, 0, 0, 0, 0, 4e28)))


def test_the_basis_counts_each_component_by_its_largest_coefficient():
    basis = np.array([[1, -4], [-2, 0], [0.5, 3]], "<f2").tobytes()  # 2 and 4 at most

    def read(first: float, second: float) -> Container:
        records = b"".join(_CONSTANT.pack(1, n, 0, 0, 0, value) for n, value in enumerate((first, second)))
        return read_container(_with_header(flags=8, k=2, channels=2, tail=basis + records))

    assert read(-1e29, 1.9e29)
    with refusing(FormatError, "sh"):
        read(-1e29, 2.1e29)


def _with_photos(
    size: tuple[int, int] = (2, 3),
    *,
    depths: tuple[float, float] = (1.0, 2.0),
    network: bytes = b"net",
    layers: int = 0,
    **fields: int,
) -> bytes:
    """A file of photos whose picture is no picture: what its metadata says is all that counts."""
    camera = Camera([[100.0, 0, 0], [0, 100.0, 0], [0, 0, 1]], np.eye(4), 3, 2)
    values = {"format": 0, "qp": 20, "sets": 7, "length": 3, **fields}
    photos = struct.pack("<2I4B", *size, values["format"], values["qp"], values["sets"], 0)
    extras = [
        NewSection(b"NETW", 0, struct.pack("<32s64s2d", bytes(32), network, *depths)),
        NewSection(b"PHOT", 0, photos + struct.pack("<2I", values["length"], 0)),
        NewSection(b"HEVC", 7, b"sets"),
        NewSection(b"PICS", 0, b"abc"),
    ]
    return write_container([], [camera], np.zeros(3), "fast", 0.0, extras, layer_count=layers)


@pytest.mark.parametrize(
    ("accepted", "refused", "words"),
    [
        ({}, {"layers": 1}, "1 layers, accepted are 0 to 0"),
        ({"size": (1, 1)}, {"size": (0, 1)}, "photos of 1 0"),
        ({"size": (1, 65536)}, {"size": (1, 65537)}, "photos of 65537 1"),
        ({"size": (65536, 1)}, {"size": (65537, 1)}, "photos of 1 65537"),
        ({"qp": 51}, {"qp": 52}, "QP 52, accepted are 0 to 51"),
        ({}, {"format": 1}, "photo format 1 is unknown"),
        ({}, {"sets": 8}, "parameter set 8 is missing"),
        ({}, {"length": 2}, "3 bytes behind it, 2 announced"),
        ({"depths": (1e-29, 9e29)}, {"depths": (0.9e-30, 1.0)}, "near 9e-31 and far 1"),
        ({}, {"depths": (2.0, 2.0)}, "near 2 and far 2"),
        ({}, {"depths": (1.0, 1.1e30)}, "1.1e+30"),
        ({"depths": (1.0, float(np.nextafter(1e30, 0)))}, {"depths": (1.0, 1e30)}, "1e+30"),
        ({"network": b"n" * 64}, {"network": b"n\xe9t"}, "not printable ASCII"),
        ({"network": b"a b"}, {"network": b"a\nb"}, "not printable ASCII"),
    ],
)
def test_every_number_of_photos_is_accepted_to_its_bound_and_no_further(accepted, refused, words):
    found = read_container(_with_photos(**accepted))
    assert found.mode == "photos"
    with refusing(FormatError, words):
        read_container(_with_photos(**refused))


def test_photos_count_as_pixels():
    data = _with_photos((5, 7))
    assert read_container(data, Limits(max_pixels=35)).body.photos.height == 5
    with refusing(FormatError, "35 pixels of photos"):
        read_container(data, Limits(max_pixels=34))


def _with_exact(
    size: tuple[int, int] = (2, 3),
    *,
    degree: int = 0,
    depths: tuple[float, float] = (1.0, 2.0),
    layers: int = 1,
    lengths: Sequence[int] = (),
    tail: bytes = b"",
) -> bytes:
    """A lossless file whose planes are one byte each and no planes: what its metadata says is all that counts."""
    camera = Camera([[100.0, 0, 0], [0, 100.0, 0], [0, 0, 1]], np.eye(4), 3, 2)
    lengths = lengths or [1] * (12 + 3 * (degree + 1) ** 2)
    fixed = struct.pack("<2IB3x2f32x5d", *size, degree, *depths, 100, 100, 0, 0, 0)
    table = b"".join(struct.pack("<2I", length, 0) for length in lengths)
    extras = [NewSection(b"EXAC", n, fixed + table + tail) for n in range(layers)]
    extras += [NewSection(b"EXAP", n, bytes(12 + 3 * (degree + 1) ** 2)) for n in range(layers)]
    return write_container([], [camera], np.zeros(3), "max", 0.0, extras, layer_count=layers)


@pytest.mark.parametrize(
    ("accepted", "refused", "words"),
    [
        ({"size": (1, 1)}, {"size": (0, 1)}, "grid 1 0"),
        ({"size": (1, 65536)}, {"size": (1, 65537)}, "grid 65537 1"),
        ({"size": (65536, 1)}, {"size": (65537, 1)}, "grid 1 65537"),
        ({"degree": 4}, {"degree": 5}, "SH degree 5"),
        ({"depths": (2.0, 2.0)}, {"depths": (2.1, 2.0)}, "EXAC[0]"),
        ({"depths": (1.1e-30, 2.0)}, {"depths": (0.9e-30, 2.0)}, "EXAC[0]"),
        ({"depths": (1.0, 0.9e30)}, {"depths": (1.0, 1.1e30)}, "EXAC[0]"),
        ({"lengths": [0] * 14 + [15]}, {"lengths": [0] * 14 + [16]}, "15 bytes behind it, 16 announced"),
        ({}, {"tail": b"x"}, "1 bytes too many"),
    ],
)
def test_every_number_of_exact_planes_is_accepted_to_its_bound_and_no_further(accepted, refused, words):
    assert read_container(_with_exact(**accepted)).mode == "lossless"
    with refusing(FormatError, words):
        read_container(_with_exact(**refused))


def test_exact_planes_count_as_gaussians_and_as_memory():
    """Two layers of 6 Gaussians with 15 planes, which are float16 in the file and float32 outside."""
    data = _with_exact(layers=2)
    assert len(read_container(data, Limits(max_pixels=12)).body.layers) == 2
    for limits, words in ((Limits(max_pixels=11), "EXAC[1]: 12"), (Limits(max_memory_bytes=2 * 6 * 15 * 4), "EXAC[0]")):
        with refusing(FormatError, words):
            read_container(data, limits)


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
    records = [
        (PlaneClass.DEPTH, 0, 1.5),
        (PlaneClass.OPACITY, 0, 0.5),
        (PlaneClass.OFFSET, 0, 0.0),
        (PlaneClass.OFFSET, 1, 0.0),
    ]
    kept = read_container(_with_records(records, [0, 1, 2, 3])).body.layers[0].channels
    assert [(c.plane_class, c.target) for c in kept] == [record[:2] for record in records]
    assert read_container(_with_records(records, [0, 0, 1, 2, 3]))  # depth's refinement is a second record
    with refusing(FormatError, "LAYR[0]"):
        read_container(_with_records(records, [0, 2, 1, 3]))
    with refusing(FormatError, "opacity0"):
        read_container(_with_records(records, [0, 1, 1, 2, 3]))
    with refusing(FormatError, "offset0"):
        read_container(_with_records(records, [0, 1, 2, 3, 2]))
