"""Notes in Gaussian files of other tools: as JSON in .npz, as metadata in .safetensors, as comments in .ply.

    .npz           array `notes`, the UTF-8 bytes of an object with any of unit, attribution and licence
    .safetensors   metadata of these names
    .ply           `comment attribution: …` and so on in the header, in ASCII with JSON's escapes; that Gaussians are
                   antialiased as Brush and splat-transform say it, `SplatRenderMode: mip`, or Postshot, `antialiased 1`

Trust boundary: what is read goes through the checks of `Notes`, whoever wrote it.
"""

from __future__ import annotations

import json
import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..gaussian.notes import MAX_BYTES, NAMES, YES, Notes
from ..system.files import parsing

NPZ_ARRAY = "notes"

_MAX_JSON_BYTES = 6 * sum(MAX_BYTES.values())  # escapes take up to six bytes for one
_IN_WORDS = "|".join(name for name in NAMES if name != "antialiased")
_COMMENT = re.compile(rf"^comment ({_IN_WORDS}): ?(.*?)\r?$", re.MULTILINE)
_DRAWN = re.compile(r"^comment[ \t]+(?:SplatRenderMode:|antialiased)[ \t]+(\w+)[ \t\r]*$", re.MULTILINE | re.IGNORECASE)
_MAX_HEADER_BYTES = 1 << 16


def ply_comments(notes: Notes) -> list[str]:
    """Lines for the header of a .ply file."""
    texts = {name: text for name, text in notes.given().items() if name != "antialiased"}
    drawn = ["SplatRenderMode: mip"] if notes.antialiased else []
    return [*(f"{name}: {json.dumps(text)[1:-1]}" for name, text in texts.items()), *drawn]


def npz_notes(path: Path) -> dict[str, str]:
    """Fields of `Notes` in an .npz file.

    Raises:
        InputError: a damaged file, or text that is no JSON object.
    """
    name = f"{NPZ_ARRAY}.npy"
    with parsing(".npz file"), zipfile.ZipFile(path) as archive:
        if name not in archive.namelist():
            return {}
        if archive.getinfo(name).file_size > _MAX_JSON_BYTES:
            raise InputError(f"more than {_MAX_JSON_BYTES} bytes", where=NPZ_ARRAY)
        with archive.open(name) as member:
            data = np.lib.format.read_array(member, allow_pickle=False).tobytes()
    try:
        document = json.loads(data)
    except (ValueError, RecursionError):
        raise InputError("not JSON", where=NPZ_ARRAY) from None
    if not isinstance(document, dict):
        raise InputError("not a JSON object", where=NPZ_ARRAY)
    return _known(document)


def safetensors_notes(path: Path) -> dict[str, str]:
    """Fields of `Notes` in the metadata of a .safetensors file."""
    import safetensors

    with parsing(".safetensors file"), safetensors.safe_open(str(path), framework="numpy") as file:
        return _known(file.metadata() or {})


def ply_notes(path: Path) -> dict[str, str]:
    """Fields of `Notes` in the comments of a .ply file."""
    with path.open("rb") as file:
        header = file.read(_MAX_HEADER_BYTES).partition(b"end_header")[0].decode("utf-8", "replace")
    drawn = (_DRAWN.findall(header) or [""])[-1].lower() in ("mip", "1")
    return {name: _unescaped(text) for name, text in _COMMENT.findall(header)} | ({"antialiased": YES} if drawn else {})


def _unescaped(text: str) -> str:
    """Text of JSON's escapes, or as it stands where another program wrote it."""
    try:
        return str(json.loads(f'"{text}"'))
    except ValueError:
        return text


def _known(document: Mapping[str, Any]) -> dict[str, Any]:
    return {name: document[name] for name in NAMES if name in document}
