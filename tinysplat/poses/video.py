"""Frames of a video as photos: sharp ones, apart by what the camera moved, and more where few could be placed."""

from pathlib import Path

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.scene.footage import open_video
from tinysplat_runtime.scene.masks import Mask
from tinysplat_runtime.system.told import Told

from .copies import encoded
from .frames import look_through
from .judging import Placement
from .placing import MASKS, NonePlacedError, Taken, place
from .remarks import ENOUGH, check_placement, unplaced
from .request import PosesRequest
from .still import masked_still, still_masks

SPARED = 0.1
"""Of a video's frames, that may be missing before more are added."""

ROUNDS = 3
"""In which frames are placed, each with more of them."""


def taken_as_frames(request: PosesRequest, photos: Path, told: Told) -> Taken:
    """Frames of a video, written to `photos`, and where they were taken.

    Raises:
        InputError: under two thirds could be placed, or what was found is no scene.
    """
    source = Path(request.photos)
    video = open_video(source)
    walk = look_through(video, told)
    if request.frames is not None and request.frames > len(walk.indices):
        raise InputError(f"{len(walk.indices)} frames, expected {request.frames} or more")
    names: dict[int, str] = {}
    found: list[tuple[dict[int, str], frozenset[str], Placement | None]] = []
    added = walk.chosen(request.frames)
    masks: dict[str, Mask] = {}
    while added and len(found) < ROUNDS:
        for index, picture in told.progress("taking frames", video.frames(added), total=len(added)):
            names[index] = f"frame_{index:06}.jpg"
            (photos / names[index]).write_bytes(encoded(picture, names[index]))
        names = dict(sorted(names.items()))
        told.say("notice", f"{len(names)} of {len(video.stamps)} frames, chosen for overlap and sharpness", source)
        if not found:
            masks = masked_still(source, list(names.values()), photos)
        elif masks:
            masks, _ = still_masks(photos, list(names.values()), photos.with_name(MASKS))
        try:
            frames = dict.fromkeys(names.values())  # of one lens
            placement = place(photos, list(frames), photos.parent, request.threads or -1, lenses=frames, told=told)
        except NonePlacedError:
            placement = None
        right = placement.right if placement else frozenset()
        found.append((names, right, placement))
        missing = {index for index, name in names.items() if name not in right}
        is_enough = request.frames is not None or len(missing) <= SPARED * len(names)
        added = [] if is_enough else walk.between(list(names), missing)
    names, right, placement = max(found, key=lambda one: (len(one[1]) >= ENOUGH * len(one[0]), len(one[1])))
    if placement is not None and placement.only_turns:
        check_placement(placement)
    if placement is None or len(right) < ENOUGH * len(names):
        times = (video.stamps - video.stamps[0]) * video.unit
        raise InputError(unplaced([(float(times[i]), name in right) for i, name in names.items()]))
    check_placement(placement)
    return Taken({name: name for name in names.values()}, masks, placement)
