"""Notes in the comments of a .ply file's header: `comment attribution: …` and so on, in ASCII with JSON's escapes.

That Gaussians are antialiased is said as Brush and splat-transform say it, `SplatRenderMode: mip`, or Postshot,
`antialiased 1`. Trust boundary: what is read goes through the checks of `Notes`, whoever wrote it.
"""

import json
import re
from pathlib import Path

from ..gaussian.notes import NAMES, YES, Notes

_IN_WORDS = "|".join(name for name in NAMES if name != "antialiased")
_COMMENT = re.compile(rf"^comment ({_IN_WORDS}): ?(.*?)\r?$", re.MULTILINE)
_DRAWN = re.compile(r"^comment[ \t]+(?:SplatRenderMode:|antialiased)[ \t]+(\w+)[ \t\r]*$", re.MULTILINE | re.IGNORECASE)
_MAX_HEADER_BYTES = 1 << 16


def ply_comments(notes: Notes) -> list[str]:
    """Lines for the header of a .ply file."""
    texts = {name: text for name, text in notes.given().items() if name != "antialiased"}
    drawn = ["SplatRenderMode: mip"] if notes.antialiased else []
    return [*(f"{name}: {json.dumps(text)[1:-1]}" for name, text in texts.items()), *drawn]


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
