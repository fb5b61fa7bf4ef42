"""The one type of result, and the file that keeps it: a JSON line per row, which a killed run goes on from.

A row carries a stamp of all that it depends on. A run takes over rows whose stamp is its own and measures the rest;
rows stand in the file the moment they are measured.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import tinysplat_runtime
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.graphs.artifacts import find_artifact, load_manifest
from tinysplat_runtime.system.files import StrPath, read_limited
from tinysplat_runtime.system.jsonfields import JsonObject

ROWS = "rows.jsonl"
RESULTS = "results.json"
"""Of an evaluation's folder: all its figures as one document."""

TRAINER = "OpenSplat"
"""The way of rows by `checks/opensplat.py`, which trains on the same photos."""

_MAX_BYTES = 512 * 1000 * 1000
_HASH_LENGTH = 16


@dataclass(frozen=True)
class Row:
    """One thing that was measured.

    Attributes:
        study: the question, `encode` for instance.
        subject: what it was measured on.
        way: how it was done.
        setting: what sets it apart: model, profile, qp, threads and the like; JSON values.
        figures: bytes, dB, errors: all that two runs on one machine must agree on; JSON values, NaN and infinity too.
        costs: seconds and memory, which two runs need not agree on.
        note: why a figure is missing, or what to know about it.
        stamp: of what the figures depend on; empty where the row is measured anew by every run.
    """

    study: str
    subject: str
    way: str
    setting: Mapping[str, Any] = field(default_factory=dict)
    figures: Mapping[str, Any] = field(default_factory=dict)
    costs: Mapping[str, float] = field(default_factory=dict)
    note: str = ""
    stamp: str = ""

    @property
    def key(self) -> tuple[str, ...]:
        """What tells it from the other rows of a file."""
        return self.study, self.subject, self.way, json.dumps(_plain(self.setting), sort_keys=True)

    @property
    def seconds(self) -> float | None:
        """The median of what was timed, or None."""
        return self.costs.get("seconds")

    def to_json(self) -> JsonObject:
        """A JSON-ready object without what is empty; numbers that JSON lacks become words."""
        return {name: _plain(value) for name, value in asdict(self).items() if value not in ("", {})}

    @classmethod
    def from_json(cls, document: Any) -> Row:
        """The row of `to_json`'s object; TypeError or ValueError if it is none."""
        if not isinstance(document, dict):
            raise ValueError("not a row")
        return cls(
            **{name: _numbers(value) if name in ("figures", "costs") else value for name, value in document.items()}
        )


class RowFile:
    """Rows on disk, in the order in which they were measured; of two of one key the later counts."""

    def __init__(self, path: StrPath) -> None:
        """Read what is there, leaving out a torn last line; InputError where the file is another, or cannot be read."""
        self.path = Path(path)
        self._rows: dict[tuple[tuple[str, ...], str], Row] = {}
        if self.path.is_file():
            data = read_limited(self.path, _MAX_BYTES)
            whole = data[: data.rfind(b"\n") + 1]
            self._rows = {(row.key, row.stamp): row for row in _parsed(whole, self.path)}
            if whole != data:
                with self.path.open("r+b") as file:
                    file.truncate(len(whole))

    def __iter__(self) -> Iterator[Row]:
        """Rows, the latest of every key."""
        return iter({row.key: row for row in self._rows.values()}.values())

    def find(self, row: Row) -> Row | None:
        """The row of that key and stamp, measured before."""
        return self._rows.get((row.key, row.stamp)) if row.stamp else None

    def add(self, row: Row) -> Row:
        """Keep a row; returns it as the file has it, so that both give one table."""
        line = json.dumps(row.to_json(), ensure_ascii=False, allow_nan=False)
        row = Row.from_json(json.loads(line))
        self.path.parent.mkdir(parents=True, exist_ok=True)
        with self.path.open("a", encoding="utf-8") as file:
            file.write(line + "\n")
        self._rows.pop((row.key, row.stamp), None)
        self._rows[row.key, row.stamp] = row
        return row


def read_rows(path: StrPath) -> list[Row]:
    """Rows of a file, or of the file in a folder; InputError if there is none."""
    file = Path(path) / ROWS if Path(path).is_dir() else Path(path)
    rows = _parsed(read_limited(file, _MAX_BYTES), file)
    return list({row.key: row for row in rows}.values())


def grouped(rows: Iterable[Row], *names: str) -> dict[tuple[Any, ...], list[Row]]:
    """Rows by the values of some attributes or settings, in order of appearance."""
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        values = (getattr(row, n) if n in ("study", "subject", "way") else row.setting.get(n) for n in names)
        groups.setdefault(tuple(tuple(v) if isinstance(v, list) else v for v in values), []).append(row)
    return groups


def of_study(rows: Iterable[Row], study: str) -> list[Row]:
    """Those of a study."""
    return [row for row in rows if row.study == study]


def digest(*parts: object) -> str:
    """A short hash of JSON-ready values."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:_HASH_LENGTH]


@lru_cache(maxsize=64)
def model_fingerprint(model: str) -> str:
    """Hash of a network's file, with the size and time of change of weights kept beside it.

    Raises:
        ModelError: there is no such network.
    """
    artifact = find_artifact(model, "network")
    if artifact.sha256 is not None:
        return artifact.sha256[:_HASH_LENGTH]
    digest = hashlib.sha256(artifact.read())
    for sibling in sorted(artifact.path.parent.glob(f"{artifact.path.name}*data")):
        stat = sibling.stat()
        digest.update(f"{sibling.name} {stat.st_size} {stat.st_mtime_ns}".encode())
    return digest.hexdigest()[:_HASH_LENGTH]


@lru_cache(maxsize=1)
def code_fingerprint() -> str:
    """Hash of the code, graphs and libraries that figures depend on; how they are shown is not among it."""
    graphs = [
        f"{name} {artifact.sha256}" for name, artifact in sorted(load_manifest().items()) if artifact.role != "network"
    ]
    packages = [f"{name} {importlib.metadata.version(name)}" for name in ("numpy", "onnxruntime", "av")]
    return fingerprint(code_files(), graphs + packages)


def code_files() -> list[Path]:
    """The modules that figures depend on."""
    runtime, here = Path(str(tinysplat_runtime.__file__)).parent, Path(__file__).parent
    measuring = [path for path in here.rglob("*.py") if path.parent.name != "show" and path.name != "pages.py"]
    return sorted([*runtime.rglob("*.py"), *here.parent.glob("datasets/*.py"), *measuring])


def fingerprint(files: Iterable[Path], words: Iterable[str]) -> str:
    """Hash of files, their names and contents, and of words."""
    digest = hashlib.sha256()
    for path in files:
        digest.update(path.name.encode() + path.read_bytes())
    for word in words:
        digest.update(word.encode())
    return digest.hexdigest()[:_HASH_LENGTH]


def _parsed(data: bytes, path: Path) -> list[Row]:
    rows = []
    for number, line in enumerate(data.splitlines(), start=1):
        try:
            rows.append(Row.from_json(json.loads(line)))
        except (TypeError, ValueError, RecursionError) as error:
            raise InputError(f"not a row of measurements ({str(error)[:80]})", where=f"{path}: line {number}") from None
    return rows


def _plain(value: Any) -> Any:
    """JSON-ready: tuples as lists, numpy's numbers as Python's, NaN and infinities as words."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "item"):
        value = value.item()
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _numbers(value: Any) -> Any:
    """The inverse of `_plain` where figures stand."""
    if isinstance(value, dict):
        return {key: _numbers(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_numbers(item) for item in value]
    return float(value) if value in ("inf", "-inf", "nan") else value
