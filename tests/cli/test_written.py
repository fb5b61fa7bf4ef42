"""What `decode` and `convert` write, and what `compress` and `encode` say of what they wrote."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from types import SimpleNamespace

import console
import numpy as np
import pytest
from scenes import make_free_gaussians, make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.cli import encode, written
from tinysplat_runtime.cli.convert import _rotation
from tinysplat_runtime.cli.files import Reading, Voice, noted
from tinysplat_runtime.cli.written import Selection, Writing, pruned
from tinysplat_runtime.codec.encoder import EncodeStats
from tinysplat_runtime.container.records import Limits
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.editing import cut_degree, drop_transparent, trim_border
from tinysplat_runtime.gaussian.footprints import widened
from tinysplat_runtime.recipe.encode import Encoded
from tinysplat_runtime.system.stopwatch import Stopwatch

READING = Reading(1, None, Limits(), None, False, None)


def same(a: ts.Gaussians, b: ts.Gaussians) -> bool:
    fields = ("means", "quats", "scales", "opacities", "sh")
    return all(np.array_equal(getattr(a.flat(), name), getattr(b.flat(), name)) for name in fields)


def test_a_selection_is_what_its_options_say_in_their_order() -> None:
    g = make_smooth_gaussians(2, 12, 16, degree=2)
    assert Selection().of(g) is g and Selection(trim_border=0).of(g) is g
    assert same(Selection(dilate=0.3).of(g), widened(g, 0.3))
    assert same(Selection(trim_border=2, sh_degree=1).of(g), cut_degree(trim_border(g, 2), 1))
    assert same(Selection(min_opacity=0.5).of(g), drop_transparent(g, 0.5))
    assert Selection(sh_degree=0).of(g).degree == 0
    assert Selection(thins=True).of(g) is g  # of few views


def test_fusing_is_asked_for_with_all_that_it_needs(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    from tinysplat_runtime.refine import fuse

    asked = []

    def fused(gaussians, *, seconds, threads, stats, show):
        asked.append((seconds, threads, list(show(iter(range(2))))))
        stats.rounds[:] = [[30.0], [31.0]]
        return gaussians

    monkeypatch.setattr(fuse, "fused", fused)
    g = make_smooth_gaussians(2, 12, 16)
    assert Selection(fuse=2.5, threads=3).of(g) is g and Selection(fuse=2.5, threads=3, quiet=True).of(g) is g
    assert asked == [(2.5, 3, [0, 1])] * 2
    assert capsys.readouterr().err.count("\n") == 1


def test_what_pruning_left_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    from tinysplat_runtime.prune import reduction

    g, said = make_smooth_gaussians(1, 4, 4), []
    assert pruned(g, None, READING, said.append) is g and said == []
    for text in ("3 of 4", ""):
        monkeypatch.setattr(
            reduction, "leave_out", lambda *given, text=text: SimpleNamespace(text=text, gaussians=given)
        )
        assert pruned(g, "half", READING, said.append) == (g, "half", 1)
    assert said == ["3 of 4, in pictures as defined", "none left out, in pictures as defined"]


@pytest.mark.parametrize("option", ["--prune", "--fuse"])
def test_what_needs_numba_says_which_extra_brings_it(monkeypatch: pytest.MonkeyPatch, option: str) -> None:
    name = {"--prune": "tinysplat_runtime.prune.reduction", "--fuse": "tinysplat_runtime.refine.fuse"}[option]
    monkeypatch.setitem(sys.modules, name, None)
    g = make_smooth_gaussians(1, 4, 4)
    with pytest.raises(InputError) as error:
        _ = pruned(g, "x", READING, print) if option == "--prune" else Selection(fuse=1).of(g)
    assert str(error.value) == f'{option}: needs {name}; pip install "tinysplat[fast]" brings it'


class Coder:
    """Stands for a runtime, and says how it was asked to code."""

    limits = Limits()

    def compress(self, gaussians: ts.Gaussians, *words: object, **options: object) -> bytes:
        return repr((words, options)).encode()


@pytest.mark.parametrize(
    ("mode", "fields", "expected"),
    [
        (None, {}, ((), {"keep_all": False})),
        (None, {"keep_all": True}, ((), {"keep_all": True})),
        ("lossless", {}, ((), {"lossless": True})),
        ("gaussians", {}, "like"),
        ("gaussians", {"turned": True}, ("paper", 3, False)),
        ("gaussians", {"keeps_pixels": False}, ("paper", 3, False)),
        ("gaussians", {"keeps_pixels": False, "keep_all": True}, ("paper", 3, True)),
        ("hybrid", {}, ("paper", 3, False)),
        ("free", {}, ("paper", 3, False)),
    ],
)
def test_a_file_is_coded_like_the_one_that_it_comes_from(tmp_path: Path, monkeypatch, mode, fields, expected) -> None:
    source = tmp_path / "s.tsplat"
    source.write_bytes(b"source")
    monkeypatch.setattr(Reading, "runtime", lambda reading: Coder())
    container = SimpleNamespace(mode=mode, profile="paper", qp=3)
    monkeypatch.setattr(written, "read_container", lambda data, limits: container)
    writing = Writing(READING, source=str(source) if mode else None, **fields)
    if expected == "like":
        expected = ((), {"like": b"source"})
    elif len(expected) == 3:
        expected = (expected[:2], {"keep_all": expected[2]})
    shiny = make_smooth_gaussians(1, 4, 4, degree=1)
    assert writing._coded(shiny) == repr(expected).encode()
    thin = shiny.with_notes(ts.Notes(thinned="3 of 4"))
    assert writing._coded(thin) == repr(expected).replace("all': False", "all': True").encode()


def test_turned_gaussians_of_one_colour_and_cut_ones(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "s.tsplat").write_bytes(b"source")
    monkeypatch.setattr(Reading, "runtime", lambda reading: Coder())
    container = SimpleNamespace(mode="gaussians", profile="paper", qp=3)
    monkeypatch.setattr(written, "read_container", lambda data, limits: container)
    writing = Writing(READING, source=str(tmp_path / "s.tsplat"), turned=True)
    assert b"like" in writing._coded(make_smooth_gaussians(1, 4, 4, degree=0))
    free = make_free_gaussians(9, 0, np.random.default_rng(0))
    assert writing._coded(free) == b"(('paper', 3), {'keep_all': False})"
    container.mode = "lossless"
    assert writing._coded(free) == b"((), {'lossless': False})"


def test_standard_output_gets_the_format_of_its_name(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys) -> None:
    free = make_free_gaussians(9, 0, np.random.default_rng(0))
    ts.save_gaussians(tmp_path / "a.ply", free)
    for name, start in (("-.ply", b"ply"), ("-", b"\x89TSP"), ("-.npz", b"PK")):
        out = io.TextIOWrapper(io.BytesIO(), write_through=True)
        monkeypatch.setattr(sys, "stdout", out)
        Writing(READING).write(name, free)
        assert out.buffer.getvalue()[:4].startswith(start)
        assert start != b"ply" or out.buffer.getvalue() == (tmp_path / "a.ply").read_bytes()


def test_notes_are_put_over_those_there_are_and_errors_name_their_option() -> None:
    g = make_smooth_gaussians(1, 4, 4).with_notes(ts.Notes(unit="metre", licence="CC0-1.0"))
    assert noted(g, {}) is g
    found = noted(g, {"unit": "inch", "attribution": "us"}).notes
    assert (found.unit, found.licence, found.attribution) == ("inch", "CC0-1.0", "us")
    with pytest.raises(InputError, match=r"^--unit: "):
        noted(g, {"unit": "x" * 9000})


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x,90", [[1, 0, 0], [0, 0, -1], [0, 1, 0]]), ("y,90", [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
        ("z,-90", [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]), ("2,0,0,0", np.eye(3)), ("0,0,0,-3", np.diag([-1, -1, 1])),
    ],
)  # fmt: skip
def test_rotations_by_hand(text: str, expected) -> None:
    np.testing.assert_allclose(_rotation(text), expected, atol=1e-15)


@pytest.mark.parametrize(
    "text", ["x", "x,1,2", "w,1", "1,2,3", "1,2,3,4,5", "nan,0,0,1", "x,inf", "0,0,0,0", "1,a,0,0"]
)
def test_what_is_no_rotation_is_refused(text: str) -> None:
    with pytest.raises(InputError) as error:
        _rotation(text)
    assert str(error.value) == f"--rotate: '{text}', expected AXIS,DEGREES such as x,90 or a quaternion w,x,y,z"


def test_voices_speak_beside_the_output_or_not_at_all(capsys: pytest.CaptureFixture[str]) -> None:
    for output, quiet in (("a", False), ("-", False), ("-.ply", False), ("a", True)):
        Voice(output, quiet)(f"{output} {quiet}")
    assert capsys.readouterr() == ("a False\n", "- False\n-.ply False\n")


FREE = "mode free: Gaussians that belong to no pixels; --grid V,H,W and --cameras cameras.json say whose they are"


def coded(**fields: object) -> Encoded:
    """A file of 1000 bytes, coded in 1.25 s."""
    stats = EncodeStats()
    stats.watch.add("code", 1.25)
    for name, value in fields.items():
        setattr(stats, name, value)
    return Encoded(bytes(1000), None, 12_600, stats, None)


@pytest.mark.parametrize(
    ("fields", "lines"),
    [
        ({"mode": "gaussians"}, []),
        ({"mode": "hybrid", "reason": "smaller"}, ["mode hybrid: smaller"]),
        ({"mode": "free"}, [FREE]),
        ({"mode": "free", "left_out": 12345, "left_out_psnr": 56.78},
         ["12,345 Gaussians left out that pictures hardly need: 56.8 dB",
          FREE]),
    ],
)  # fmt: skip
def test_a_file_s_size_mode_and_time_are_said(tmp_path: Path, capsys, fields: dict[str, object], lines) -> None:
    path = str(tmp_path / "f.tsplat")
    encode._write(Voice(path, False), coded(**fields), None, ts.Runtime(threads=1), model=None)
    out = capsys.readouterr().out.splitlines()
    assert out[0].startswith(f"{path}: 1000 bytes, 1/13 of the raw Gaussians, 1.2") and out[1:] == lines
    assert Path(path).read_bytes() == bytes(1000)


def test_encode_ends_with_what_there_is_and_warns_where_it_looks_wrong(capsys: pytest.CaptureFixture[str]) -> None:
    camera = SimpleNamespace(width=64, height=48)
    photos = SimpleNamespace(frames=[1, 2, 3], cameras=[camera, None], path="desk")
    for psnr, doubts, warned in (
        (27.04, [], ""), (20.0, [], ""),
        (12.34, ["units"], "desk: warning: 12.3 dB is low; likely cause: units\n"),
        (19.9, [], "desk: warning: 19.9 dB is low; likely cause: none of the known (units, w2c, axes, overlap);"
                   " photos may differ in light or time\n"),
    ):  # fmt: skip
        one = SimpleNamespace(photos=photos, data=bytes(77), seconds=2.06, doubts=doubts)
        encode._report_own(Voice("f.tsplat", False), one, 999, psnr)
        out, err = capsys.readouterr()
        assert out == f"3 views of 64x48, 999 Gaussians, 77 bytes, 2.1 s; {psnr:.1f} dB at its own photos\n"
        assert err == warned


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ("--mode photos", "--mode: 'photos' needs photos, and Gaussians come with none; use encode"),
        ("--refine 2", "--refine: needs --photos SCENE too"),
        ("--photos desk", "--photos: needs --refine STEPS too"),
        ("--grid 1,2", "--grid: 1,2, expected V,H,W of 1 or more"),
    ],
)
def test_compress_says_what_goes_with_what(tmp_path: Path, words: str, line: str) -> None:
    done = console.fail("compress", "g.npz", "-o", tmp_path / "f.tsplat", *words.split())
    assert done == f"tinysplat: {line}\n"


def test_compress_refines_by_photos_and_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from tinysplat_runtime.scene.intake import layouts

    g, asked = make_smooth_gaussians(1, 8, 8, degree=0), []
    ts.save_gaussians(tmp_path / "g.npz", g)
    monkeypatch.setattr(layouts, "load_scene", lambda path: f"scene {path}")

    def refine(gaussians, scene, budget, coding, runtime, *, stats, show):
        asked.append((scene, budget))
        return gaussians

    monkeypatch.setattr(encode.stages, "refine", refine)
    words = ("compress", tmp_path / "g.npz", "-o", tmp_path / "f.tsplat", "--force")
    assert console.succeed(*words).count("\n") == 1 and asked == []
    said = console.succeed(*words, "--refine", "2", "--photos", "desk")
    assert len(asked) == 1 and asked[0][0] == "scene desk" and said.count("\n") == 2
    assert console.succeed(*words, "--refine", "2", "--photos", "desk", "-q") == "" and len(asked) == 2


def test_compress_reads_grids_and_cameras(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    g = make_smooth_gaussians(1, 4, 4, degree=0)
    monkeypatch.setattr(encode, "load_gaussians", lambda file, grid, cameras: asked.append((grid, cameras)) or g)
    monkeypatch.setattr(encode, "_load_cameras", lambda source: f"cameras {source}")
    for words in (("--grid", "1,4,4"), ("--cameras", "c"), ("--grid", "1,4,4", "--cameras", "c")):
        console.succeed("compress", "g.ply", "-o", tmp_path / "f.tsplat", "--force", *words)
    assert asked == [((1, 4, 4), None), (None, "cameras c"), ((1, 4, 4), "cameras c")]


def test_what_is_read_in_part_is_a_tsplat_file(tmp_path: Path) -> None:
    ts.save_gaussians(tmp_path / "g.npz", make_smooth_gaussians(2, 4, 4))
    file = str(tmp_path / "g.npz")
    for fields, option in (({"max_bytes": 9}, "--max-bytes"), ({"partial": True}, "--partial")):
        reading = Reading(**{**vars(READING), **fields})
        assert reading.is_in_part and not READING.is_in_part
        with pytest.raises(InputError) as error:
            reading.load(file, Stopwatch())
        assert str(error.value) == f"{option}: only .tsplat files can be decoded in part, not {file}"
    one = Reading(**{**vars(READING), "views": [1]}).load(file, Stopwatch())
    assert one.count == 16 and READING.load(file, Stopwatch()).count == 32
    with pytest.raises(InputError, match=r"g\.npz: "):
        Reading(**{**vars(READING), "views": [2]}).load(file, Stopwatch())


@pytest.mark.parametrize("suffix", [".npz", ".ply", ".tsplat"])
def test_standard_input_may_be_any_format(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str) -> None:
    g = make_smooth_gaussians(2, 4, 4, degree=0)
    path = tmp_path / f"g{suffix}"
    if suffix == ".tsplat":
        path.write_bytes(ts.compress(g))
    else:
        ts.save_gaussians(path, g)
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(path.read_bytes())))
    assert same(READING.load("-", Stopwatch()), READING.load(str(path), Stopwatch()))
