"""What can be asked for where cameras are found: every option of `tinysplat poses`."""

import math
from dataclasses import dataclass

from tinysplat_runtime.render.panorama import FACES
from tinysplat_runtime.scene.footage import SUFFIXES as VIDEOS
from tinysplat_runtime.system import kinds
from tinysplat_runtime.system.files import StrPath
from tinysplat_runtime.system.options import REQUIRED, Options, flag, option

from .panoramas import Wedge

frame_count = kinds.such(kinds.whole, lambda count: 2 <= count <= 1000, "a whole number of 2 to 1000")


def part(given: object) -> Wedge | str:
    """`150-210`, longitudes of a 360° picture in degrees to the right of its middle; or a cube's face."""
    if isinstance(given, Wedge):
        return given
    if (text := kinds.text(given)) in FACES:
        return text
    first, dash, last = text.rpartition("-")
    try:
        wedge = Wedge(float(first), float(last))
    except ValueError:
        wedge = Wedge(math.nan, math.nan)
    if not (dash and -360 <= wedge.first < wedge.last <= 360 and wedge.last - wedge.first < 360):
        raise kinds.refused(given, f"degrees such as 150-210, or one of {', '.join(FACES)}")
    return wedge


@dataclass(frozen=True, kw_only=True)
class PosesRequest(Options):
    """Photos without cameras, or a video, to be made into a scene, and how.

    Raises:
        InputError: a value of another kind or out of range.
    """

    photos: StrPath = option(
        kinds.path,
        REQUIRED,
        is_bare=True,
        metavar="PHOTOS",
        help=f"folder of photos (.jpg, .png, .heic, .webp, .tif) of one static place, or a video: {', '.join(VIDEOS)}",
    )
    panorama: bool = flag(
        word="360", help="pictures twice as wide as high are 360° (equirectangular), also if files do not say so"
    )
    without: tuple[Wedge | str, ...] = option(
        part,
        (),
        is_many=True,
        metavar="A-B|down|up",
        help="leave out of 360° pictures: longitudes from A to B, degrees to the right of the middle, or a cube's face",
    )
    frames: int | None = option(frame_count, metavar="N", help="of a video; default: by its movement, 16 to 64")
    threads: int | None = option(kinds.count, metavar="N", help="default: all cores; changes no result")
