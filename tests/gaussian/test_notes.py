"""Unit, attribution and licence: carried through every format with room for them, and never trusted."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import plyfile
import pytest
import safetensors
from scenes import make_smooth_gaussians, refusing, tells
from sections import file_of, sections_of

import tinysplat_runtime as ts
from tinysplat_runtime.cli import main
from tinysplat_runtime.container import layout as L
from tinysplat_runtime.gaussian.editing import merge, similarity
from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.gaussian.notes import MAX_BYTES

NOTES = ts.Notes("metre", 'Jörg "J" Müller, cropped \\ here', "CC-BY-4.0")


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


def test_notes_stand_where_other_programs_look(gaussians: ts.Gaussians, tmp_path: Path) -> None:
    for suffix in (".npz", ".safetensors", ".ply"):
        ts.save_gaussians(tmp_path / f"g{suffix}", gaussians)
    comments = plyfile.PlyData.read(tmp_path / "g.ply").comments
    assert "licence: CC-BY-4.0" in comments and all(line.isascii() for line in comments)
    with safetensors.safe_open(tmp_path / "g.safetensors", framework="numpy") as file:
        assert file.metadata()["attribution"] == NOTES.attribution
    assert json.loads(np.load(tmp_path / "g.npz")["notes"].tobytes())["unit"] == "metre"


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
    said = capsys.readouterr().err
    assert tells(said, "--licence: U+000A") and said.count("\n") == 1


@pytest.mark.parametrize("text", ["a\x1b[31mb", "a\u202eb", "a\u2028b", "a\0b", "\ud800"])
def test_text_that_could_steer_a_terminal_is_refused(text: str) -> None:
    with pytest.raises(ts.InputError) as caught:
        ts.Notes(attribution=text)
    assert caught.value.where == "attribution" and str(caught.value).isprintable()


@pytest.mark.parametrize(("name", "most"), [(n, m) for n, m in MAX_BYTES.items() if n != "antialiased"])
def test_a_note_may_be_as_long_as_its_field_and_no_longer(name: str, most: int) -> None:
    assert ts.Notes(**{name: "é" * (most // 2)}).given() == {name: "é" * (most // 2)}
    with refusing(ts.InputError, f"{most + 1} {most}") as caught:
        ts.Notes(**{name: "x" * (most + 1)})
    assert caught.value.where == name


def with_section(data: bytes, kind: bytes, text: bytes) -> bytes:
    """A file with other bytes in a section, all lengths and checksums right."""
    return file_of([[*section[:3], text if section[0] == kind else section[3]] for section in sections_of(data)])


@pytest.mark.parametrize(
    ("section", "words"),
    [
        (struct.pack("<HHH", 33, 0, 0) + bytes(33), "unit of 33 bytes, at most 32"),
        (struct.pack("<HHH", 0, 65535, 0), "attribution of 65535 bytes"),
        (struct.pack("<HHH", 0, 4, 0) + b"ab", "needs 4 bytes, 2 remain"),
        (struct.pack("<HHH", 0, 2, 0) + b"abc", "1 bytes too many"),
        (struct.pack("<HHH", 0, 2, 0) + b"\xff\xfe", "attribution is not UTF-8"),
        (struct.pack("<HHH", 0, 0, 5) + b"\x1b[31m", "licence: holds U+001B"),
        (b"\0\0", "needs 6 bytes"),
    ],
)
def test_hostile_sections_are_refused(coded: bytes, section: bytes, words: str) -> None:
    with refusing(ts.FormatError, f"NOTE {words}"):
        ts.decompress(with_section(coded, b"NOTE", section))


def test_hostile_notes_of_other_formats_are_refused(gaussians: ts.Gaussians, tmp_path: Path) -> None:
    ply, npz = tmp_path / "g.ply", tmp_path / "g.npz"
    ts.save_gaussians(ply, gaussians)
    data = ply.read_bytes()
    ply.write_bytes(data.replace(b"licence: CC-BY-4.0", b"licence: \\u001b[31m"))
    with refusing(ts.InputError, f"{ply} licence U+001B"):
        ts.load_gaussians(ply)
    arrays = {name: getattr(gaussians, name) for name in FIELDS}
    np.savez(npz, **arrays, notes=np.frombuffer(b'{"unit": 3}', np.uint8))
    with refusing(ts.InputError, f"{npz}"):
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


def test_a_coded_file_keeps_the_mark_in_a_section_of_its_own(gaussians: ts.Gaussians, coded: bytes) -> None:
    marked = ts.compress(gaussians.with_notes(replace(NOTES, antialiased="yes")), "fast")
    assert ts.decompress(marked).notes == replace(NOTES, antialiased="yes")
    assert len(marked) == len(coded) + L.TABLE_ROW.size + 3
    assert (ts.inspect(marked)["version"], ts.inspect(marked)["antialiased"]) == ("1.3", True)
    assert ts.inspect(coded)["antialiased"] is False
    for text in (b"", b"no", b"YES", b"yess", b"\xff"):
        with pytest.raises(ts.FormatError, match="ANTI"):
            ts.inspect(with_section(marked, b"ANTI", text))
