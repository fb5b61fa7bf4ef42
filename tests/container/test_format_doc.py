"""docs/FORMAT.md says what the code does: its tables are the structures, its dump is the golden file."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from golden.cases import DATA

from tinysplat_runtime.container import layout as L
from tinysplat_runtime.container.exact import EXACT_FIXED
from tinysplat_runtime.container.free import FREE_FIXED, TIER_FIXED
from tinysplat_runtime.container.notes import NOTES_FIXED
from tinysplat_runtime.container.photos import GROUP_FIXED, GROUP_VIEW, GROUPS_FIXED, NETWORK_FIXED, PHOTOS_FIXED
from tinysplat_runtime.gaussian.planes import CODING_ORDER, GEOMETRY

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "FORMAT.md").read_text("utf-8")
_HEADING = "| offset | bytes | field | type | meaning and range | a reader must |"


def _tables() -> list[list[tuple[int, int, str]]]:
    tables = []
    for block in TEXT.split(_HEADING)[1:]:
        rows = []
        for line in block.splitlines()[2:]:
            if not line.startswith("|"):
                break
            offset, size, field = (cell.strip() for cell in line.split("|")[1:4])
            rows.append((int(offset), int(size), field))
        tables.append(rows)
    return tables


STRUCTURES = {
    "header": L.HEADER,
    "row": L.TABLE_ROW,
    "SCEN": L.SCENE_FIXED,
    "CAMS": L.CAMERA,
    "LAYR": L.LAYER_FIXED,
    "channel": L.CHANNEL,
    "stream": L.STREAM,
    "UNIT": L.UNITS_FIXED,
    "unit's picture": L.UNIT_PICTURE,
    "VIEW": L.VIEW_HEAD,
    "NETW": NETWORK_FIXED,
    "GRPS": GROUPS_FIXED,
    "group": GROUP_FIXED,
    "group's view": GROUP_VIEW,
    "PHOT": PHOTOS_FIXED,
    "EXAC": EXACT_FIXED,
    "NOTE": NOTES_FIXED,
    "FREE": FREE_FIXED,
    "TIER": TIER_FIXED,
}
"""In the order of the page's tables."""


@pytest.mark.parametrize(("number", "fields"), list(enumerate(STRUCTURES.values())), ids=list(STRUCTURES))
def test_every_table_describes_its_structure_without_gaps(number, fields):
    table = _tables()[number]
    end = 0
    for offset, size, _ in table:
        assert offset == end
        end += size
    assert end == fields.size


def test_the_table_of_plane_classes_is_the_code_s():
    lines = TEXT.split("| class | number | section | channels | pass | largest |")[1].splitlines()[2:8]
    for c, line in zip(CODING_ORDER, lines, strict=True):
        label, value, section, channels, passes, largest = (cell.strip() for cell in line.strip("|").split("|"))
        assert (label, int(value), section.encode()) == (c.label, c, b"`%b`" % c.facts.section)
        assert float(largest) == c.facts.largest
        assert set(re.findall(r"\d+", passes)) >= set(map(str, c.facts.passes))
        if c in GEOMETRY:
            assert int(channels.split()[-1]) == GEOMETRY[c].stop - GEOMETRY[c].start - 1
    names = re.findall(r"`(\w{4})`", next(line for line in TEXT.splitlines() if line.startswith("| `DEPT`")))
    assert [name.encode() for name in names] == [c.facts.section for c in CODING_ORDER]


def test_flags_have_their_documented_values():
    for name in ("INVERSE_DEPTH", "OWN_INTRINSICS", "RELATIVE_ROTATION", "SCALE_MIX", "BASIS"):
        value = re.search(rf"\| (\d+) \| (\d+) \| {name} \|", TEXT)
        assert value and int(value[2]) == getattr(L, name) == 1 << int(value[1])


def test_the_hex_dump_is_the_golden_file():
    data = (DATA / "tiny_paper.tsplat").read_bytes()
    lines = re.findall(r"^([0-9a-f]{6})  ((?:[0-9a-f]{2} )+) ", TEXT, flags=re.MULTILINE)
    assert len(lines) > 8
    for start, digits in lines:
        raw = bytes.fromhex(digits)
        at = int(start, 16)
        assert data[at : at + len(raw)] == raw
