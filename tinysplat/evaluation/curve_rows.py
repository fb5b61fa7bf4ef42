"""Points of rate–distortion curves as rows of a CSV file, which is also what a killed run goes on from.

A row carries a stamp of all that it depends on. A run takes over rows whose stamp is its own and measures the rest, and
rows appear in the file as they are measured.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system.files import read_limited, write_atomically

from .rate_distortion import Point

CLASSES = ("depth", "offset", "scale", "rotation", "color", "opacity", "photos", "metadata")
"""Columns of bytes by class."""

_IDENTITY = ("network", "views", "case", "way", "setting")
_COLUMNS = (*_IDENTITY, "bytes", "to_raw", "to_photo", "raw_to_photo", *CLASSES, "stamp")
_DIGITS = 4
_MAX_BYTES = 64 * 1000 * 1000


@dataclass(frozen=True)
class Row:
    """One file that was measured.

    Attributes:
        network: what made the Gaussians.
        views: how many.
        case: scene and window.
        way: how they were stored.
        point: the setting, bytes and dB.
        raw_to_photo: the raw Gaussians' pictures against the photos, dB, or None.
        stamp: of what the figures depend on.
    """

    network: str
    views: int
    case: str
    way: str
    point: Point
    raw_to_photo: float | None
    stamp: str

    @property
    def key(self) -> tuple[str, int, str, str, float]:
        """What tells it from the other rows of a file."""
        return self.network, self.views, self.case, self.way, self.point.setting


class RowFile:
    """Rows on disk."""

    def __init__(self, path: Path) -> None:
        """Read what is there; InputError if that is no such file."""
        self.path = path
        self._rows = {row.key: row for row in read_rows(path)} if path.is_file() else {}

    def find(self, key: tuple[str, int, str, str, float], stamp: str) -> Row | None:
        """The row of that key, if it has the stamp."""
        row = self._rows.get(key)
        return row if row is not None and row.stamp == stamp else None

    def add(self, row: Row) -> Row:
        """Keep a row, in place of any of the same key; returns it as the file has it, so that both give one table."""
        point = replace(row.point, psnr=_rounded(row.point.psnr), to_photo=_rounded(row.point.to_photo))
        row = replace(row, point=point, raw_to_photo=_rounded(row.raw_to_photo))
        self._rows[row.key] = row
        write_atomically(self.path, csv_of(self._rows.values()).encode())
        return row


def csv_of(rows: Iterable[Row]) -> str:
    """A line per row, dB to four digits."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for row in rows:
        point = row.point
        decibels = ("" if db is None else f"{db:.{_DIGITS}f}" for db in (point.psnr, point.to_photo, row.raw_to_photo))
        classes = (point.bytes_by_class.get(name, "") for name in CLASSES)
        identity = (row.network, row.views, row.case, row.way, f"{point.setting:g}")
        writer.writerow([*identity, point.bytes, *decibels, *classes, row.stamp])
    return buffer.getvalue()


def read_rows(path: Path) -> list[Row]:
    """The rows of `csv_of`; InputError names the line at fault."""
    rows = []
    for number, fields in enumerate(csv.DictReader(io.StringIO(read_limited(path, _MAX_BYTES).decode())), start=2):
        try:
            rows.append(_row(fields))
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"not a row of curves ({error})", where=f"{path}: line {number}") from None
    return rows


def _rounded(db: Any) -> Any:
    """dB as the file has them."""
    return None if db is None else round(db, _DIGITS)


def _row(fields: dict[str, str]) -> Row:
    classes = {name: int(fields[name]) for name in CLASSES if fields[name]}
    to_photo, raw_to_photo = (float(fields[name]) if fields[name] else None for name in ("to_photo", "raw_to_photo"))
    point = Point(float(fields["setting"]), int(fields["bytes"]), float(fields["to_raw"]), to_photo, classes)
    return Row(
        fields["network"], int(fields["views"]), fields["case"], fields["way"], point, raw_to_photo, fields["stamp"]
    )


def grouped(rows: Iterable[Row], *names: str) -> dict[tuple[str, ...], list[Row]]:
    """Rows by the values of some of network, views, case, way, in order of appearance."""
    groups: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(str(getattr(row, name)) for name in names), []).append(row)
    return groups


def points_of(rows: Sequence[Row]) -> list[Point]:
    """The rows' points, by setting."""
    return sorted((row.point for row in rows), key=lambda point: point.setting)
