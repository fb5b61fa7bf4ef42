"""What metadata lets decoding come to: files at the end of float32 are refused, and files short of it are not.

Files are written by hand here: constants alone, so that nothing but the metadata speaks.
"""

import struct
from collections.abc import Sequence

import numpy as np
import pytest
from scenes import refusing
from sections import changed_section

from tinysplat_runtime.container import layout as L
from tinysplat_runtime.container.body import Container
from tinysplat_runtime.container.bounds import MAX_DECODED, decoding_bytes
from tinysplat_runtime.container.layers import CodedLayer
from tinysplat_runtime.container.limits import Limits
from tinysplat_runtime.container.planes import planes_file
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.container.records import ChannelRecord, Picture
from tinysplat_runtime.container.sections import NewSection
from tinysplat_runtime.container.writer import Head, write_container
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
) -> bytes:
    """A file of one layer of (height, width) whose channels are constants."""
    K = [[focal[0], 0, centre[0]], [0, focal[1], centre[1]], [0, 0, 1]]
    camera = Camera(K, np.eye(4), size[1], size[0])
    channels = tuple(ChannelRecord(c, target, 0, 0.0, value) for c, target, value in records)
    layer = CodedLayer(*size, 0, LayerPlan((), 0, depths), channels, b"", (camera,))
    return planes_file(Head([camera], np.zeros(3), "paper", 0.0), [layer])


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


def _with_header(rows: Sequence[tuple] = (), size: tuple[int, int] = (2, 3), **fields: object) -> bytes:
    """The file with such rows of constants, some numbers of its layer's header replaced."""
    names = ("height", "width", "degree", "source_degree", "flags", "sets", "k", "z_min", "z_max", "lost", "condition")
    tail = fields.pop("tail", b"")

    def change(text: bytearray) -> None:
        values = dict(zip(names, L.LAYER_FIXED.unpack(text), strict=True))
        text[:] = L.LAYER_FIXED.pack(*{**values, **fields}.values()) + tail

    def list_rows(text: bytearray) -> None:
        text[:] = L.PICTURES_FIXED.pack(len(rows), 1, 0) + b"".join(L.CHANNEL.pack(0, *row) for row in rows)

    return changed_section(changed_section(_file(size=size), L.LAYER, change), L.PICTURES, list_rows)


def _columns(*numbers: float) -> bytes:
    """Columns that are one float32 each."""
    return b"".join(struct.pack("<Bf", 2, number) for number in numbers)


_OVER, _INFINITE, _NAN = np.float32(1.01e30), np.inf, np.nan


@pytest.mark.parametrize(
    ("accepted", "refused", "words"),
    [
        ({"height": 2}, {"height": 0}, "grid 3 0"),
        ({"width": 3}, {"width": 0}, "grid 0 2"),
        ({"height": 1, "size": (1, 3)}, {"height": 1}, "3x1 3x2"),
        ({"height": 65536, "size": (65536, 3)}, {"height": 65537}, "grid 3 65537"),
        ({"width": 65536, "size": (2, 65536)}, {"width": 65537}, "grid 65537 2"),
        ({"source_degree": 4}, {"source_degree": 5}, "SH degree 0 of 5"),
        ({"z_min": 2.0}, {"z_min": 2.001}, "LAYR[0]"),
        ({"z_min": 1e-29}, {"z_min": 0.0}, "LAYR[0]"),
        ({"lost": -1.0}, {"lost": _NAN}, "LAYR[0]"),
        ({"condition": 1e-30}, {"condition": 0.0}, "LAYR[0]"),
        ({"flags": 1}, {"flags": 32}, "unknown flags 0x20"),
        ({"k": 0}, {"k": 1}, "degree 0 without a basis"),
        ({"rows": [(5, 1, 255, -9e29, 0)]}, {"rows": [(5, 2, 255, 0, 0)]}, "offset has no channel 2"),
        ({"rows": [(5, 0, 255, 0, 0)]}, {"rows": [(6, 0, 255, 0, 0)]}, "position0 of another mode"),
        ({"rows": [(0, 0, 255, 0, 9e29)]}, {"rows": [(0, 0, 255, 0, -_OVER)]}, "depth0"),
        ({"rows": [(0, 0, 255, 9e29, 0)]}, {"rows": [(0, 0, 255, _OVER, 0)]}, "depth0"),
        ({"rows": [(0, 0, 255, 0, 1), (0, 0, 255, 0, 1)]}, {"rows": [(2, 0, 255, 0, 1)] * 2}, "opacity0 stands twice"),
        ({"flags": 4, "tail": _columns(1.0009, 0, 0, 0)},
         {"flags": 4, "tail": _columns(1.0011, 0, 0, 0)}, "LAYR[0]"),
        ({"flags": 4, "tail": _columns(0, 0, -0.9991, 0)},
         {"flags": 4, "tail": _columns(0, 0, -0.9989, 0)}, "LAYR[0]"),
        ({}, {"flags": 4, "tail": struct.pack("<Bd", 0, 1e300) * 4}, "LAYR[0]"),
        ({"flags": 8, "tail": struct.pack("<12f", *range(12))},
         {"flags": 8, "tail": struct.pack("<12f", *range(11), _NAN)}, "LAYR[0]"),
        ({"flags": 16, "k": 3, "tail": bytes(18)}, {"flags": 16, "k": 4, "tail": bytes(24)}, "4 1 3"),
        ({"flags": 16, "k": 1, "tail": bytes(6)}, {"flags": 16, "k": 0}, "0 1 3"),
        ({"flags": 16, "k": 1, "tail": bytes(6)}, {"flags": 16, "k": 1, "tail": b"\0\x7e" * 3}, "LAYR[0]"),
        ({"flags": 16, "degree": 4, "source_degree": 4, "k": 75, "tail": bytes(75 * 150)},
         {"flags": 16, "degree": 4, "source_degree": 3, "k": 75, "tail": bytes(75 * 150)}, "SH degree 4 of 3"),
        ({"flags": 2, "tail": _columns(90, 90, 1, 1, 0)}, {"flags": 2, "tail": _columns(0, 90, 1, 1, 0)}, "K"),
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
    assert read_container(_with_header([(3, 0, 255, 0, -1e28)], flags=8, tail=mix))
    with refusing(FormatError, "scales"):
        read_container(_with_header([(3, 0, 255, 0, 4e28)], flags=8, tail=mix))


def test_the_basis_counts_each_component_by_its_largest_coefficient():
    basis = np.array([[1, -4], [-2, 0], [0.5, 3]], "<f2").tobytes()  # 2 and 4 at most

    def read(first: float, second: float) -> Container:
        rows = [(1, n, 255, 0, value) for n, value in enumerate((first, second))]
        return read_container(_with_header(rows, flags=16, k=2, tail=basis))

    assert read(-1e29, 1.9e29)
    with refusing(FormatError, "sh"):
        read(-1e29, 2.1e29)


def _with_photos(
    size: tuple[int, int] = (2, 3),
    *,
    depths: tuple[float, float] = (1.0, 2.0),
    network: bytes = b"net",
    layers: int = 0,
    payloads: Sequence[bytes] = (b"abc",),
    **fields: int,
) -> bytes:
    """A file of photos whose picture is no picture: what its metadata says is all that counts."""
    sides = [min(max(side, 1), 65536) for side in size]
    camera = Camera([[100.0, 0, 0], [0, 100.0, 0], [0, 0, 1]], np.eye(4), sides[1], sides[0])
    values = {"format": 0, "sets": 7, **fields}
    photos = struct.pack("<32s64s2d2I2BH", b"", network, *depths, *size, values["format"], values["sets"], 0)
    extras = [NewSection(b"PHOT", 0, photos), NewSection(b"HEVC", 7, b"sets")]
    rows = [(0, ChannelRecord(PlaneClass.PHOTO, 0, 20, 0.0, 0.0, Picture.each_of(payloads)))]
    return write_container(Head([camera], np.zeros(3), "fast", 0.0), extras, rows, layers)


@pytest.mark.parametrize(
    ("accepted", "refused", "words"),
    [
        ({}, {"layers": 1}, "1 layers, accepted are 0 to 0"),
        ({"size": (1, 1)}, {"size": (0, 1)}, "photos of 1 0"),
        ({"size": (1, 65536)}, {"size": (1, 65537)}, "photos of 65537 1"),
        ({}, {"format": 1}, "photo format 1 is unknown"),
        ({}, {"sets": 8}, "parameter set 8 is missing"),
        ({}, {"payloads": ()}, "PICT[0]"),
        ({"depths": (1e-29, 9e29)}, {"depths": (0.9e-30, 1.0)}, "near 9e-31 and far 1"),
        ({}, {"depths": (2.0, 2.0)}, "near 2 and far 2"),
        ({}, {"depths": (1.0, 1.1e30)}, "1.1e+30"),
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
    planes: Sequence[int] | None = None,
    flags: int = 0,
    tail: bytes = b"",
) -> bytes:
    """A lossless file whose planes are one byte each and no planes: what its metadata says is all that counts."""
    sides = [min(max(side, 1), 65536) for side in size]
    camera = Camera([[100.0, 0, 0], [0, 100.0, 0], [0, 0, 1]], np.eye(4), sides[1], sides[0])
    planes = range(12 + 3 * (degree + 1) ** 2) if planes is None else planes
    fixed = struct.pack("<2I2B2x2f32x", *size, degree, flags, *depths)
    extras = [NewSection(b"EXAC", n, fixed + tail) for n in range(layers)]
    channels = [ChannelRecord(PlaneClass.EXACT, target, 0, 0.0, 0.0, Picture.each_of([b"x"])) for target in planes]
    rows = [(layer, channel) for layer in range(layers) for channel in channels]
    return write_container(Head([camera], np.zeros(3), "max", 0.0), extras, rows, layers)


@pytest.mark.parametrize(
    ("accepted", "refused", "words"),
    [
        ({"size": (1, 1)}, {"size": (0, 1)}, "grid 1 0"),
        ({"size": (1, 65536)}, {"size": (1, 65537)}, "grid 65537 1"),
        ({"degree": 4}, {"degree": 5}, "SH degree 5"),
        ({"depths": (2.0, 2.0)}, {"depths": (2.1, 2.0)}, "EXAC[0]"),
        ({"depths": (1.1e-30, 2.0)}, {"depths": (0.9e-30, 2.0)}, "EXAC[0]"),
        ({"planes": range(15)}, {"planes": range(14)}, "14 15"),
        ({}, {"planes": [*range(14), 13]}, "PICT[0]"),
        ({"flags": 2, "tail": _columns(9, 9, 1, 1, 0)}, {"flags": 4}, "unknown flags 0x4"),
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
