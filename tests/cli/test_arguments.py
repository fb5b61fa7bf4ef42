"""Words of a command line as values, names of outputs, and what options are where none are given."""

from __future__ import annotations

import argparse
import re
from argparse import Namespace
from pathlib import Path

import pytest

from tinysplat_runtime.cli import arguments
from tinysplat_runtime.cli.files import _suffix_of, grid_option
from tinysplat_runtime.cli.outputs import check_inputs, check_outputs, is_standard
from tinysplat_runtime.cli.parser import build_parser
from tinysplat_runtime.cli.run import _with_negatives
from tinysplat_runtime.cli.written import _sh_bits
from tinysplat_runtime.errors import InputError


@pytest.mark.parametrize(
    ("kind", "text", "value"),
    [
        (arguments.port, "0", 0), (arguments.port, "65535", 65535), (arguments.count, "1", 1),
        (arguments.count, "007", 7), (arguments.positive, "1e-300", 1e-300), (arguments.positive, "2.5", 2.5),
        (arguments.numbers(3), "1,-2.5,1e3", (1, -2.5, 1000)), (arguments.numbers(1), "4", (4,)),
        (arguments.indices, "1,2", (1, 2)), (arguments.byte_count, "2kB", 2000),
    ],
)  # fmt: skip
def test_words_are_values(kind, text: str, value: object) -> None:
    found = kind(text)
    assert (tuple(found) if isinstance(value, tuple) else found) == value


@pytest.mark.parametrize(
    ("kind", "text", "words"),
    [
        (arguments.port, "65536", "'65536', expected a port of 0 to 65535"),
        (arguments.port, "-1", "'-1', expected a port of 0 to 65535"),
        (arguments.count, "0", "'0', expected a whole number of 1 or more"),
        (arguments.count, "1.5", "'1.5', expected a whole number of 1 or more"),
        (arguments.positive, "0", "'0', expected a number above 0"),
        (arguments.positive, "inf", "'inf', expected a number above 0"),
        (arguments.positive, "nan", "'nan', expected a number above 0"),
        (arguments.positive, "x", "'x', expected a number above 0"),
        (arguments.numbers(2), "1,2,3", "'1,2,3', expected 2 numbers with commas between them"),
        (arguments.numbers(2), "1,-inf", "'1,-inf', expected 2 numbers with commas between them"),
        (arguments.numbers(2), "1,nan", "'1,nan', expected 2 numbers with commas between them"),
        (arguments.numbers(2), "1,b", "'1,b', expected 2 numbers with commas between them"),
    ],
)
def test_words_that_are_no_values_are_refused(kind, text: str, words: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError) as error:
        kind(text)
    assert str(error.value) == words


def test_numbers_that_begin_with_a_sign_belong_to_their_option() -> None:
    for given, expected in (
        (["--translate", "-1,2,-3"], ["--translate=-1,2,-3"]),
        (["--qp", "-2.5e1"], ["--qp=-2.5e1"]),
        (["--crop=1", "-2"], ["--crop=1", "-2"]),
        (["-2", "--x", "-a"], ["-2", "--x", "-a"]),
        (["a", "-o", "-.ply"], ["a", "--output=-.ply"]),
        (["a", "--output", "-.ply", "-.ply"], ["a", "--output=-.ply", "-.ply"]),
        (["--unit", "-.ply"], ["--unit", "-.ply"]),
        (["-o", "-"], ["-o", "-"]),
    ):
        assert _with_negatives(given) == expected


@pytest.mark.parametrize(("path", "expected"), [("-", True), ("-.ply", True), ("-a", False), ("a", False), ("", False)])
def test_standard_output_has_a_name(path: str, expected: bool) -> None:
    assert is_standard(path) is expected


@pytest.mark.parametrize(
    ("data", "suffix"),
    [
        (b"ply\n", ".ply"), (b"PK\3\4", ".npz"), (b"\x1f\x8b\x08", ".spz"), (b"NGSP\4", ".spz"), (b"glTF\2", ".glb"),
        (b"\x10" + bytes(7) + b"{}", ".safetensors"),
    ],
)  # fmt: skip
def test_formats_on_standard_input_are_told_by_their_first_bytes(data: bytes, suffix: str) -> None:
    assert _suffix_of(data) == suffix


@pytest.mark.parametrize(
    ("data", "found"), [(b"", "nothing"), (b"\1\xab345678", "01 ab 33 34"), (b"1234567{", "31 32 33 34")]
)
def test_other_bytes_on_standard_input_are_refused(data: bytes, found: str) -> None:
    with pytest.raises(InputError) as error:
        _suffix_of(data)
    accepted = ".tsplat, .npz, .safetensors, .ply, .spz or .glb"
    assert str(error.value) == f"standard input: starts with {found}, expected {accepted}"


def test_grids_and_bits_are_so_many_numbers() -> None:
    assert grid_option(None) is None and grid_option([1, 2, 3]) == (1, 2, 3) and _sh_bits([8, 1]) == (8, 1)
    for values in ([1, 2], [1, 2, 3, 4], [0, 1, 1], [1, 1, -2]):
        with pytest.raises(InputError) as error:
            grid_option(values)
        assert str(error.value) == f"--grid: {','.join(map(str, values))}, expected V,H,W of 1 or more"
    for values in ([5], [1, 2, 3]):
        with pytest.raises(InputError, match=r"--sh-bits: [\d,]+, expected two numbers of 1 to 8"):
            _sh_bits(values)


def test_outputs_are_files_of_this_machine(tmp_path: Path) -> None:
    (tmp_path / "there.ply").touch()
    there, advice = tmp_path / "there.ply", "other formats: `tinysplat decode` or `convert` afterwards"
    for fields, line in (
        ({"output": "s3://a/b"}, "s3://a/b: a URL, expected a file's name on this machine (`batch` writes to URLs)"),
        ({"output": "a.ply", "command": "encode"}, f"a.ply: '.ply', expected .tsplat; {advice}"),
        ({"output": "a", "command": "compress"}, f"a: '', expected .tsplat; {advice}"),
        (
            {"output": str(tmp_path)},
            f"{tmp_path}: is a folder, expected the name of a file such as {tmp_path / 'scene'}",
        ),
        (
            {"output": str(tmp_path), "command": "encode"},
            f"{tmp_path}: is a folder, expected the name of a file such as {tmp_path / 'scene'}",
        ),
        (
            {"html": str(tmp_path / "x" / "o")},
            f"{tmp_path / 'x' / 'o'}: folder {tmp_path / 'x'} does not exist; create it first",
        ),
        ({"output": str(there)}, f"{there}: exists; -o names another, and --force overwrites it"),
        ({"report": str(there)}, f"{there}: exists; --report names another, and --force overwrites it"),
        ({"html": str(there)}, f"{there}: exists; --html names another, and --force overwrites it"),
        ({"save_gaussians": str(there)}, f"{there}: exists; --save-gaussians names another, and --force overwrites it"),
    ):
        with pytest.raises(InputError) as error:
            check_outputs(Namespace(**{"command": "decode", **fields}))
        assert str(error.value) == line
    for fields in (
        {"output": "-"}, {"output": "-.ply", "command": "encode"}, {"output": str(there), "force": True},
        {"output": "new.TSPLAT", "command": "encode"}, {"output": str(tmp_path), "networks": "n"}, {"output": None},
        {"output": str(tmp_path / "new.ply"), "report": "new.json"},
    ):  # fmt: skip
        check_outputs(Namespace(**{"command": "decode", **fields}))


def test_inputs_are_files_of_this_machine() -> None:
    for fields in ({"file": "http://a"}, {"files": ["a", "http://a"]}, {"like": "http://a"}, {"camera": "http://a"}):
        with pytest.raises(InputError) as error:
            check_inputs(Namespace(**fields))
        assert str(error.value) == "http://a: a URL, expected a file or folder on this machine (`batch` takes URLs)"
    check_inputs(Namespace(file="a://b"[1:], files=["c:/a", "b"], scene=None, other="http://a"))


DEFAULTS = {
    "encode desk -o f.tsplat": {"quiet": False, "force": False, "threads": None, "report": None, "focal": None},
    "compress g -o f.tsplat": {"grid": None, "refine": None, "photos": None, "keep_all": False, "drop_invalid": False},
    "decode f -o g": {"sh_bits": (5, 4), "spz_version": 3, "gltf_spz": False, "points": False, "keep_all": False,
                      "dilate": None, "trim_border": None, "fuse": None, "max_bytes": None, "partial": False},
    "render f -o o.png": {"camera": None, "path": None, "frames": None, "size": None, "depth": False,
                          "depth_values": False, "depth_scale": 1000, "dilation": "own", "order": "near"},
    "convert a b -o c": {"files": ["a", "b"], "crop": None, "rotate": None, "scale": 1, "translate": (0, 0, 0),
                         "check": False, "prune": None, "views": None},
    "view": {"file": None, "html": None, "player": False, "networks": None, "port": 0, "no_browser": False},
    "info f": {"json": False, "max_pixels": None, "max_memory": None},
    "models": {"json": False},
    "doctor": {"json": False, "provider": None},
}  # fmt: skip


@pytest.mark.parametrize("line", DEFAULTS)
def test_options_that_are_not_given_have_their_documented_defaults(line: str) -> None:
    parser, _ = build_parser()
    args = vars(parser.parse_args(line.split()))
    missing = object()
    found = {name: args.get(name, missing) for name in DEFAULTS[line]}
    assert {name: tuple(v) if isinstance(v, list) and name != "files" else v for name, v in found.items()} == DEFAULTS[
        line
    ]


@pytest.mark.parametrize(
    ("line", "fields"),
    [
        ("view --networks --player -o d", {"networks": "node_modules/onnxruntime-web", "player": True}),
        ("view f --no-browser --port 80", {"no_browser": True, "port": 80}),
        ("render f -o o.png --depth --size 6x8 -q", {"depth": True, "size": (6, 8), "quiet": True}),
        ("render f -o o.png --depth-values --depth-scale 10", {"depth_values": True, "depth_scale": 10}),
        ("decode f -o g --dilate", {"dilate": 0.16}),
        ("decode f -o g --sh-bits 8,8 --spz-version 4 --fuse 2", {"sh_bits": (8, 8), "spz_version": 4, "fuse": 2}),
        ("decode f -o g --points --keep-all --gltf-spz --partial --force",
         {"points": True, "keep_all": True, "gltf_spz": True, "partial": True, "force": True}),
        ("convert a -o b --crop 1,2,3,4,5,6 --check", {"crop": (1, 2, 3, 4, 5, 6), "check": True}),
        ("info f --json --max-memory 2GB --max-pixels 9", {"json": True, "max_memory": 2 * 10**9, "max_pixels": 9}),
    ],
)  # fmt: skip
def test_options_that_are_given_are_what_they_say(line: str, fields: dict[str, object]) -> None:
    parser, _ = build_parser()
    args = vars(parser.parse_args(line.split()))
    assert {name: tuple(args[name]) if isinstance(args[name], list) else args[name] for name in fields} == fields


def test_every_command_says_its_help_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    parser, _ = build_parser()
    for words in (["--help"], ["--version"]):
        with pytest.raises(SystemExit) as leaving:
            parser.parse_args(words)
        assert leaving.value.code == 0
    out = capsys.readouterr().out
    assert re.search(r"^tinysplat \d+\.\d+", out, re.MULTILINE) and all(line.split()[0] in out for line in DEFAULTS)
