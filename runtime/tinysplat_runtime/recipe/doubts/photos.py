"""Photos by themselves, without their cameras: nothing on them, twice the same, borders, and what stays in place."""

import numpy as np
from numpy.typing import NDArray

from ...scene.matches import place_in_picture, staying
from .seen import Seen

BLACK = 10 / 255
"""Brightness that bars nowhere exceed, and that a thumbnail spans which shows something."""

NARROWEST = 0.03
"""Of a photo's height or width, that a bar on either side takes at least."""


def useless(seen: Seen) -> list[str]:
    """Photos of one colour, and the same photo given twice."""
    plain = [v for v, image in enumerate(seen.images) if np.ptp(image.mean(axis=-1)) < BLACK]
    lines = [f"{seen.names[v]} is of one colour, which shows nothing to find depth by" for v in plain]
    for v, image in enumerate(seen.images):
        twin = next((u for u in range(v) if np.array_equal(seen.images[u], image)), None)
        if twin is not None and v not in plain:
            lines.append(f"{seen.names[v]} is the same picture as {seen.names[twin]}, from another place")
    return lines


def bordered(seen: Seen) -> list[str]:
    """Photos with black bars on two sides or four, which are no part of what their cameras took."""
    bars = {v: bars_of(image) for v, image in enumerate(seen.images)}
    having = [v for v, sides in bars.items() if sides]
    if not having:
        return []
    who = "all photos have" if len(having) == len(bars) > 1 else f"{', '.join(seen.names[v] for v in having[:3])} has"
    fault = f"black bars at {bars[having[0]]}, which its camera did not take"
    return [f"{who} {fault}: crop them off and give the cameras of what is left"]


def bars_of(image: NDArray) -> str:
    """At which sides a photo (H, W, 3) has bars, in words; nothing where it has none."""
    light = image.max(axis=-1)
    sides = []
    for axis, words in ((1, "top and bottom"), (0, "left and right")):
        lines = light.max(axis=axis)
        lit = np.flatnonzero(lines > BLACK)
        if not len(lit):
            return ""
        first, last = int(lit[0]), int(lit[-1])
        if min(first, len(lines) - 1 - last) < NARROWEST * len(lines):
            continue
        inside = light.take([min(first + 1, last), max(last - 1, first)], axis=1 - axis)
        across = np.flatnonzero(light.max(axis=1 - axis) > BLACK)
        share = (inside > BLACK).mean() * light.shape[axis] / max(1, np.ptp(across) + 1)
        if share > 0.5:  # bars end straight, dark things do not
            sides.append(words)
    return " and ".join(sides)


def stuck(seen: Seen) -> list[str]:
    """Corners that stay at their place in the picture while all others move: a banner, a date, dirt, a frame."""
    places = staying(list(seen.places.values()))
    if len(seen.closer) < 3 or not len(places):
        return []
    camera = next(iter(seen.closer.values()))
    where = place_in_picture(places, camera.width, camera.height)
    fault = f"photos show something at one place of the picture ({where}) while all else moves"
    return [f"{fault}: a banner, a date, a frame or dirt; crop it off or mask it"]
