"""A story: named views of a scene in order, and notes on points of it, which a page shows.

    {"seconds": 6, "views": [{"title": "The desk", "text": "As it was left.", "view": "0.1,-0.4,2.1,34.5,-10"}, …],
     "notes": [{"at": [0.2, 0.1, 1.9], "text": "A lamp of 1931"}, …]}

`view` is what an address of a page has (view.js), `at` a point of the file's world, and `seconds` how long the page
stays at a view that plays by itself; 0, or nothing, does not play. The page makes and saves such files.

Trust boundary: few and short texts that print, which pages show as text, and finite numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, within
from ..scene.cameras import MAX_POSITION, finite_array
from ..scene.intake.fields import Fields
from ..system.files import StrPath, read_limited
from ..system.jsonfields import JsonObject, parse_object
from ..system.printable import unprinted

MAX_BYTES, MAX_VIEWS, MAX_NOTES = 2_000_000, 200, 1000
"""Of a file, and how many views and notes it may have."""

MAX_TITLE, MAX_TEXT, MAX_SECONDS = 120, 1000, 600
"""Characters, and seconds at a view."""

_FAR = 20.0  # times as far from a scene's middle as it is wide, or the page begins: a view of something else


@dataclass(frozen=True, eq=False)
class Story:
    """What a page tells.

    Attributes:
        document: JSON-ready, as the page takes it: seconds, views, notes; nothing else.
        places: (N, 3) float64 where views are taken from, world.
    """

    document: JsonObject
    places: NDArray

    def check_scene(self, points: NDArray, start: NDArray) -> None:
        """InputError where no view lies near a scene, of which there are points (N, 3), looked at from `start` (3,)."""
        low, high = np.percentile(points, (5, 95), axis=0)
        middle = (low + high) / 2
        reach = max(float(np.linalg.norm(high - low)), float(np.linalg.norm(start - middle)))
        if len(self.places) and (np.linalg.norm(self.places - middle, axis=1) > _FAR * reach).all():
            fault = f"all {len(self.places)} views lie far from this scene, expected a story of it"
            raise InputError(fault, where="views")


def load_story(path: StrPath) -> Story:
    """Read a story.

    Raises:
        InputError: names the file and the field: missing, too long, with what does not print, or no number.
    """
    with within(str(path)):
        return story_of(parse_object(read_limited(path, MAX_BYTES)))


def story_of(document: JsonObject) -> Story:
    """Check a story; errors of `load_story`."""
    fields = Fields(document)
    seconds = fields.number("seconds", 0)
    if not 0 <= seconds <= MAX_SECONDS:
        raise InputError(f"{seconds:g}, expected 0 to {MAX_SECONDS}", where="seconds")
    views, places = [], []
    for entry in _few(fields, "views", MAX_VIEWS):
        text = _text(entry, "view", MAX_TEXT)
        places.append(_view(text, entry.place("view"))[:3])
        views.append({"title": _text(entry, "title", MAX_TITLE), "text": _text(entry, "text", MAX_TEXT), "view": text})
    notes = []
    for entry in _few(fields, "notes", MAX_NOTES):
        at = entry.array("at", (3,))
        if np.abs(at).max() > MAX_POSITION:
            raise InputError(f"beyond {MAX_POSITION:g}", where=entry.place("at"))
        notes.append({"at": at.tolist(), "text": _text(entry, "text", MAX_TITLE)})
    return Story({"seconds": seconds, "views": views, "notes": notes}, np.reshape(places, (-1, 3)))


def _few(fields: Fields, name: str, most: int) -> list[Fields]:
    entries = fields.each(name)
    if len(entries) > most:
        raise InputError(f"{len(entries)}, expected at most {most}", where=name)
    return entries


def _text(entry: Fields, name: str, most: int) -> str:
    text, where = entry.value(name, ""), entry.place(name)
    if not isinstance(text, str) or len(text) > most:
        fault = f"{len(text)} characters" if isinstance(text, str) else f"{str(text)[:40]}"
        raise InputError(f"{fault}, expected text of at most {most}", where=where)
    if (bad := unprinted(text)) is not None:
        raise InputError(f"holds U+{ord(bad):04X}, expected characters that print", where=where)
    return text


def _view(text: str, where: str) -> NDArray:
    """x, y, z, right, up, roll, zoom; the last two may be left out."""
    try:
        numbers = [float(number) for number in text.split(",")]
    except ValueError:
        numbers = []
    is_finite = all(math.isfinite(number) and abs(number) <= MAX_POSITION for number in numbers)
    if not 5 <= len(numbers) <= 7 or not is_finite or not 1 <= (numbers[6:] or [1.0])[0] <= 10:
        raise InputError(f"'{text[:60]}', expected x,y,z,right,up,roll,zoom as an address of a page has", where=where)
    return finite_array(where, numbers, (-1,))
