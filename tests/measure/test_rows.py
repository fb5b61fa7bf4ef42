"""Stamps: a changed byte of whatever a figure depends on makes its row stale, and nothing else does."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import math
import platform
import subprocess
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import tinysplat.measure
import tinysplat_runtime
from tinysplat.measure import rows
from tinysplat.measure.rows import Row, RowFile, code_files, code_fingerprint, fingerprint, model_fingerprint, read_rows
from tinysplat_runtime.errors import InputError
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


def test_stamps_are_the_first_64_bits_of_a_hash_of_names_and_contents(tmp_path):
    files = [tmp_path / "a.py", tmp_path / "b.py"]
    for path in files:
        path.write_bytes(path.name.encode() * 2)
    wanted = hashlib.sha256(b"a.pya.pya.pyb.pyb.pyb.pynumpy 2av 1").hexdigest()[:16]
    assert fingerprint(files, ["numpy 2", "av 1"]) == wanted
    assert rows.digest("a", [1], {"y": 1, "x": 2}) == rows.digest("a", [1], {"x": 2, "y": 1})
    assert rows.digest(1) == hashlib.sha256(b"[1]").hexdigest()[:16] != rows.digest(2)
    network = next(artifact for artifact in load_manifest().values() if artifact.role == "network")
    model_fingerprint.cache_clear()
    assert model_fingerprint(network.name) == network.sha256[:16]


def test_weights_beside_a_network_count_with_their_name_size_and_time(tmp_path):
    (tmp_path / "own.onnx").write_bytes(b"x" * 100)

    def found() -> str:
        model_fingerprint.cache_clear()
        return model_fingerprint(str(tmp_path / "own.onnx"))

    assert found() == hashlib.sha256(b"x" * 100).hexdigest()[:16]
    data = tmp_path / "own.onnx.data"
    data.write_bytes(b"1234")
    one = found()
    stat = data.stat()
    said = f"own.onnx.data 4 {stat.st_mtime_ns}".encode()
    assert one == hashlib.sha256(b"x" * 100 + said).hexdigest()[:16]
    (tmp_path / "own.onnx_data").write_bytes(b"1")
    assert found() != one
    (tmp_path / "other.data").write_bytes(b"1")
    (tmp_path / "own.onnx_data").unlink()
    assert found() == one


def test_rows_are_json_without_what_is_empty_and_come_back():
    row = Row(
        "s", "c", "w", {"context": (0, 2), "qp": np.float32(1.5)},
        {"psnr": math.inf, "low": -math.inf, "nan": math.nan, "n": np.int64(3), "parts": {"a": [1.0, math.inf]},
         "none": None, "word": "text"},
        {"seconds": 2.5}, stamp="abc",
    )  # fmt: skip
    document = row.to_json()
    assert json.loads(json.dumps(document, allow_nan=False)) == document == {
        "study": "s", "subject": "c", "way": "w", "setting": {"context": [0, 2], "qp": 1.5},
        "figures": {"psnr": "inf", "low": "-inf", "nan": "nan", "n": 3, "parts": {"a": [1.0, "inf"]}, "none": None,
                    "word": "text"},
        "costs": {"seconds": 2.5}, "stamp": "abc",
    }  # fmt: skip
    again = Row.from_json(document)
    assert math.isnan(again.figures["nan"]) and again.figures["parts"] == {"a": [1.0, math.inf]}
    assert (again.figures["psnr"], again.figures["low"], again.figures["word"]) == (math.inf, -math.inf, "text")
    assert again.key == row.key == ("s", "c", "w", '{"context": [0, 2], "qp": 1.5}')
    assert again.seconds == 2.5 and Row("s", "c", "w").seconds is None
    assert Row("s", "c", "w").to_json() == {"study": "s", "subject": "c", "way": "w"}
    assert Row("s", "c", "w", setting={"a": "inf"}) == Row.from_json({"study": "s", "subject": "c", "way": "w",
                                                                      "setting": {"a": "inf"}})  # fmt: skip
    for wrong in ([], 3, None, "row"):
        with pytest.raises(ValueError, match="not a row"):
            Row.from_json(wrong)


def test_a_torn_last_line_is_cut_off_and_the_file_goes_on(tmp_path):
    path = tmp_path / "new" / "rows.jsonl"
    file = RowFile(path)
    assert list(file) == []
    first, second = (Row("s", name, "w", figures={"db": 1.0}, stamp="a") for name in "ab")
    file.add(first)
    whole = path.read_bytes()
    assert whole == b'{"study": "s", "subject": "a", "way": "w", "figures": {"db": 1.0}, "stamp": "a"}\n'
    path.write_bytes(whole + b'{"study": "s", "subj')
    again = RowFile(path)
    assert path.read_bytes() == whole and list(again) == [first]
    again.add(second)
    assert list(RowFile(path)) == read_rows(path) == read_rows(path.parent) == [first, second]


def test_a_row_that_is_measured_again_comes_last_and_every_stamp_is_found(tmp_path):
    file = RowFile(tmp_path / "rows.jsonl")
    made = (("a", 1.0), ("b", 2.0), ("a", 3.0))
    old, other, new = (Row("s", name, "w", figures={"db": db}, stamp="1") for name, db in made)
    for row in (old, other, new):
        file.add(row)
    assert list(file) == [other, new] and file.find(old) == new
    later = replace(old, stamp="2", figures={"db": 4.0})
    file.add(later)
    assert file.find(later) == later and file.find(new) == new
    assert {row.subject: row for row in file} == {"a": later, "b": other}
    assert {row.subject: row for row in read_rows(tmp_path)} == {"a": later, "b": other}


@pytest.mark.parametrize("text", ['{"study": "s"}', '{"a": 1}', "[[[", "{}\n{}"])
def test_the_line_that_is_no_row_is_named(tmp_path, text):
    (tmp_path / "rows.jsonl").write_text('{"study": "s", "subject": "a", "way": "w"}\n' + text + "\n")
    with pytest.raises(InputError, match=r"rows.jsonl: line 2: not a row of measurements \(.{1,80}\)$"):
        read_rows(tmp_path)


def test_rows_are_grouped_by_attributes_and_settings_in_order_of_appearance():
    made = [Row("s", subject, "w", {"views": views}) for subject, views in (("b", [1, 2]), ("a", None), ("b", [1, 2]))]
    assert rows.grouped(made, "subject", "views") == {("b", (1, 2)): [made[0], made[2]], ("a", None): [made[1]]}
    assert rows.grouped(made, "study", "way", "qp") == {("s", "w", None): made}
    assert rows.of_study([*made, Row("t", "a", "w")], "s") == made


def test_a_machine_is_described_by_what_the_system_tells(monkeypatch):
    told = {
        "cpuinfo": ["processor : 0", "model name : Fast One", "flags : fpu avx2 avx512f sse", "flags : none"],
        "meminfo": ["MemFree: 7 kB", "MemTotal:       24 kB"],
    }
    monkeypatch.setattr(rows, "_proc", told.__getitem__)
    monkeypatch.setattr(rows.os, "getloadavg", lambda: (1.256, 9.0, 9.0))
    found = rows.describe_machine()
    assert (found["cpu"], found["memory_bytes"], found["load_average"]) == ("Fast One", 24 * 1024, 1.26)
    assert found["vector_extensions"] == ["avx2", "avx512f"]
    assert found["numpy"] == np.__version__ and found["python"] == platform.python_version()
    assert found["libavcodec"].count(".") == 2 and "torch" in found
    for name in told:
        told[name] = []
    found = rows.describe_machine()
    assert found["memory_bytes"] is None and found["vector_extensions"] == []
    assert found["cpu"] == (platform.processor() or platform.machine())


def test_what_a_system_does_not_tell_is_nothing():
    assert rows._proc("no such file") == []


@pytest.mark.parametrize(("changed", "plus"), [("", ""), (" M runtime/a.py", "+")])
def test_the_commit_is_that_of_this_checkout_with_a_plus_where_files_differ(monkeypatch, changed, plus):
    folder = Path(rows.__file__).resolve().parents[2]
    told = {"rev-parse --show-toplevel": str(folder), "rev-parse --short=12 HEAD": "abcdef123456"}

    def run(command: list[str], **options: object) -> subprocess.CompletedProcess:
        assert command[:3] == ["git", "-C", str(folder)]
        words = " ".join(command[3:])
        return subprocess.CompletedProcess(command, 0, told.get(words, changed) + "\n", "")

    monkeypatch.setattr(rows.subprocess, "run", run)
    assert rows.commit() == f"abcdef123456{plus}"
    told["rev-parse --show-toplevel"] = "/elsewhere"
    assert rows.commit() is None

    def missing(*_: object, **__: object) -> None:
        raise FileNotFoundError("git")

    monkeypatch.setattr(rows.subprocess, "run", missing)
    assert rows.commit() is None
