"""`models`, `doctor` and `decode`: what they print and write, beside what other tests decode."""

from __future__ import annotations

import json
from argparse import Namespace
from pathlib import Path
from types import SimpleNamespace

import console
import pytest
from scenes import make_smooth_gaussians

import tinysplat_runtime as ts
from tinysplat_runtime.cli import commands, doctor
from tinysplat_runtime.errors import ModelError
from tinysplat_runtime.graphs.providers import providers_of


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("commands") / "f.tsplat"
    path.write_bytes(ts.compress(make_smooth_gaussians(2, 16, 24, degree=1)))
    return path


def test_models_are_a_line_each_or_the_manifest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.onnx").write_bytes(bytes(12_345))
    found = {
        "sweep": SimpleNamespace(path=tmp_path / "a.onnx", role="network", entry={"purpose": "photos → Gaussians"}),
        "gone": SimpleNamespace(path=tmp_path / "b.onnx", role="synthesis", entry=None),
    }
    monkeypatch.setattr(commands, "load_manifest", lambda: found)
    assert console.succeed("models") == (
        "sweep              network         12.3 KB  photos → Gaussians\ngone               synthesis        0.0 KB  \n"
    )
    text = console.succeed("models", "--json")
    assert json.loads(text) == {"sweep": {"purpose": "photos → Gaussians"}, "gone": None}
    assert text.startswith('{\n  "sweep": {\n    "purpose": "photos → ')


def report(**fields: object) -> dict[str, object]:
    return {
        "tinysplat": "0.1.0", "python": "3.11.7", "machine": "Linux x86_64, 2 cores", "packages": {"numpy": "2.0"},
        "codecs": {"libx265": "encoder"}, "models": {"folder": "models"}, "extras": {"io": "installed"},
        "providers": ["CPUExecutionProvider"], "wrong": [], **fields,
    }  # fmt: skip


PLAIN = """\
tinysplat 0.1.0, Python 3.11.7, Linux x86_64, 2 cores

packages
  numpy                  2.0

codecs
  libx265                encoder

models
  folder                 models

extras
  io                     installed

providers
  CPUExecutionProvider

nothing is wrong"""


def test_what_doctor_found_as_text() -> None:
    assert doctor.text(report()) == PLAIN
    graphs = {"sweep": {"CUDA": 7, "CPU": 2}, "synthesis": {}}
    said = (
        "\nnodes run, by provider\n  sweep                  7 CUDA, 2 CPU\n  synthesis              none\n\nproviders"
    )
    assert doctor.text(report(graphs=graphs)) == PLAIN.replace("\nproviders", said)
    assert doctor.text(report(wrong=["a", "b"])) == PLAIN.replace("nothing is wrong", "WRONG: a\nWRONG: b")


@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        (["no av"], "tinysplat: doctor: 1 thing is wrong, the first: no av\n"),
        (["no av", "b"], "tinysplat: doctor: 2 things are wrong, the first: no av\n"),
    ],
)
def test_doctor_ends_with_what_is_wrong(monkeypatch: pytest.MonkeyPatch, wrong: list[str], line: str) -> None:
    asked = []
    monkeypatch.setattr(doctor, "examine", lambda providers: asked.append(providers) or report(wrong=wrong))
    done = console.tinysplat("doctor")
    assert (done.returncode, done.stderr) == (2, line) and done.stdout == doctor.text(report(wrong=wrong)) + "\n"
    done = console.tinysplat("doctor", "--provider", "CPU", "--json")
    assert json.loads(done.stdout) == report(wrong=wrong) and done.stdout.startswith('{\n  "tinysplat"')
    assert asked[0] is None and asked[1] == providers_of("CPU")


def test_doctor_tries_providers_only_if_asked_to(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "ran_by", lambda asked, wrong: wrong.append(f"{asked} fails") or {"sweep": {}})
    assert "graphs" not in doctor.examine()
    found = doctor.examine(["x"])
    assert found["graphs"] == {"sweep": {}} and found["wrong"][-1] == "['x'] fails"


def test_doctor_names_codecs_and_models_that_are_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    import av

    def codec(name: str, mode: str) -> None:
        if (name, mode) in (("hevc", "r"), ("libx264", "w")):
            raise ValueError(name)

    monkeypatch.setattr(av, "Codec", codec)
    wrong: list[str] = []
    assert doctor._codecs(wrong) == {
        "libx265": "encoder", "hevc": "missing", "png": "decoder", "mjpeg": "decoder", "libx264": "missing",
    }  # fmt: skip
    assert wrong == [f"this av has no {what}; pip's wheels have it" for what in ("hevc decoder", "libx264 encoder")]

    def damaged() -> bytes:
        raise ModelError("sha256 differs", where="b.onnx")

    sound = SimpleNamespace(role="network", read=lambda: bytes(12_500), for_cpu=lambda: sound)
    stored = SimpleNamespace(read=damaged)
    halves = SimpleNamespace(role="x", read=sound.read, for_cpu=lambda: stored)
    monkeypatch.setattr(doctor, "load_manifest", lambda: {"a": sound, "b": halves})
    for folder, suffix in (("m", " (TINYSPLAT_MODELS)"), ("", "")):
        monkeypatch.setenv("TINYSPLAT_MODELS", folder)
        monkeypatch.setattr(doctor, "models_dir", lambda: "there")
        wrong = []
        assert doctor._models(wrong) == {
            "folder": f"there{suffix}", "a": "network, 12 KB, as the manifest says", "b": "WRONG",
        }  # fmt: skip
        assert wrong == ["b.onnx: sha256 differs"]


def test_doctor_goes_on_without_libraries(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails() -> None:
        raise ImportError("x" * 200)

    monkeypatch.setattr(doctor, "onnxruntime", fails)
    monkeypatch.setitem(__import__("sys").modules, "av", None)
    wrong: list[str] = []
    assert doctor._providers(wrong) == [] and doctor._codecs(wrong) == {}
    assert wrong[0] == f"onnxruntime does not load ({'x' * 120})" and wrong[1].startswith("av does not load (")


def test_extras_bring_packages_and_those_of_other_extras(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = [
        "numpy>=1", "a>=1,<2; extra == 'io'", 'b[x]; extra == "fast"', "tinysplat[io,fast]; extra == 'all'",
        "a; extra == 'all'", "old; python_version < '3.1' and extra == 'io'", "sphinx; extra == 'docs'",
        "new; python_version < '9.0' and extra == 'io'",
    ]  # fmt: skip
    names = ["io", "fast", "all", "docs", "empty"]
    metadata = SimpleNamespace(get_all=lambda key: names if key == "Provides-Extra" else None)
    monkeypatch.setattr(doctor.importlib.metadata, "metadata", lambda package: metadata)
    monkeypatch.setattr(doctor.importlib.metadata, "requires", lambda package: lines)
    assert doctor.extras() == {"io": ["a", "new"], "fast": ["b"], "all": ["a", "new", "b"], "empty": []}
    monkeypatch.setattr(doctor, "_is_installed", lambda name: name == "a")
    assert doctor._state("io", ["a"]) == "installed"
    assert doctor._state("io", ["a", "b", "c"]) == 'lacks b, c: pip install "tinysplat[io]"'
    assert doctor.extras("none") and doctor.extras.__defaults__ == ("tinysplat",)


def test_a_folder_of_modules_has_no_extras() -> None:
    assert doctor.extras("surely-no-package-of-this-name") == {}


def test_decode_writes_gaussians_and_says_how_many(file: Path, tmp_path: Path) -> None:
    said = console.succeed("decode", file, "-o", tmp_path / "g.npz", "--report", tmp_path / "r.json", "--unit", "inch")
    assert said == f"{tmp_path / 'g.npz'}: 768 Gaussians of SH degree {ts.inspect(file.read_bytes())['sh_degree']}\n"
    found = ts.load_gaussians(tmp_path / "g.npz")
    assert found.count == 768 and found.notes.unit == "inch"
    report = json.loads((tmp_path / "r.json").read_text())
    assert (report["bytes"], report["gaussians"]) == (file.stat().st_size, 768) and "write" in report["seconds"]
    one = console.succeed("decode", file, "-o", tmp_path / "v.npz", "--views", "1", "--sh-degree", "0")
    assert one.endswith(": 384 Gaussians of SH degree 0\n")


def test_a_prefix_is_decoded_and_reported_where_it_is_asked_for(file: Path, tmp_path: Path) -> None:
    size = ts.inspect(file.read_bytes())["prefixes"][0]["bytes"]
    (tmp_path / "cut.tsplat").write_bytes(file.read_bytes()[:size])
    words = ("decode", tmp_path / "cut.tsplat", "-o", tmp_path / "g.npz", "--report", tmp_path / "r.json")
    assert "tinysplat: " in console.fail(*words) and not (tmp_path / "g.npz").exists()
    done = console.tinysplat(*words, "--partial")
    lost = done.stderr.removeprefix(f"{tmp_path / 'cut.tsplat'}: lost ")
    count, names = lost.split(" of its planes: ")
    assert done.returncode == 0 and len(names.split(", ")) == int(count) > 1
    console.succeed(*words, "--max-bytes", size, "--force")


def test_pruning_is_handed_what_was_asked_for(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from tinysplat_runtime.cli import written

    asked: list[object] = []

    def pruned(gaussians, amount, reading, say):
        asked.extend((amount, reading.threads, isinstance(say.output, str)))
        return gaussians

    monkeypatch.setattr(written, "pruned", pruned)
    console.succeed("decode", file, "-o", tmp_path / "a.npz")
    assert asked == []
    console.succeed("decode", file, "-o", tmp_path / "b.npz", "--prune", "0.5", "--threads", 3)
    assert asked[1:] == [3, True]


def test_info_tells_tsplat_files_by_their_ending(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    from tinysplat_runtime.cli import describe

    monkeypatch.setattr(describe, "describe_gaussians", lambda file: {"file": file})
    monkeypatch.setattr(describe, "info_text", lambda file, described: f"{file} {described}")
    monkeypatch.setattr(commands, "read_file", lambda file: file)
    monkeypatch.setattr(commands, "inspect_bytes", lambda data, limits: data)
    monkeypatch.setattr(commands, "described_limits_of", lambda args: None)
    for name, is_tsplat in (("A.TSPLAT", True), ("-", True), ("a.ply", False)):
        commands.info(Namespace(file=name, json=not is_tsplat))
        assert capsys.readouterr().out == (f"{name} {name}\n" if is_tsplat else f'{{\n  "file": "{name}"\n}}\n')
