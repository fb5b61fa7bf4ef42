"""Bad inputs, a line each: what the message must say beside the name of what was given."""

import json
import struct
from pathlib import Path

import pytest
from scenes import make_smooth_gaussians, write_scene

import tinysplat_runtime as ts
from tinysplat_runtime.cli import main

SUFFIXES = ("tsplat", "npz", "safetensors", "ply", "spz", "glb", "gltf", "sog", "splat", "usdz")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A good scene, good Gaussians, a good file; beside them what is bad."""
    path = tmp_path_factory.mktemp("given")
    write_scene(path / "desk", 3)
    g = make_smooth_gaussians(2, 16, 24, 1)
    ts.save_gaussians(path / "g.npz", g)
    ts.save_gaussians(path / "g.ply", g)
    (path / "f.tsplat").write_bytes(ts.compress(g))
    for suffix in SUFFIXES:
        (path / f"empty.{suffix}").touch()
        (path / f"text.{suffix}").write_text("hello, world\n" * 9)
    for name in ("g.npz", "g.ply", "f.tsplat"):
        (path / f"cut.{name}").write_bytes((path / name).read_bytes()[:-40])
    text = json.dumps({"asset": {"version": "2.0"}}).encode() + b" "
    text += b" " * (-len(text) % 4)
    (path / "bare.glb").write_bytes(b"glTF" + struct.pack("<4I", 2, 20 + len(text), len(text), 0x4E4F534A) + text)
    (path / "nothing").mkdir()
    return path


def refusal(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """The one line with which a command refuses what it is given."""
    try:
        status = main([*map(str, arguments)])
    except SystemExit as error:
        status = error.code
    out, err = capsys.readouterr()
    *before, line = err.splitlines()
    assert (status, out) == (2, "") and line.startswith("tinysplat") and len(line) < 500, err
    assert all(": warning: " in doubt for doubt in before), err
    return line


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("kind", ["empty", "text"])
@pytest.mark.parametrize("command", ["info", "convert", "compress", "render"])
def test_files_that_are_no_gaussians(capsys, folder: Path, tmp_path: Path, command, kind: str, suffix: str) -> None:
    output = {"info": (), "compress": ("-o", tmp_path / "o.tsplat"), "render": ("-o", tmp_path / "o.png")}
    err = refusal(capsys, command, folder / f"{kind}.{suffix}", *output.get(command, ("-o", tmp_path / "o.npz")))
    assert f"{kind}.{suffix}: " in err, err


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("info cut.g.ply", "cut.g.ply"),
        ("info cut.f.tsplat", "cut.f.tsplat"),
        ("info bare.glb", "bare.glb"),
        ("info nothing", "nothing"),
        ("info x.doc", "'.doc'"),
        ("info a.zip", "unpack"),
        ("info a.ply.gz", "unpack"),
        ("info a.ksplat", "splat-transform"),
        ("info a.splatv", ".ply"),
        ("info a.pt", ".ply"),
        ("info https://host/a.tsplat", "https://host/a.tsplat"),
        ("encode https://host/scene -o o.tsplat", "https://host/scene"),
        ("encode desk -o gs://bucket/o.tsplat", "gs://bucket/o.tsplat"),
        ("encode nothing -o o.tsplat", "cameras.json"),
        ("encode desk/images -o o.tsplat", "tinysplat poses"),
        ("encode desk/images/0000.png -o o.tsplat", "0000.png"),
        ("encode empty.tsplat -o o.tsplat", "tinysplat view empty.tsplat"),
        ("encode desk -o o.jpg", ".tsplat, .npz"),
        ("encode desk -o f.tsplat", "--force"),
        ("encode desk -o nothing", "nothing"),
        ("encode desk -o o.tsplat --size -5x10", "'-5x10'"),
        ("encode desk -o o.tsplat --views 0,9", "2"),
        ("encode desk -o o.tsplat --views 1", "views: "),
        ("encode desk -o o.tsplat --far 1", "far"),
        ("encode desk -o o.tsplat --qp 99", "99"),
        ("encode desk -o o.tsplat --qp 1 --lossless", "--lossless"),
        ("encode desk -o o.tsplat --train 5 --fast", "--train: given with --fast"),
        ("encode desk -o o.ply --fast", "--fast: of .tsplat"),
        ("encode desk -o o.tsplat --no-masks --masks moving", "--no-masks"),
        ("encode desk -o o.tsplat --report o.tsplat", "--report: o.tsplat"),
        ("encode desk --report=nothing/../o.tsplat -o o.tsplat", "o.tsplat, the same file"),
        ("compress g.npz -o o.tsplat --report g.npz --force", "--report: g.npz"),
        ("compress g.npz -o o.tsplat --keep-all --seconds 3", "--seconds: given with --keep-all"),
        ("convert g.npz -o o.ply --sh-bits 3,3", "--sh-bits: of .spz"),
        ("convert g.npz -o o.npz --scale 1e30", "--scale"),
        ("view g.ply --html v.html --photos none", "none"),
        ("view f.tsplat --html v.html --files", "v.html"),
        ("encode desk -o o.tsplat --target-size 0", "'0'"),
        ("encode desk -o o.tsplat --model none.onnx", "none.onnx"),
        ("encode desk -o o.tsplat --model trained.ckpt", "trained.ckpt: a checkpoint"),
        ("encode desk -o .", "scene.tsplat"),
        ("encode desk --output=", "-o: an empty name"),
        ("encode desk -o o.tsplat --profile best", "'best'"),
        ("encode desk -o o.tsplat --threads 0", "--threads"),
        ("encode desk -o o.tsplat --fast --provider Foo", "Foo"),
        ("encode desk desk -o o.tsplat", "2"),
        ("encode desk", "--output"),
        ("encode desk -o o.tsplat --nonsense", "--nonsense"),
        ("encode g.npz -o o.tsplat", "tinysplat compress g.npz"),
        ("compress g.npz -o o.tsplat --like g.npz", "g.npz"),
        ("encode desk -o o.tsplat --like g.npz", "g.npz: header"),
        ("compress g.ply -o o.tsplat --grid 1,2,3", "1x2x3"),
        ("compress desk -o o.tsplat", "tinysplat encode"),
        ("decode g.npz -o o.npz", "g.npz"),
        ("decode f.tsplat -o o.doc", "'.doc'"),
        ("decode f.tsplat -o -", "-.ply"),
        ("decode f.tsplat -o o.npz --max-pixels 3", "3"),
        ("decode f.tsplat -o o.npz --max-memory 1KB", "1000"),
        ("decode f.tsplat -o o.npz --min-opacity 3", "3"),
        ("decode f.tsplat -o o.spz --sh-bits 9", "--sh-bits"),
        ("render f.tsplat -o o.png --camera none.json:0", "none.json"),
        ("render f.tsplat -o o.png --depth-scale 0", "--depth-scale"),
        ("render g.npz -o o.png --max-bytes 9", "--max-bytes"),
        ("convert g.npz -o o.npz --crop 90,90,90,91,91,91", "768"),
        ("convert g.npz -o o.npz --rotate 0,0,0,0", "--rotate"),
        ("convert g.npz -o o.npz --translate 1,inf,2", "--translate"),
        ("convert g.npz -o o.npz --unit " + "x" * 9000, "--unit"),
        ("convert g.npz -o o.ply --points --check", "--check"),
        ("view f.tsplat --player", "--player"),
        ("view f.tsplat --html v.tsplat", ".html"),
        ("view f.tsplat --port 65536", "'65536'"),
        ("poses f.tsplat -o o", "f.tsplat"),
        ("models extra", "extra"),
        ("info f.tsplat --threads 2", "--threads"),
        ("frobnicate", "'frobnicate'"),
    ],
)
def test_command_lines(capsys, folder: Path, tmp_path: Path, monkeypatch, line: str, words: str) -> None:
    monkeypatch.chdir(folder)
    before = sorted(folder.rglob("*"))
    assert words in (err := refusal(capsys, *line.split())), err
    assert sorted(folder.rglob("*")) == before
