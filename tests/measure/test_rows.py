"""Stamps: a changed byte of whatever a figure depends on makes its row stale, and nothing else does."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from scenes import refusing

from tinysplat.measure.rows import Row, RowFile, fingerprint, read_rows
from tinysplat_runtime.errors import InputError


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
    assert again.key == row.key != replace(row, setting={}).key
    bare = {"study": "s", "subject": "c", "way": "w"}
    assert Row("s", "c", "w").to_json() == bare
    assert Row("s", "c", "w", setting={"a": "inf"}) == Row.from_json({**bare, "setting": {"a": "inf"}})


def test_a_row_that_is_measured_again_comes_last_and_every_stamp_is_found(tmp_path):
    file = RowFile(tmp_path / "new" / "rows.jsonl")
    made = (("a", 1.0), ("b", 2.0), ("a", 3.0))
    old, other, new = (Row("s", name, "w", figures={"db": db}, stamp="1") for name, db in made)
    for row in (old, other, new):
        file.add(row)
    assert list(file) == [other, new] and file.find(old) == new
    later = replace(old, stamp="2", figures={"db": 4.0})
    file.add(later)
    assert file.find(later) == later and file.find(new) == new
    assert {row.subject: row for row in file} == {"a": later, "b": other}
    assert {row.subject: row for row in read_rows(tmp_path / "new")} == {"a": later, "b": other}


@pytest.mark.parametrize("text", ['{"study": "s"}', '{"a": 1}', "[[[", "[]", "3", "null", "{}\n{}"])
def test_the_line_that_is_no_row_is_named(tmp_path, text):
    (tmp_path / "rows.jsonl").write_text('{"study": "s", "subject": "a", "way": "w"}\n' + text + "\n")
    with refusing(InputError, "rows.jsonl line 2"):
        read_rows(tmp_path)
