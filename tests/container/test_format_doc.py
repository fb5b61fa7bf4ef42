"""docs/FORMAT.md says what the code does: its tables are the structures, its example a file, decoded here by hand."""

import re
import struct
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest
from golden.cases import DATA

import tinysplat_runtime as ts
from tinysplat_runtime.container import layout as L
from tinysplat_runtime.container.exact import EXACT_FIXED
from tinysplat_runtime.container.list import LIST_FIXED, TIER_FIXED
from tinysplat_runtime.container.notes import NOTE_FIXED
from tinysplat_runtime.container.photos import GROUP_FIXED, GROUP_VIEW, PHOTOS_FIXED
from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.gaussian.notes import MAX_BYTES
from tinysplat_runtime.gaussian.planes import CODING_ORDER, GEOMETRY, PlaneClass

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "FORMAT.md").read_text("utf-8")
_HEADING = "| offset | type | field | meaning |"


def _size(kind: str) -> int:
    """Bytes of a field's type, such as `u16`, `3 f64` or `bytes 8`."""
    match = re.fullmatch(r"(?:(\d+) )?[uf](\d+)|(?:bytes|ASCII) (\d+)", kind)
    assert match, kind
    return int(match[3]) if match[3] else int(match[1] or 1) * int(match[2]) // 8


def _tables() -> list[list[tuple[int, int]]]:
    tables = []
    for block in TEXT.split(_HEADING)[1:]:
        rows = []
        for line in block.splitlines()[2:]:
            if not line.startswith("|"):
                break
            offset, kind = (cell.strip() for cell in line.split("|")[1:3])
            rows.append((int(offset), _size(kind)))
        tables.append(rows)
    return tables


STRUCTURES = {
    "header": L.HEADER,
    "row": L.TABLE_ROW,
    "PICT": L.PICTURES_FIXED,
    "channel": L.CHANNEL,
    "stream": L.STREAM,
    "SCEN": L.SCENE_FIXED,
    "NOTE": NOTE_FIXED,
    "LAYR": L.LAYER_FIXED,
    "EXAC": EXACT_FIXED,
    "PHOT": PHOTOS_FIXED,
    "group": GROUP_FIXED,
    "group's view": GROUP_VIEW,
    "LIST": LIST_FIXED,
    "TIER": TIER_FIXED,
}
"""In the order of the page's tables."""


@pytest.mark.parametrize(("number", "fields"), list(enumerate(STRUCTURES.values())), ids=list(STRUCTURES))
def test_every_table_describes_its_structure_without_gaps(number, fields):
    end = 0
    for offset, size in _tables()[number]:
        assert offset == end
        end += size
    assert end == fields.size and len(_tables()) == len(STRUCTURES)


def test_the_table_of_classes_is_the_code_s():
    lines = TEXT.split("| class | number | mode | channels | pass | largest |")[1].splitlines()[2:11]
    for c, line in zip(PlaneClass, lines, strict=True):
        label, value, _, channels, passes, largest = (cell.strip() for cell in line.strip("|").split("|"))
        assert (label, int(value)) == (c.label, c)
        if c in CODING_ORDER:
            assert float(largest) == c.facts.largest
            assert set(re.findall(r"\d+", passes)) >= set(map(str, c.facts.passes))
        if c in GEOMETRY:
            assert int(re.findall(r"\d+", channels.split(";")[0])[-1]) == GEOMETRY[c].stop - GEOMETRY[c].start - 1


def test_flags_and_notes_are_the_code_s():
    for name in ("INVERSE_DEPTH", "OWN_INTRINSICS", "RELATIVE_ROTATION", "SCALE_MIX", "BASIS"):
        value = re.search(rf"\| (\d+) \| (\d+) \| {name} \|", TEXT)
        assert value and int(value[2]) == getattr(L, name) == 1 << int(value[1])
    assert {
        name: int(size) for name, size in re.findall(r"^\| `([a-z]+)` \| (\d+) \|", TEXT, re.MULTILINE)
    } == MAX_BYTES


def _example() -> bytes:
    lines = re.findall(r"^([0-9a-f]{6})  ((?:[0-9a-f]{2} )+) ", TEXT, flags=re.MULTILINE)
    data = b""
    for start, digits in lines:
        assert int(start, 16) == len(data)
        data += bytes.fromhex(digits)
    return data


def test_the_example_decodes_by_hand():
    """With nothing but the page: header, sections, columns, rows, and section 4."""
    data = _example()
    assert data == (DATA / "example.tsplat").read_bytes()
    magic, major, _, count, _, crc = struct.unpack_from("<8sHHHHI", data)
    assert (magic, major, crc) == (b"\x89TSPLAT\n", 1, crc32(data[:16] + data[20 : 20 + 16 * count]))
    sections, end = {}, 20 + 16 * count
    for row in range(count):
        kind, _, index, length, own = struct.unpack_from("<4sHHII", data, 20 + 16 * row)
        sections[kind], end = data[end : end + length], end + length
        assert index == 0 and crc32(sections[kind]) == own
    assert end == len(data) and kind == b"DATA"
    cameras, layers, _, *origin = struct.unpack_from("<HHf3d", sections[b"SCEN"])
    assert (cameras, layers) == (1, 1)
    camera, at = [], 0
    for _ in range(19):
        form = sections[b"CAMS"][at]
        camera += struct.unpack_from("<f" if form & 2 else "<d", sections[b"CAMS"], at + 1)
        at += 5 if form & 2 else 9
    fx, fy, cx, cy, skew, width, height, *c2w = camera
    grid = struct.unpack_from("<IIBBBBH2f", sections[b"LAYR"])
    assert grid == (height, width, 0, 0, 0, 0, 0, 2, 2)
    rows, views, order = struct.unpack_from("<HHH", sections[b"PICT"])
    assert (views, order, len(sections[b"PICT"])) == (1, 0, 6 + 12 * rows)
    channels = np.zeros((6, 4))
    for row in range(rows):
        layer, number, target, qp, _, offset = struct.unpack_from("<BBBBff", sections[b"PICT"], 6 + 12 * row)
        assert layer == 0 and qp == 255
        channels[number, target] += offset
    depth, color, opacity, scale, rotation, offsets = channels
    z = min(max(depth[0], 2), 2)
    y = (offsets[1] + 0.5 - cy) / fy
    x = (offsets[0] + 0.5 - cx - skew * y) / fx
    R, c = np.reshape(c2w, (3, 4))[:, :3], np.reshape(c2w, (3, 4))[:, 3]
    np.testing.assert_array_equal(R, np.eye(3))
    by_hand = {
        "means": R @ [x * z, y * z, z] + (c - origin),
        "quats": rotation / np.linalg.norm(rotation),
        "scales": np.maximum(scale[:3], 0) * z / np.sqrt(fx * fy),
        "opacities": np.clip(opacity[:1], 0, 1),
        "sh": color[:3],
    }
    decoded = ts.decompress(data)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(decoded, name).ravel(), by_hand[name])
        for number in by_hand[name][by_hand[name] != 0]:
            assert f"{number:g}".replace("-", "−") in TEXT.split("By section 4:")[1]
