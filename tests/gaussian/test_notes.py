"""Unit, attribution and licence: carried through every format with room for them, and never trusted."""

from __future__ import annotations

import gzip
import json
import struct
from dataclasses import replace
from pathlib import Path
from zlib import crc32

import numpy as np
import plyfile
import pytest
import safetensors
from golden_cases import DATA
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.cli import main
from tinysplat_runtime.container import layout as L
from tinysplat_runtime.container.notes import note_sections
from tinysplat_runtime.gaussian.editing import merge, similarity
from tinysplat_runtime.gaussian.gaussians import FIELDS

NOTES = ts.Notes("metre", 'Jörg "J" Müller, cropped \\ here', "CC-BY-4.0")


ADDED_BYTES = sum(L.TABLE_ROW.size + len(section.data) for section in note_sections(NOTES))


@pytest.fixture(scope="module")
def gaussians() -> ts.Gaussians:
    return make_smooth_gaussians(2, 20, 24, degree=1).with_notes(NOTES)


@pytest.fixture(scope="module")
def coded(gaussians: ts.Gaussians) -> bytes:
    return ts.compress(gaussians, "fast")


@pytest.mark.parametrize("options", [{}, {"lossless": True}, {"target_size": 6000}])
def test_a_file_carries_notes_in_every_mode(gaussians: ts.Gaussians, options: dict[str, int]) -> None:
    data = ts.compress(gaussians, **options)
    assert ts.decompress(data).notes == NOTES
    assert ts.inspect(data)["notes"] == {"unit": "metre", "attribution": NOTES.attribution, "licence": "CC-BY-4.0"}
    assert len(data) <= options.get("target_size", len(data))


def test_notes_change_nothing_else(gaussians: ts.Gaussians, coded: bytes) -> None:
    plain = ts.compress(gaussians.with_notes(ts.Notes()), "fast")
    assert len(coded) == len(plain) + ADDED_BYTES
    described, before = ts.inspect(coded), ts.inspect(plain)
    assert (before["version"], described["version"]) == ("1.0", "1.1")
    assert described["planes"] == before["planes"] and described["bytes_by_class"] == before["bytes_by_class"]
    for prefix in described["prefixes"]:
        np.testing.assert_array_equal(
            ts.decompress(coded, max_bytes=prefix["bytes"]).means,
            ts.decompress(plain, max_bytes=prefix["bytes"] - ADDED_BYTES).means,
        )


def test_golden_files_have_none_and_stay_as_they_are() -> None:
    data = (DATA / "tiny_paper.tsplat").read_bytes()
    assert not ts.decompress(data).notes and note_sections(ts.Notes()) == []


@pytest.mark.parametrize("suffix", [".npz", ".safetensors", ".ply"])
def test_formats_with_room_keep_notes(gaussians: ts.Gaussians, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"g{suffix}"
    assert ts.save_gaussians(path, gaussians) == []
    assert ts.load_gaussians(path).notes == NOTES
    ts.save_gaussians(path, gaussians.with_notes(ts.Notes()))
    assert not ts.load_gaussians(path).notes


def test_notes_stand_where_other_programs_look(gaussians: ts.Gaussians, tmp_path: Path) -> None:
    for suffix in (".npz", ".safetensors", ".ply"):
        ts.save_gaussians(tmp_path / f"g{suffix}", gaussians)
    comments = plyfile.PlyData.read(tmp_path / "g.ply").comments
    assert "licence: CC-BY-4.0" in comments and all(line.isascii() for line in comments)
    with safetensors.safe_open(tmp_path / "g.safetensors", framework="numpy") as file:
        assert file.metadata()["attribution"] == NOTES.attribution
    assert json.loads(np.load(tmp_path / "g.npz")["notes"].tobytes())["unit"] == "metre"


def test_formats_without_room_say_what_they_leave_out(gaussians: ts.Gaussians, tmp_path: Path) -> None:
    notes = ts.save_gaussians(tmp_path / "g.spz", gaussians)
    assert "unit and attribution and licence left out, .spz has no room for text" in notes


def test_movements_keep_notes_and_a_change_of_scale_drops_the_unit(gaussians: ts.Gaussians) -> None:
    assert similarity(gaussians, translation=(1, 0, 0)).notes == NOTES
    assert similarity(gaussians, scale=2.0).notes == ts.Notes("", NOTES.attribution, NOTES.licence)


def test_joined_scenes_name_all_who_made_them(gaussians: ts.Gaussians) -> None:
    other = gaussians.with_notes(ts.Notes("foot", "Ana", "MIT OR Apache-2.0"))
    assert merge([gaussians, gaussians]).notes == NOTES
    assert merge([gaussians, other]).notes == ts.Notes(
        "", f"{NOTES.attribution}; Ana", "CC-BY-4.0 AND (MIT OR Apache-2.0)"
    )


def test_the_commands_take_show_and_hand_on_notes(
    gaussians: ts.Gaussians, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    raw, coded, out = (str(tmp_path / name) for name in ("g.npz", "g.tsplat", "g.ply"))
    ts.save_gaussians(raw, gaussians)
    assert main(["compress", raw, "-o", coded, "--profile", "fast", "--licence", "MIT", "--unit", ""]) == 0
    assert main(["info", coded]) == 0
    shown = capsys.readouterr().out
    assert "licence: MIT" in shown and f"attribution: {NOTES.attribution}" in shown and "unit:" not in shown
    assert main(["decode", coded, "-o", out]) == 0
    assert main(["convert", out, "-o", out, "--force", "--scale", "2", "--unit", "half-metre"]) == 0
    assert ts.load_gaussians(out).notes == ts.Notes("half-metre", NOTES.attribution, "MIT")
    capsys.readouterr()
    assert main(["convert", out, "-o", out, "--force", "--licence", "a\nb"]) == 2
    assert capsys.readouterr().err == (
        "tinysplat: --licence: holds U+000A, expected characters that print, in one line\n"
    )


@pytest.mark.parametrize("text", ["a\x1b[31mb", "a\u202eb", "a\u2028b", "a\0b", "\ud800"])
def test_text_that_could_steer_a_terminal_is_refused(text: str) -> None:
    with pytest.raises(ts.InputError, match=r"attribution: holds U\+"):
        ts.Notes(attribution=text)


def rewritten(coded: bytes, section: bytes) -> bytes:
    """The file with another NOTE section and right checksums."""
    count = L.HEADER.unpack_from(coded)[3]
    start = L.HEADER.size
    rows = [list(L.TABLE_ROW.unpack_from(coded, start + i * L.TABLE_ROW.size)) for i in range(count)]
    at = start + count * L.TABLE_ROW.size
    bodies = []
    for row in rows:
        bodies.append(section if row[0] == b"NOTE" else coded[at : at + row[3]])
        at += row[3]
        row[3:] = [len(bodies[-1]), crc32(bodies[-1]) if row[0] == b"NOTE" else row[4]]
    table = b"".join(L.TABLE_ROW.pack(*row) for row in rows)
    head = coded[: start - 4]
    return head + crc32(head + table).to_bytes(4, "little") + table + b"".join(bodies)


@pytest.mark.parametrize(
    ("section", "words"),
    [
        (struct.pack("<HHH", 33, 0, 0) + bytes(33), "unit of 33 bytes, at most 32"),
        (struct.pack("<HHH", 0, 65535, 0), "attribution of 65535 bytes"),
        (struct.pack("<HHH", 0, 4, 0) + b"ab", "needs 4 bytes, 2 remain"),
        (struct.pack("<HHH", 0, 2, 0) + b"abc", "1 bytes too many"),
        (struct.pack("<HHH", 0, 2, 0) + b"\xff\xfe", "attribution is not UTF-8"),
        (struct.pack("<HHH", 0, 0, 5) + b"\x1b[31m", "licence: holds U\\+001B"),
        (b"\0\0", "needs 6 bytes"),
    ],
)
def test_hostile_sections_are_refused(coded: bytes, section: bytes, words: str) -> None:
    with pytest.raises(ts.FormatError, match=f"section NOTE.*{words}"):
        ts.decompress(rewritten(coded, section))


def test_hostile_notes_of_other_formats_are_refused(gaussians: ts.Gaussians, tmp_path: Path) -> None:
    ply, npz = tmp_path / "g.ply", tmp_path / "g.npz"
    ts.save_gaussians(ply, gaussians)
    data = ply.read_bytes()
    ply.write_bytes(data.replace(b"licence: CC-BY-4.0", b"licence: \\u001b[31m"))
    with pytest.raises(ts.InputError, match=r"g\.ply: licence: holds U\+001B"):
        ts.load_gaussians(ply)
    arrays = {name: getattr(gaussians, name) for name in FIELDS}
    for text, words in ((b"[]", "not a JSON object"), (b"{", "not JSON"), (b'{"unit": 3}', "unit: a int")):
        np.savez(npz, **arrays, notes=np.frombuffer(text, np.uint8))
        with pytest.raises(ts.InputError, match=words):
            ts.load_gaussians(npz)
    np.savez(npz, **arrays, notes=np.zeros(10**6, np.uint8))
    with pytest.raises(ts.InputError, match="notes: more than"):
        ts.load_gaussians(npz)


def test_how_a_scene_was_refined_has_a_section_of_its_own(gaussians: ts.Gaussians, coded: bytes) -> None:
    refined = replace(NOTES, refined="20 steps on 4 photos: 24.1 to 27.9 dB")
    both = ts.compress(gaussians.with_notes(refined), "fast")
    assert ts.decompress(both).notes == refined and ts.inspect(both)["refined"] == refined.refined
    assert len(both) == len(coded) + L.TABLE_ROW.size + len(refined.refined)
    assert (ts.inspect(both)["version"], ts.inspect(coded)["refined"]) == ("1.2", None)
    alone = ts.compress(gaussians.with_notes(ts.Notes(refined="5 steps")), "fast")
    assert ts.decompress(alone).notes == ts.Notes(refined="5 steps") and b"NOTE" not in alone


@pytest.mark.parametrize("text", [b"", b"x" * 129, b"\xff", b"a\x1b[31m"])
def test_a_refinement_that_is_no_short_line_is_refused(gaussians: ts.Gaussians, text: bytes) -> None:
    data = ts.compress(gaussians.with_notes(ts.Notes(refined="5 steps")), "fast")
    with pytest.raises(ts.FormatError, match="REFI"):
        ts.inspect(with_section(data, b"REFI", text))


@pytest.mark.parametrize(
    "name",
    ["g.npz", "g.safetensors", "g.ply", "g.compressed.ply", "g.spz", "g.sog", "meta.json", "g.glb", "g.gltf", "g.usda"],
)
def test_every_format_keeps_the_mark_of_antialiased_gaussians(
    gaussians: ts.Gaussians, tmp_path: Path, name: str
) -> None:
    for mark in ("yes", ""):
        assert not any("antialiased" in line for line in ts.save_gaussians(
            tmp_path / name, gaussians.with_notes(ts.Notes(antialiased=mark))))  # fmt: skip
        assert ts.load_gaussians(tmp_path / name).notes == ts.Notes(antialiased=mark)


@pytest.mark.parametrize("version", [2, 3, 4])
def test_the_mark_is_the_flag_of_spz(gaussians: ts.Gaussians, tmp_path: Path, version: int) -> None:
    marked, plain = tmp_path / "marked.spz", tmp_path / "plain.spz"
    ts.save_gaussians(marked, gaussians.with_notes(ts.Notes(antialiased="yes")), spz_version=version)
    ts.save_gaussians(plain, gaussians.with_notes(ts.Notes()), spz_version=version)
    one, other = (gzip.decompress(p.read_bytes()) if version < 4 else p.read_bytes() for p in (marked, plain))
    assert [(at, a, b) for at, (a, b) in enumerate(zip(one, other, strict=True)) if a != b] == [(14, 1, 0)]
    assert ts.load_gaussians(marked).notes.antialiased == "yes" and not ts.load_gaussians(plain).notes


@pytest.mark.parametrize(
    ("comments", "mark"),
    [
        (["SplatRenderMode: mip"], "yes"), (["antialiased 1"], "yes"), (["SplatRenderMode: default"], ""),
        (["antialiased 1", "SplatRenderMode: default"], ""), (["not antialiased 1"], ""), ([], ""),
    ],
)  # fmt: skip
def test_marks_of_other_programs_are_read(
    gaussians: ts.Gaussians, tmp_path: Path, comments: list[str], mark: str
) -> None:
    """As PlayCanvas' splat-transform reads them: Brush's word and Postshot's, the last one holds."""
    ts.save_gaussians(tmp_path / "g.ply", gaussians.with_notes(ts.Notes()))
    data = plyfile.PlyData.read(tmp_path / "g.ply")
    data.comments = comments
    data.write(tmp_path / "other.ply")
    assert ts.load_gaussians(tmp_path / "other.ply").notes.antialiased == mark


def test_a_coded_file_keeps_the_mark_in_a_section_of_its_own(gaussians: ts.Gaussians, coded: bytes) -> None:
    marked = ts.compress(gaussians.with_notes(replace(NOTES, antialiased="yes")), "fast")
    assert ts.decompress(marked).notes == replace(NOTES, antialiased="yes")
    assert len(marked) == len(coded) + L.TABLE_ROW.size + 3
    assert (ts.inspect(marked)["version"], ts.inspect(marked)["antialiased"]) == ("1.3", True)
    assert ts.inspect(coded)["antialiased"] is False
    for text in (b"", b"no", b"YES", b"yess", b"\xff"):
        with pytest.raises(ts.FormatError, match="ANTI"):
            ts.inspect(with_section(marked, b"ANTI", text))


def with_section(data: bytes, kind: bytes, text: bytes) -> bytes:
    """A file with other bytes in a section, all lengths and checksums right."""
    header = L.HEADER.unpack_from(data)
    end, rows, bodies = L.HEADER.size + header[3] * L.TABLE_ROW.size, [], []
    at = end
    for row in range(header[3]):
        found, flags, index, length, crc = L.TABLE_ROW.unpack_from(data, L.HEADER.size + row * L.TABLE_ROW.size)
        body = text if found == kind else data[at : at + length]
        at += length
        rows.append(L.TABLE_ROW.pack(found, flags, index, len(body), crc32(body) if found == kind else crc))
        bodies.append(body)
    head = L.HEADER.pack(*header[:-1], 0)[:-4]
    table = b"".join(rows)
    return b"".join([head, struct.pack("<I", crc32(head + table)), table, *bodies])


@pytest.mark.parametrize(
    ("field", "most"), [("unit", 32), ("attribution", 1024), ("licence", 128), ("refined", 128), ("thinned", 128)]
)
def test_text_is_as_long_as_its_field_may_be_in_utf_8(field: str, most: int) -> None:
    assert len(getattr(ts.Notes(**{field: "é" * (most // 2)}), field)) == most // 2
    with pytest.raises(ts.InputError, match=f"{most + 1} bytes of UTF-8, expected at most {most}") as caught:
        ts.Notes(**{field: "é" * (most // 2) + "x"})
    assert caught.value.where == field


def test_marks_and_types_of_notes_are_checked() -> None:
    assert ts.Notes(antialiased="yes") and not ts.Notes(antialiased="")
    for wrong, words in (
        ("no", "'no', expected 'yes' or nothing"),
        ("yess", "4 bytes"),
        (None, "a NoneType, expected text"),
    ):
        with pytest.raises(ts.InputError, match=words) as caught:
            ts.Notes(antialiased=wrong)  # type: ignore[arg-type]
        assert caught.value.where == "antialiased"


def test_licences_of_several_are_all_to_be_kept() -> None:
    parts = [
        ts.Notes("m", "A", "MIT OR Apache-2.0", "r", "yes"),
        ts.Notes("m", "", "CC0-1.0", "r"),
        ts.Notes("m", "A", "CC0-1.0"),
    ]
    found = ts.Notes.joined(parts)
    assert found == ts.Notes("m", "A", "(MIT OR Apache-2.0) AND CC0-1.0")
    assert ts.Notes.joined(parts[:1]) == parts[0]
    assert ts.Notes.joined([parts[1], ts.Notes("cm", "B")]) == ts.Notes("", "B", "CC0-1.0")
    assert found.given() == {"unit": "m", "attribution": "A", "licence": found.licence}
