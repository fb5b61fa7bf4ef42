"""Stamps: a changed byte of whatever a figure depends on makes its row stale, and nothing else does."""

from __future__ import annotations

import importlib.metadata
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

import tinysplat.measure
import tinysplat_runtime
from tinysplat.measure import rows
from tinysplat.measure.rows import Row, RowFile, code_files, code_fingerprint, fingerprint, model_fingerprint
from tinysplat_runtime.graphs.artifacts import load_manifest


def test_a_changed_byte_of_any_file_gives_another_stamp(tmp_path):
    files = [tmp_path / name for name in ("a.py", "b.py", "c.py")]
    for path in files:
        path.write_bytes(b"x = 1\n")
    first = fingerprint(files, ["numpy 2"])
    assert fingerprint(files, ["numpy 2"]) == first
    for path in files:
        path.write_bytes(b"x = 2\n")
        assert fingerprint(files, ["numpy 2"]) != first
        path.write_bytes(b"x = 1\n")
    assert fingerprint(files, ["numpy 3"]) != first
    assert fingerprint([files[0].rename(tmp_path / "d.py"), *files[1:]], ["numpy 2"]) != first


def test_the_stamp_covers_all_code_but_what_shows():
    covered = set(code_files())
    runtime, measure = (Path(str(m.__file__)).parent for m in (tinysplat_runtime, tinysplat.measure))
    assert set(runtime.rglob("*.py")) <= covered
    assert {
        measure / "metrics.py",
        measure / "studies" / "rate.py",
        measure.parent / "datasets" / "chunks.py",
    } <= covered
    assert not [path for path in covered if path.parent.name == "show"]


@pytest.fixture
def fresh(monkeypatch):
    """`code_fingerprint` of a world in which one thing is another."""

    def changed(name: str, value: object) -> str:
        with monkeypatch.context() as patch:
            patch.setattr(rows, name, value)
            return code_fingerprint.__wrapped__()

    return changed


def test_a_changed_graph_gives_another_stamp_and_a_changed_network_gives_rows_another_model(fresh, tmp_path):
    manifest = load_manifest()
    plain = code_fingerprint.__wrapped__()
    for name, artifact in manifest.items():
        other = {**manifest, name: replace(artifact, sha256="0" * 64)}
        assert (fresh("load_manifest", lambda other=other: other) == plain) == (artifact.role == "network"), name
    prints = set()
    for byte in b"ab":
        (tmp_path / "own.onnx").write_bytes(bytes([byte]) * 100)
        model_fingerprint.cache_clear()
        prints.add(model_fingerprint(str(tmp_path / "own.onnx")))
    assert len(prints) == 2


def test_another_library_gives_another_stamp(fresh):
    plain = code_fingerprint.__wrapped__()

    versions = {name: importlib.metadata.version(name) for name in ("numpy", "onnxruntime", "av")}
    for name in versions:
        other = {**versions, name: "0"}
        library = SimpleNamespace(metadata=SimpleNamespace(version=other.__getitem__))
        assert fresh("importlib", library) != plain, name


def test_rows_are_found_by_key_and_stamp_and_unstamped_rows_are_measured_anew(tmp_path):
    file = RowFile(tmp_path / "rows.jsonl")
    file.add(Row("s", "a", "w", figures={"db": 1.0}, stamp="one"))
    file.add(Row("s", "b", "w", figures={"db": 2.0}))
    again = RowFile(tmp_path / "rows.jsonl")
    assert again.find(Row("s", "a", "w", stamp="one")).figures == {"db": 1.0}
    assert again.find(Row("s", "a", "w", stamp="two")) is None
    assert again.find(Row("s", "b", "w")) is None
