"""Unit, attribution and licence: carried through every format with room for them, and never trusted."""

import json
import struct
from pathlib import Path

import numpy as np
import plyfile
import pytest
import safetensors
from scenes import make_smooth_gaussians, refusing, tells
from sections import changed_section

import tinysplat_runtime as ts
from tinysplat_runtime.cli import main
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


def with_notes(data: bytes, *fields: tuple[bytes, bytes], tail: bytes = b"") -> bytes:
    """A file with such fields in its section of notes, all lengths and checksums right."""

    def change(text: bytearray) -> None:
        text[:] = b"".join(struct.pack("<BH", len(name), len(note)) + name + note for name, note in fields) + tail

    return changed_section(data, b"NOTE", change)


@pytest.mark.parametrize(
    ("fields", "tail", "words"),
    [
        ([(b"unit", bytes(33))], b"", "unit"),
        ([(b"unit", b"x" * 33)], b"", "unit 33 32"),
        ([(b"attribution", b"\xff\xfe")], b"", "UTF-8"),
        ([(b"licence", b"\x1b[31m")], b"", "licence U+001B"),
        ([(b"refined", b"x" * 129)], b"", "refined 129 128"),
        ([(b"antialiased", b"no")], b"", "antialiased"),
        ([(b"unit", b"m"), (b"unit", b"m")], b"", "unit twice"),
        ([(b"Unit", b"m")], b"", "a to z"),
        ([(b"", b"m")], b"", "a to z"),
        ([(b"later", b"\xff")], b"", "UTF-8"),
        ([(bytes([97 + n // 26, 97 + n % 26]), b"") for n in range(65)], b"", "64"),
        ([(b"unit", b"m")], b"\0\0", "needs 3 bytes"),
        ([(b"unit", b"m")], b"\1\2\0a", "needs 2 bytes"),
    ],
)
def test_hostile_sections_are_refused(coded: bytes, fields: list[tuple[bytes, bytes]], tail: bytes, words: str) -> None:
    with refusing(ts.FormatError, f"NOTE {words}"):
        ts.decompress(with_notes(coded, *fields, tail=tail))


def test_names_that_are_not_known_are_skipped(coded: bytes) -> None:
    found = ts.decompress(with_notes(coded, (b"later", b"\x1b"), (b"unit", b"metre"), (b"licence", b"")))
    assert found.notes == ts.Notes(unit="metre")


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


def test_what_was_done_to_a_scene_is_noted_too(gaussians: ts.Gaussians, coded: bytes) -> None:
    done = ts.Notes(refined="20 steps on 4 photos: 24.1 to 27.9 dB", antialiased="yes", pruned="9 of 99 left out")
    data = ts.compress(gaussians.with_notes(done), "fast")
    assert ts.decompress(data).notes == done
    names = "refined", "antialiased", "pruned"
    assert [ts.inspect(data)[name] for name in names] == [done.refined, True, done.pruned]
    assert [ts.inspect(coded)[name] for name in names] == [None, False, None]
