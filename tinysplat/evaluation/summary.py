"""Records condensed: means over windows and over scenes, and the JSON document and CSV rows of a run."""

from __future__ import annotations

import importlib.metadata
import platform
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

import tinysplat_runtime
from tinysplat_runtime.system.threads import available_cores

from .records import Record
from .runner import Outcome, Settings

IDENTITY = ("kind", "views", "model", "profile", "qp", "height", "width")
"""What records of one group have in common."""

_NOT_AVERAGED = {"scene", "context", "targets", "per_image", "pictures", *IDENTITY}

ENCODE_STAGES = ("vpt", "vabr", "quantise", "x265", "write")
DECODE_STAGES = ("parse", "libavcodec", "synthesis")


@dataclass(frozen=True)
class Group:
    """Records that differ in scene and window alone.

    Attributes:
        identity: values of `IDENTITY`.
        records: in the order of evaluation.
    """

    identity: dict[str, Any]
    records: tuple[Record, ...]

    @property
    def title(self) -> str:
        """For people."""
        i = self.identity
        size = f"{i['height']}x{i['width']}"
        return f"{i['kind']}, {i['views']} views, {i['model']}, {i['profile']} at Q_g {i['qp']:g}, {size}"

    @property
    def scenes(self) -> dict[str, tuple[Record, ...]]:
        """Records by scene."""
        names = dict.fromkeys(record.scene for record in self.records)
        return {name: tuple(r for r in self.records if r.scene == name) for name in names}


def group_records(records: Iterable[Record]) -> list[Group]:
    """Groups in order of first appearance."""
    groups: dict[tuple[Any, ...], list[Record]] = {}
    for record in records:
        groups.setdefault(tuple(getattr(record, name) for name in IDENTITY), []).append(record)
    return [Group(dict(zip(IDENTITY, key, strict=True)), tuple(members)) for key, members in groups.items()]


def mean_of(values: Sequence[Any]) -> Any:
    """Mean of numbers, or of objects key by key; what is None or lacks a key is left out, and None if nothing stays."""
    present = [value for value in values if value is not None]
    if not present:
        return None
    if isinstance(present[0], dict):
        keys = dict.fromkeys(key for value in present for key in value)
        return {key: mean_of([value.get(key) for value in present]) for key in keys}
    return float(np.mean(present))


def mean_record(records: Sequence[Record]) -> dict[str, Any]:
    """Means over records of every figure, every record counting once."""
    names = [f.name for f in fields(Record) if f.name not in _NOT_AVERAGED]
    return {name: mean_of([getattr(record, name) for record in records]) for name in names}


def mean_of_scenes(group: Group) -> dict[str, Any]:
    """Means over scenes of each scene's means: a scene with many windows weighs no more than one with few."""
    return mean_of([mean_record(records) for records in group.scenes.values()])


def encode_seconds(seconds: dict[str, float]) -> float:
    """From Gaussians to bytes."""
    return sum(seconds.get(stage, 0.0) for stage in ENCODE_STAGES)


def decode_seconds(seconds: dict[str, float]) -> float:
    """From bytes to Gaussians."""
    return sum(seconds.get(stage, 0.0) for stage in DECODE_STAGES)


def document(outcome: Outcome, settings: Settings, lpips: str) -> dict[str, Any]:
    """The object that `eval --json` writes.

    `scenes` has one entry per window and coding, `mean` the means over all of them, and `groups` the means of those
    that compare: of one kind, number of views, model, profile, Q_g and size.
    """
    groups = group_records(outcome.records)
    return {
        "scenes": [record.as_json() for record in outcome.records],
        "mean": mean_record(outcome.records),
        "groups": [
            {
                **group.identity,
                "windows": len(group.records),
                "mean": mean_record(group.records),
                "mean_of_scenes": mean_of_scenes(group),
            }
            for group in groups
        ],
        "left_out": [asdict(entry) for entry in outcome.left_out],
        "lpips": lpips,
        "threads": settings.threads,
        "processes": settings.processes,
        "environment": environment(),
    }


def environment() -> dict[str, Any]:
    """Machine and versions, so that times and last digits can be placed."""
    versions = {name: importlib.metadata.version(name) for name in ("numpy", "onnxruntime", "av")}
    return {
        "cpu": _cpu_name(),
        "cores": available_cores(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "tinysplat": tinysplat_runtime.__version__,
        **versions,
    }


def flat_row(record: Record) -> dict[str, Any]:
    """A record as one row of a CSV file: nested figures as `seconds.x265` and the like, lists joined by spaces."""
    row: dict[str, Any] = {}
    for name, value in record.as_json().items():
        if name == "per_image":
            continue
        _flatten(name, value, row)
    return row


def _flatten(name: str, value: Any, row: dict[str, Any]) -> None:
    if isinstance(value, dict):
        for key, inner in value.items():
            _flatten(f"{name}.{key}", inner, row)
    else:
        row[name] = " ".join(map(str, value)) if isinstance(value, list | tuple) else value


def _cpu_name() -> str:
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
