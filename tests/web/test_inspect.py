"""What tsplat.js says of a file without decoding it, beside `ts.inspect`, and the limits that it holds files to."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
from golden.cases import DATA
from hostile import corpus
from web.node import node

import tinysplat_runtime as ts
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.container.records import Limits

WEB = Path(ts.__file__).parent / "web"
FILES = {path.stem: path for path in sorted(DATA.glob("*.tsplat"))}

CODE = """
import { inspect } from "./tsplat.js";
import { readFileSync } from "node:fs";
const asked = JSON.parse(readFileSync(0, "utf8"));
console.log(JSON.stringify(asked.map(({ file, limits }) => {
  try { return inspect(readFileSync(file), limits); } catch ({ message, section }) { return { message, section }; }
})));
"""


def inspected(*asked: dict[str, Any]) -> list[dict[str, Any]]:
    command = [node(), "--input-type=module", "-e", CODE]
    done = subprocess.run(command, cwd=WEB, input=json.dumps(asked), capture_output=True, text=True, check=True)
    found: list[dict[str, Any]] = json.loads(done.stdout)
    return found


def test_a_file_is_described_as_in_python() -> None:
    for path, found in zip(FILES.values(), inspected(*({"file": str(p)} for p in FILES.values())), strict=True):
        wanted = ts.inspect(path.read_bytes())
        assert {name: found[name] for name in ("mode", "bytes", "qp")} == {
            n: wanted[n] for n in ("mode", "bytes", "qp")
        }
        assert found["version"] == wanted["version"] and len(found["cameras"]) == wanted["views"]
        planes = [(plane["name"], sum(plane.get("bytes_by_view", []))) for plane in wanted["planes"]]
        channels = [(channel["name"], sum(channel["bytes"])) for layer in found["channels"] for channel in layer]
        assert channels == planes


def test_steps_are_the_ends_of_passes_and_the_first_view_s_own_light() -> None:
    seen = 0
    for path, found in zip(FILES.values(), inspected(*({"file": str(p)} for p in FILES.values())), strict=True):
        wanted = [prefix["bytes"] for prefix in ts.inspect(path.read_bytes())["prefixes"]]
        if found["mode"] != "gaussians" or not wanted:
            continue
        more = [step for step in found["steps"] if step not in wanted]
        assert [step for step in found["steps"] if step in wanted] == wanted and found["steps"] == sorted(
            found["steps"]
        )
        assert len(more) <= 1
        seen += len(more)
    assert seen > 2


@pytest.mark.parametrize(
    ("ours", "theirs", "words"),
    [("max_memory_bytes", "maxMemory", r"(\d+) bytes to decode"), ("max_pixels", "maxPixels", r"(\d+) Gaussians")],
)
def test_what_limits_count_is_counted_as_in_python(ours: str, theirs: str, words: str, tmp_path: Path) -> None:
    files = dict(FILES)
    for n, seed in enumerate(corpus.tsplat_seeds()):
        files[str(n)] = tmp_path / f"{n}.tsplat"
        files[str(n)].write_bytes(seed.data)

    def counted(path: Path, limit: int) -> list[str]:
        """What Python says is too much."""
        try:
            read_container(path.read_bytes(), Limits(**{ours: limit}))
        except ts.FormatError as error:
            return re.findall(words, str(error))
        return []

    asked, wanted = [], []
    for path in files.values():
        limit = 1
        while limit:  # of each layer, just too little; then enough
            found = counted(path, limit)
            for one in {limit, *(int(number) - 1 for number in found)}:
                asked.append({"file": str(path), "limits": {theirs: one}})
                wanted.append(counted(path, one))
            limit = int(found[0]) if found else 0
    assert len(asked) > 20
    assert [re.findall(words, answer.get("message", "")) for answer in inspected(*asked)] == wanted
