"""A story: named views of a scene in order, and notes on points of it, which a page shows.

    {"seconds": 6, "views": [{"title": "The desk", "text": "As it was left.", "view": "0.1,-0.4,2.1,34.5,-10"}, …],
     "notes": [{"at": [0.2, 0.1, 1.9], "text": "A lamp of 1931"}, …]}

`view` is what an address of a page has (view.js), `at` a point of the file's world, and `seconds` how long the page
stays at a view that plays by itself; 0, or nothing, does not play. The page makes and saves such files.

Trust boundary: few and short texts that print, which pages show as text, and finite numbers.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, within
from ..scene.cameras import MAX_POSITION, Camera, finite_array, posed
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
        views: (N, 7) float64: x, y, z in the world, degrees to the right and upwards, about the axis, zoom.
    """

    document: JsonObject
    views: NDArray

    def check_scene(self, points: NDArray, start: NDArray) -> None:
        """InputError where no view lies near a scene, of which there are points (N, 3), looked at from `start` (3,)."""
        low, high = np.percentile(points, (5, 95), axis=0)
        middle = (low + high) / 2
        reach = max(float(np.linalg.norm(high - low)), float(np.linalg.norm(start - middle)))
        if len(self.views) and (np.linalg.norm(self.views[:, :3] - middle, axis=1) > _FAR * reach).all():
            fault = f"all {len(self.views)} views lie far from this scene, expected a story of it"
            raise InputError(fault, where="views")

    def cameras(self, taken: Sequence[Camera], size: tuple[int, int] | None = None) -> list[Camera]:
        """Cameras of the views, as a page shows them: each with all that the nearest of the cameras `taken` has in its
        picture, times the zoom, in the middle of a picture of `size` (height, width), by default the first one's.
        """
        height, width = size or (taken[0].height, taken[0].width)
        centres, cameras = np.stack([camera.centre for camera in taken]), []
        for view in self.views:
            place, angles, zoom = view[:3], np.radians(view[3:6]), view[6]
            camera = taken[int(np.argmin(np.linalg.norm(centres - place, axis=1)))]
            scale = zoom * min(height / camera.height, width / camera.width)
            K = camera.K.copy()
            K[:2] *= scale
            K[:2, 2] += (width - scale * camera.width) / 2, (height - scale * camera.height) / 2
            cameras.append(Camera(K, posed(_turned(*angles), place), width, height))
        return cameras


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
    views, poses = [], []
    for entry in _few(fields, "views", MAX_VIEWS):
        text = _text(entry, "view", MAX_TEXT)
        poses.append(_view(text, entry.place("view")))
        views.append({"title": _text(entry, "title", MAX_TITLE), "text": _text(entry, "text", MAX_TEXT), "view": text})
    notes = []
    for entry in _few(fields, "notes", MAX_NOTES):
        at = entry.array("at", (3,))
        if np.abs(at).max() > MAX_POSITION:
            raise InputError(f"beyond {MAX_POSITION:g}", where=entry.place("at"))
        notes.append({"at": at.tolist(), "text": _text(entry, "text", MAX_TITLE)})
    return Story({"seconds": seconds, "views": views, "notes": notes}, np.reshape(poses, (-1, 7)))


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
    """(7,) x, y, z, right, up, roll, zoom; the last two may be left out."""
    try:
        numbers = [float(number) for number in text.split(",")]
    except ValueError:
        numbers = []
    is_finite = all(math.isfinite(number) and abs(number) <= MAX_POSITION for number in numbers)
    if not 5 <= len(numbers) <= 7 or not is_finite or not 1 <= (numbers[6:] or [1.0])[0] <= 10:
        raise InputError(f"'{text[:60]}', expected x,y,z,right,up,roll,zoom as an address of a page has", where=where)
    return finite_array(where, numbers + [0.0, 1.0][len(numbers) - 5 :], (7,))


def _turned(right: float, up: float, roll: float) -> NDArray:
    """(3, 3) camera-to-world rotation, from looking along z with y down; radians."""
    x = np.array([math.cos(right), 0, -math.sin(right)])
    z = np.array([math.sin(right) * math.cos(up), -math.sin(up), math.cos(right) * math.cos(up)])
    y, cos, sin = np.cross(z, x), math.cos(roll), math.sin(roll)
    return np.stack([cos * x + sin * y, cos * y - sin * x, z], axis=-1)
