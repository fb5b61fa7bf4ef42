"""Fields of the JSON documents that describe scenes: what is not as expected is refused by name.

Nothing here knows one layout: `scenes` and `intake` say which keys they want.
"""

from __future__ import annotations

import json
import re
from pathlib import PurePosixPath, PureWindowsPath
from typing import Any, TypeAlias

from ..errors import InputError

JsonObject: TypeAlias = dict[str, Any]
"""What `json` makes of an object, or can make one of."""

MAX_DEPTH = 1e30
"""Depths in float32, and what they are multiplied with, stay finite below it."""


MAX_NAME_BYTES, MAX_PATH_LENGTH = 240, 2000
"""Longest name and path of a photo: file systems hold 255 bytes and 4096, a suffix and the scene's folder included."""


def parse_object(data: bytes) -> JsonObject:
    """A JSON object; NaN passes, so that the field that holds it is refused by name."""
    return as_object(parse_json(data))


def as_object(document: Any) -> JsonObject:
    """The document, which must be a JSON object."""
    if not isinstance(document, dict):
        raise InputError(f"a JSON {kind_of(document)}, expected an object with frames")
    return document


def parse_json(data: bytes) -> Any:
    """Any JSON value."""
    try:
        return json.loads(data)
    except RecursionError:
        raise InputError("JSON nested too deeply") from None
    except UnicodeDecodeError as error:
        raise InputError(f"byte {error.start} is not of UTF-8, which JSON is written in: save it as such") from None
    except ValueError as error:
        digits = re.match(r"Exceeds the limit \((\d+) digits\)", str(error))
        fault = f"a number of more than {digits[1]} digits" if digits else f"not JSON ({error})"
        raise InputError(fault if data.strip() else "an empty file, expected JSON") from None


def frame_entries(document: JsonObject) -> list[JsonObject]:
    """The objects of a document's list `frames`, at least one."""
    frames = document.get("frames")
    if not isinstance(frames, list) or not frames:
        fault = "missing" if "frames" not in document else "empty" if frames == [] else f"a JSON {kind_of(frames)}"
        raise InputError(f"{fault}, expected a list of at least one frame", where="frames")
    for i, entry in enumerate(frames):
        if not isinstance(entry, dict):
            raise InputError(f"a JSON {kind_of(entry)}, expected an object", where=f"frames[{i}]")
    return frames


def photo_name(i: int, entry: JsonObject, key: str = "file") -> str:
    """The photo's name under `key`: relative, and inside the scene's folder on any system."""
    where, name = f"frames[{i}].{key}", entry.get(key)
    if not isinstance(name, str) or not name or "\0" in name:
        fault = "missing" if key not in entry else json.dumps(name)[:40]
        raise InputError(f"{fault}, expected the name of a photo", where=where)
    if "://" in name:
        raise InputError(f"'{name[:60]}', a URL; expected a photo in the scene's folder: download it", where=where)
    for path in (PurePosixPath(name), PureWindowsPath(name)):
        if path.anchor or ".." in path.parts:
            raise InputError(f"'{name[:60]}' leaves the scene's folder, expected a path inside it", where=where)
    longest = max(len(part.encode("utf-8", "surrogatepass")) for part in name.split("/"))
    if longest > MAX_NAME_BYTES or len(name) > MAX_PATH_LENGTH:
        fault = f"a path of {len(name)} characters, its longest name of {longest} bytes"
        raise InputError(f"{fault}, accepted are {MAX_PATH_LENGTH} and {MAX_NAME_BYTES}", where=where)
    return name


def depth(document: JsonObject, name: str) -> float | None:
    """A depth > 0 in scene units; None where there is none."""
    value = document.get(name)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"a JSON {kind_of(value)}, expected a depth > 0", where=name)
    if not 0 < value < MAX_DEPTH:
        raise InputError(f"{str(value)[:20]}, expected a depth > 0 and below {MAX_DEPTH:g}", where=name)
    return float(value)


def kind_of(value: object) -> str:
    """JSON's word for a value's type."""
    names = {dict: "object", list: "list", str: "string", bool: "boolean", int: "number", float: "number"}
    return names.get(type(value), "null")
