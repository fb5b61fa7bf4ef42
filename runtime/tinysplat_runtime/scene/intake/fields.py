"""Fields of the JSON documents that describe scenes: what is not as expected is refused by its place.

Nothing here knows one layout: the modules beside this one say which fields they want.
"""

from __future__ import annotations

import json
from typing import Any

from numpy.typing import NDArray

from ...errors import InputError
from ...system.files import stays_inside
from ...system.jsonfields import JsonObject, kind_of
from ..cameras import check_depth, finite_array

MAX_NAME_BYTES, MAX_PATH_LENGTH = 240, 2000
"""Longest name and path of a photo: file systems hold 255 bytes and 4096, a suffix and the scene's folder included."""

MAX_NUMBER = 1e300
"""Whole numbers in JSON may be larger than any of floating point."""


class Fields:
    """A JSON object, of which each field is asked for by its name.

    Attributes:
        values: as they stand.
        where: the object's own place in its document, for messages.
    """

    def __init__(self, values: object, where: str = "") -> None:
        """InputError where `values` are no object."""
        if not isinstance(values, dict):
            raise InputError(f"a JSON {kind_of(values)}, expected an object", where=where or None)
        self.values: JsonObject = values
        self.where = where

    def place(self, name: str) -> str:
        """Of a field."""
        return f"{self.where}.{name}" if self.where else name

    def value(self, name: str, default: object = None) -> Any:
        """Any value; InputError where there is neither it nor a default."""
        value = self.values.get(name, default)
        if value is None and name not in self.values:
            raise InputError("missing", where=self.place(name))
        return value

    def number(self, name: str, default: float | None = None) -> float:
        """A finite number."""
        value = self.value(name, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < MAX_NUMBER:
            raise InputError(f"{_shown(value)}, expected a number", where=self.place(name))
        return float(value)

    def whole(self, name: str) -> int:
        """A whole number, written as one."""
        value = self.value(name)
        if type(value) is not int:
            raise InputError(f"{_shown(value)}, expected a whole number", where=self.place(name))
        return value

    def depth(self, name: str) -> float | None:
        """A depth > 0 in scene units; None where there is none."""
        if self.values.get(name) is None:
            return None
        check_depth(value := self.number(name), self.place(name))
        return value

    def array(self, name: str, shape: tuple[int, ...]) -> NDArray:
        """Finite float64 numbers, as `finite_array` has them."""
        return finite_array(self.place(name), self.value(name), shape)

    def inside(self, name: str) -> Fields:
        """An object."""
        return Fields(self.value(name), self.place(name))

    def each(self, name: str, least: int = 0) -> list[Fields]:
        """The objects of a list, at least so many; none where there is no such list."""
        entries = self.values.get(name, [])
        if not isinstance(entries, list) or len(entries) < least:
            fault = f"a JSON {kind_of(entries)}" if not isinstance(entries, list) else "empty"
            fault = fault if name in self.values else "missing"
            raise InputError(f"{fault}, expected a list of {least} or more", where=self.place(name))
        return [Fields(entry, f"{self.place(name)}[{i}]") for i, entry in enumerate(entries)]

    def photo(self, name: str) -> str:
        """The name of a photo: relative, and inside the scene's folder on any system."""
        where, photo = self.place(name), self.values.get(name)
        if not isinstance(photo, str) or not photo or "\0" in photo:
            fault = "missing" if name not in self.values else json.dumps(photo)[:40]
            raise InputError(f"{fault}, expected the name of a photo", where=where)
        if "://" in photo:
            raise InputError(f"'{photo[:60]}', a URL; expected a photo in the scene's folder: download it", where=where)
        if not stays_inside(photo):
            raise InputError(f"'{photo[:60]}' leaves the scene's folder, expected a path inside it", where=where)
        longest = max(len(part.encode("utf-8", "surrogatepass")) for part in photo.split("/"))
        if longest > MAX_NAME_BYTES or len(photo) > MAX_PATH_LENGTH:
            fault = f"a path of {len(photo)} characters, its longest name of {longest} bytes"
            raise InputError(f"{fault}, accepted are {MAX_PATH_LENGTH} and {MAX_NAME_BYTES}", where=where)
        return photo


def _shown(value: object) -> str:
    return f"{str(value)[:40]} (a JSON {kind_of(value)})"
