"""What tsplat.js says of a file without decoding it, beside `ts.inspect`, and the limits that it holds files to."""

import base64
import json
import re
import subprocess
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import repeat
from pathlib import Path
from random import Random
from typing import Any

import pytest
from conformance.run import CASES
from golden.cases import DATA
from hostile import corpus
from hostile.containers import Part, Seed, damage_table, join, rearrange_sections
from hostile.damage import VALUES
from web.node import node

import tinysplat_runtime as ts
from tinysplat_runtime.container import layout as L
from tinysplat_runtime.container.limits import Limits
from tinysplat_runtime.container.reader import read_container

OTHERS_THAN_PLANES = {"position", "exact", "photo"}
WEB = Path(ts.__file__).parent / "web"
FILES = [path.read_bytes() for path in sorted(DATA.glob("*.tsplat"))]
OTHERS = [path.parent / f"{path.parent.name}.tsplat" for path in sorted(CASES.glob("*/expected.npz"))]
ALL = [*FILES, *(path.read_bytes() for path in OTHERS)]

CODE = """
import { inspect } from "./tsplat.js";
import { readFileSync } from "node:fs";
const asked = JSON.parse(readFileSync(0, "utf8"));
console.log(JSON.stringify(asked.map(([file, limits]) => {
  try { return inspect(Buffer.from(file, "base64"), limits); } catch ({ name, message }) { return { name, message }; }
})));
"""


def inspected(files: Iterable[bytes], limits: Iterable[dict[str, int]] = repeat({})) -> list[dict[str, Any]]:
    command = [node(), "--input-type=module", "-e", CODE]
    asked = json.dumps([[base64.b64encode(file).decode(), given] for file, given in zip(files, limits, strict=False)])
    done = subprocess.run(command, cwd=WEB, input=asked, capture_output=True, text=True, check=True)
    found: list[dict[str, Any]] = json.loads(done.stdout)
    return found


def test_a_file_is_described_as_in_python() -> None:
    for file, found in zip(ALL, inspected(ALL), strict=True):
        wanted = ts.inspect(file)
        assert {name: found[name] for name in ("mode", "bytes", "qp")} == {
            n: wanted[n] for n in ("mode", "bytes", "qp")
        }
        assert found["version"] == wanted["version"] and len(found["cameras"]) == wanted["views"]
        planes = [(plane["name"], sum(plane.get("bytes_by_view", []))) for plane in wanted["planes"]]
        channels = [(channel["name"], sum(channel["bytes"])) for layer in found["channels"] for channel in layer]
        others = {name for name, _ in channels if name.rstrip("0123456789") in OTHERS_THAN_PLANES}
        assert [channel for channel in channels if channel[0] not in others] == planes
        assert sum(size for _, size in channels) == sum(wanted["bytes_by_class"].values())


def test_steps_are_python_s_prefixes_at_least_and_all_of_them_can_be_read() -> None:
    seen = 0
    for file, found in zip(ALL, inspected(ALL), strict=True):
        wanted = {prefix["bytes"] for prefix in ts.inspect(file)["prefixes"]}
        if found["mode"] == "gaussians" and wanted:
            assert wanted <= set(found["steps"]) and found["steps"] == sorted(set(found["steps"]))
            for step in found["steps"] if file in FILES else ():  # others are damaged, or in an odd order
                assert ts.decompress(file, max_bytes=step).count
                seen += 1
    assert seen


@pytest.mark.parametrize(("ours", "theirs"), [("max_memory_bytes", "maxMemory"), ("max_pixels", "maxPixels")])
def test_what_limits_count_is_counted_as_in_python(ours: str, theirs: str) -> None:
    def counts(file: bytes, limit: int) -> list[int] | None:
        """Larger numbers of what Python says is too much, the count among them; None where it is not."""
        try:
            read_container(file, Limits(**{ours: limit}))
        except ts.FormatError as error:
            return sorted(n for n in map(int, re.findall(r"\d+", str(error))) if n > limit)
        return None

    files, limits, wanted = [], [], []
    for file in [*FILES, *(seed.data for seed in corpus.tsplat_seeds())]:
        limit = 1
        while limit:  # of each layer, just too little; then enough
            found = counts(file, limit) or []
            for one in {limit, *(number - less for number in found for less in (0, 1))}:
                files.append(file)
                limits.append({theirs: one})
                wanted.append(counts(file, one) is not None)
            limit = found[0] if found else 0
    assert len(files) > 20 and not all(wanted)
    assert ["message" in answer for answer in inspected(files, limits)] == wanted


def fields_at_edges(part: Part, rng: Random) -> Iterator[Part]:
    """A section of metadata with one number at a value that readers break at."""
    for width, times in ((1, 1), (2, 1), (4, 2), (8, 1)):
        for _ in range(20 * times if len(part.data) >= width else 0):
            data, at = bytearray(part.data), width * rng.randrange(len(part.data) // width)
            data[at : at + width] = rng.choice(VALUES[width])
            if width == 1 and rng.random() < 0.5:
                data[at] = (part.data[at] + rng.choice((-1, 1))) & 255
            yield replace(part, data=bytes(data))
    for data in (part.data[:-1], part.data + b"\0"):
        yield replace(part, data=data)


def test_metadata_is_accepted_and_refused_as_in_python() -> None:
    rng, files, tried = Random(1), [], Counter[bytes]()
    for path in OTHERS:
        seed = Seed.of(path.read_bytes())
        files += [damage(seed, rng) for damage in (damage_table, rearrange_sections) for _ in range(10)]
        for i, part in enumerate(seed.parts):
            if tried[part.kind] < 6 and part.kind not in (L.PARAMETER_SETS, L.DATA):
                tried[part.kind] += 1
                edges = fields_at_edges(part, rng)
                files += [join([*seed.parts[:i], one, *seed.parts[i + 1 :]]) for one in edges]
    reasons = []
    for file in files:
        try:
            read_container(file, is_prefix=True)
            reasons.append(None)
        except ts.FormatError as error:
            reasons.append(str(error))
    answers = inspected(files)
    differing = [(found, why) for found, why in zip(answers, reasons, strict=True) if ("message" in found) != bool(why)]
    assert differing == []
    assert {found["name"] for found in answers if "name" in found} == {"TsplatError"}
    assert {why is None for why in reasons} == {True, False}
