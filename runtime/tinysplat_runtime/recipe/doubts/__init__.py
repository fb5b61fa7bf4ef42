"""Whether photos, cameras and depths belong together: a look before the network runs, with one module per evidence.

intrinsics.py  numbers that no camera has, and units in which nothing is drawn
photos.py      photos by themselves, and what stays in place on all of them
corners.py     corners that photos have in common, which tell cameras and single photos, whatever depths are
colours.py     how bright and of which colours photos show the same corners
sweep.py       colours over depths, for the range where corners say nothing
seen.py        what all of them look at
"""

from collections.abc import Callable, Sequence

from ...scene.scenes import Scene
from ...system.told import NOBODY, Told
from .colours import colour_doubts
from .corners import alone, misread, range_of_corners
from .intrinsics import impossible, too_near
from .photos import bordered, stuck, useless
from .seen import Seen
from .sweep import range_doubts

KINDS: tuple[Callable[[Seen], list[str]], ...] = (
    useless,
    impossible,
    too_near,
    bordered,
    stuck,
    misread,
    colour_doubts,
    alone,
    range_of_corners,
    range_doubts,
)
"""Each gives a line for what it finds; the likeliest cause of what others would see comes first."""

OF_NO_RANGE = tuple(kind for kind in KINDS if kind not in (range_of_corners, range_doubts))
"""Those that ask for no depths."""


def doubts(scene: Scene, told: Told = NOBODY, kinds: Sequence[Callable[[Seen], list[str]]] = KINDS) -> list[str]:
    """What is likely wrong with a scene, a line each: its cameras, a photo, its depth range; the likeliest first.

    Args:
        scene: the photos as the network will have them.
        told: is told of each photo.
        kinds: of evidence that are looked at.
    """
    seen = Seen.of(scene, told)
    return next((lines for kind in told.progress("checking cameras", kinds) if (lines := kind(seen))), [])
