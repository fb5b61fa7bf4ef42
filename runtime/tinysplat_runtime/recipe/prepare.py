"""Photos made ready for a network: which of them, how large, and between what depths."""

import math
import os
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..container.layout import MAX_VIEWS
from ..errors import InputError, within
from ..modes import PHOTOS
from ..network.enlarge import LARGE_PIXELS
from ..scene import BACKGROUND, MOVING
from ..scene.intake.layouts import load_scene
from ..scene.intake.stereo import stereo_scene
from ..scene.intake.video import video_scene
from ..scene.look import LOOK_WIDTH, range_guessed, range_seen, thumbnail_size
from ..scene.neighbours import LEAST_BASELINE, Neighbours
from ..scene.scenes import Frame, Scene
from ..scene.spacing import Spacing
from ..scene.turned import as_cameras_have_them
from ..scene.viewchoice import ALL_VIEWS, SPACING, choose_views, needed_views, sharpness_of
from ..system.kinds import shown
from ..system.printable import enumerated
from ..system.told import NOBODY, Told
from .doubts import OF_NO_RANGE, doubts
from .request import EncodeRequest
from .words import ALL, NO, AutoViews

RANGE_VIEWS = 24
"""Photos of a capture that are looked at for its depth range."""

RANGE_SIDE = 64
"""Longer side of their thumbnails, pixels: larger ones find the same in several times the seconds."""

SAME_PLACE = 1e-9
"""Of the largest coordinate: what cameras at one place differ by."""

WIDE = 200.0
"""Times near that far is, from which on a stated range is held against what photos agree about."""

SAID_CROP, MOST_CROP = 0.01, 1 / 3
"""Of a photo: a crop of more than the first is said, and one of more than the second refused, as width and height may
have been exchanged; a square of it is always meant."""


def prepared(request: EncodeRequest, told: Told = NOBODY) -> Scene:
    """The scene with the views, size and depth range that the network is to have, whether given or found.

    Args:
        request: what is asked for.
        told: is told of each thing that was found rather than given, and of the photos of each step.

    Raises:
        InputError: no scene, too few photos, views that there are not, photos that agree about no depths.
    """
    scene = named_scene(request)
    if request.masks is not None:
        scene = scene.with_masks(None if request.masks == NO else request.masks)
    if (stored := as_cameras_have_them(scene)) is not scene:
        told.say(
            "notice", "photos are taken as stored, which fits their cameras; Exif orientation turns them", scene.path
        )
        scene = stored
    chosen, why = _chosen_views(request, scene, told)
    _say_wide(chosen, told)
    sized = _masked(request, _sized(request, chosen, told), told)
    photos = len(sized.frames)
    if photos > MAX_VIEWS:
        fault = f"{photos} photos, a file has at most {MAX_VIEWS} views; --views auto:{MAX_VIEWS} chooses so many"
        raise InputError(fault, where=str(scene.path))
    spacing = Spacing.of(chosen.cameras, *chosen.depth_range())
    apart = spacing.said([name_of(frame) for frame in chosen.frames])
    if photos in ALL_VIEWS:
        if not spacing.is_good:
            told.say("notice", apart, scene.path)
        return sized
    others = "--views all takes every one" if photos < len(scene.frames) else "--views auto:N takes N"
    told.say("notice", f"{photos} of {len(scene.frames)} photos, {why}; {others}", scene.path)
    told.say("notice", apart, scene.path)
    return sized


def named_scene(request: EncodeRequest) -> Scene:
    """The scene asked for: one that is at hand, one path, two photos of a stereo pair, or a video with its poses."""
    given = [name for name in ("focal", "baseline") if getattr(request, name) is not None]
    near, far = request.near, request.far
    if isinstance(request.scene, Scene):
        if given or request.poses is not None:
            raise InputError("with a Scene, which has its cameras; expected none", where=(*given, "poses")[0])
        return request.scene.between(near, far)
    paths = [request.scene] if isinstance(request.scene, str | os.PathLike) else request.scene
    is_list = isinstance(paths, Sequence) and not isinstance(paths, bytes)
    if not is_list or not all(isinstance(path, str | os.PathLike) for path in paths):
        raise InputError(f"{shown(request.scene)}, expected a Scene, a path or a list of them", where="scene")
    if request.poses is not None:
        if len(paths) != 1:
            raise InputError(f"with {len(paths)} paths, expected one video", where="poses")
        return video_scene(paths[0], request.poses, near=near, far=far, first_number=request.first_number)
    if len(paths) == 1 and not given:
        return load_scene(paths[0], near=near, far=far)
    if len(paths) == 1:
        fault = "one path, expected the left and the right photo of a stereo pair"
        raise InputError(f"{fault}: a scene has its cameras", where=given[0])
    if len(paths) != 2 or request.focal is None or request.baseline is None:
        fault = f"{len(paths)} paths with{' ' if given else 'out '}--focal and --baseline"
        raise InputError(f"{fault}, expected one scene, or two photos with --focal and --baseline", where="encode")
    left, right = paths
    return stereo_scene(left, right, request.focal, request.baseline, near=near, far=far)


def _chosen_views(request: EncodeRequest, scene: Scene, told: Told) -> tuple[Scene, str]:
    """The views that are asked for or needed, with their depth range, and in words how they were chosen."""
    count, asked = len(scene.frames), request.views
    if isinstance(asked, tuple) and len(asked) < 2:
        raise InputError(f"{len(asked)} photo, expected two or more", where="views")
    if count < 2:
        raise InputError("one photo, expected two or more of the same place from different ones", where=str(scene.path))
    wanted = asked.count if isinstance(asked, AutoViews) else None
    named = _numbered(scene, asked) if isinstance(asked, tuple) else None
    _check_moving(named or scene)
    if named is None and wanted is not None and (wanted in ALL_VIEWS or wanted > count):
        named = _seeing_most(scene, wanted, told)
    scene = _matching(_with_range(named or _once(scene, told), told), told)
    if named is not None:
        return scene, "as asked"
    if asked == ALL or (asked is None and count in ALL_VIEWS):
        return scene, "all there are"
    needed = needed_views(
        scene.cameras, *scene.depth_range(), wanted, lambda view: sharpness_of(scene.frames[view].image())
    )
    within = f"{100 * SPACING:.0f} % of the depth and {math.degrees(SPACING):.0f}°"
    why = f"any left out lie within {within} of one of them"
    return _matching(scene.views(needed), NOBODY), "as asked" if wanted else why


def _seeing_most(scene: Scene, count: int, told: Told) -> Scene:
    """So many photos that see most; says which."""
    seen = choose_views(scene.cameras, *_range_or_guess(scene), count)
    numbers = (str(v if (own := scene.frames[v].number) is None else own) for v in seen)
    text = f"views {','.join(numbers)} of {len(scene.frames)}, which see most; --views chooses others"
    told.say("notice", text, scene.path)
    return scene.views(seen)


def _numbered(scene: Scene, numbers: Sequence[int]) -> Scene:
    """The scene of photos by their numbers in its file; InputError where one of these is not there."""
    known = {v if frame.number is None else frame.number: v for v, frame in enumerate(scene.frames)}
    if absent := [number for number in numbers if number not in known and number < max(known)]:
        raise InputError(f"the photo of view {absent[0]} is not there, expected others", where=str(scene.path))
    return scene.views(known.get(number, number) for number in numbers)


def _check_moving(scene: Scene) -> None:
    """InputError unless cameras stand at more than one place."""
    centres = np.stack([camera.centre for camera in scene.cameras])
    extent = float(np.linalg.norm(np.ptp(centres, axis=0)))
    depth = 2 / (1 / scene.near + 1 / scene.far) if scene.near and scene.far else 0.0
    if extent > max(LEAST_BASELINE * depth, SAME_PLACE * float(np.abs(centres).max())):
        return
    fault = "the cameras only turn: photos from one place show no depth; take some from places beside each other"
    if extent > SAME_PLACE * float(np.abs(centres).max()):
        depths = f"depths from {scene.near:g} to {scene.far:g}, which do not show from there"
        fault = f"all cameras stand within {extent:.3g}, far too near for {depths}"
        fault += ": the cameras only turn, or near and far are in other units than the poses; --near and --far say so"
    raise InputError(fault, where=str(scene.path))


def _once(scene: Scene, told: Told) -> Scene:
    """A scene without photos taken as an earlier one, by the same camera from the same place; says so."""
    first: dict[bytes, int] = {}
    for v, camera in enumerate(scene.cameras):
        first.setdefault(camera.c2w.tobytes() + camera.K.tobytes(), v)
    kept = sorted(first.values())
    if len(kept) < len(scene.frames):
        again = [frame.path.name for v, frame in enumerate(scene.frames) if v not in set(kept)]
        told.say("notice", f"left out {enumerated(again)}: taken from the same place as another", scene.path)
    return scene.views(kept)


def name_of(frame: Frame) -> str:
    """What people know a photo by."""
    return frame.path.name if frame.video is None else f"frame {frame.index}"


def _matching(scene: Scene, told: Told) -> Scene:
    """A capture without photos that show nothing that others do; says so, and where it falls into several places."""
    if len(scene.frames) in ALL_VIEWS:
        return scene
    neighbours = Neighbours.of(scene.cameras, *scene.depth_range())
    kept = [v for v, partners in enumerate(neighbours.partners) if partners]
    alone = [frame.path.name for v, frame in enumerate(scene.frames) if v not in kept]
    if not kept:
        fault = "no photo shows from another place what one does: cameras that stand at one place show no depth"
        raise InputError(f"{fault}, nor those that have nothing in common", where=str(scene.path))
    if alone:
        told.say(
            "notice", f"left out {enumerated(alone)}: nothing in common with other photos from other places", scene.path
        )
        scene = scene.views(kept)
    parts = sorted((len(part) for part in neighbours.parts() if len(part) > 1), reverse=True)
    if len(parts) > 1:
        sizes = ", ".join(map(str, parts[:4])) + (", …" if len(parts) > 4 else "")
        told.say(
            "notice",
            f"{len(parts)} places that have nothing in common, of {sizes} photos: all are coded; --views takes some",
            scene.path,
        )
    return scene


def _range_or_guess(scene: Scene) -> tuple[float, float]:
    return (scene.near, scene.far) if scene.near and scene.far else range_guessed(scene.cameras)


def _with_range(scene: Scene, told: Told) -> Scene:
    """The scene between the depths that its photos agree about, where it states none."""
    if scene.near is not None and scene.far is not None:
        return scene
    try:
        near, far = _range_seen(scene, told)
    except InputError as error:
        raise _caused(error, scene) from None
    near, far = scene.near or near, scene.far or far
    if not near < far:
        raise InputError(
            f"photos agree about depths from {near:g} to {far:g}; give --near and --far", where=str(scene.path)
        )
    told.say(
        "notice",
        f"near {near:.4g} and far {far:.4g}, estimated from the photos; --near and --far say otherwise",
        scene.path,
    )
    return replace(scene, near=near, far=far, is_estimated=True)


def _range_seen(scene: Scene, told: Told) -> tuple[float, float]:
    """(near, far) by thumbnails of its photos, of many by a few that are spread as well as can be without it."""
    if len(scene.frames) > RANGE_VIEWS:
        scene = scene.views(needed_views(scene.cameras, *_range_or_guess(scene), RANGE_VIEWS))
    side = LOOK_WIDTH if len(scene.frames) in ALL_VIEWS else RANGE_SIDE
    small = scene.resized(*thumbnail_size(scene.cameras[0], side))
    with within(str(scene.path)):
        return range_seen(small.images(told), small.cameras, told)


def _caused(error: InputError, scene: Scene) -> InputError:
    """An error of photos that agree about no depth, with what is wrong with one of them or with their cameras."""
    near, far = range_guessed(scene.cameras)
    try:
        causes = doubts(replace(scene, near=near, far=far, is_estimated=True), kinds=OF_NO_RANGE)
    except InputError:  # photos of several sizes, or cameras that a guess does not do for
        causes = []
    return InputError("; ".join([error.message, *causes[:1]]), where=error.where)


def _say_wide(scene: Scene, told: Told) -> None:
    """Say what photos agree about, where a range is stated in which hardly any depth that is tried can fit."""
    near, far = scene.depth_range()
    if scene.is_estimated or far < WIDE * near:
        return
    try:
        seen = "about depths from {:.4g} to {:.4g}".format(*_range_seen(scene, told))
    except InputError:
        seen = "about none"
    told.say("notice", f"near {near:g} and far {far:g} span 1:{far / near:.4g}; photos agree {seen}", scene.path)


def fitting_size(scene: Scene) -> tuple[int, int] | None:
    """(height, width) of at most LARGE_PIXELS to which larger photos are scaled; None where they are not."""
    camera = scene.frames[0].camera
    share = (LARGE_PIXELS / (camera.width * camera.height)) ** 0.5
    if share >= 1:
        return None
    height, width = round(camera.height * share), round(camera.width * share)
    return (
        (height, width) if height * width <= LARGE_PIXELS else (int(camera.height * share), int(camera.width * share))
    )


def _sized(request: EncodeRequest, scene: Scene, told: Told) -> Scene:
    """The scene at the size asked for, or at one that networks are good for."""
    if isinstance(request.size, str):
        return scene
    size = request.size or fitting_size(scene)
    if size is None:
        return scene
    camera = scene.frames[0].camera
    if request.size:
        _say_crop(scene, request.size, told)
    else:
        said = f"photos of {camera.width}x{camera.height} scaled to {size[1]}x{size[0]}"
        told.say(
            "notice",
            f"{said}, the largest size that the network `{request.model}` handles well; --size full keeps all pixels",
            scene.path,
        )
    return scene.resized(*size)


def _masked(request: EncodeRequest, scene: Scene, told: Told) -> Scene:
    """The scene without photos of which masks leave nothing; says how much they leave out, and as what."""
    if not any(frame.mask for frame in scene.frames):
        if request.masks in (MOVING, BACKGROUND):
            sought = "expected masks/NAME.png, NAME.mask.png, a frame's mask_path, or transparent photos"
            raise InputError(f"{request.masks}, but no photo has a mask; {sought}", where="masks")
        return scene
    if request.mode == PHOTOS:
        said = f"masks have no effect with --mode {request.mode}, whose files carry the photos themselves"
        told.say("notice", said, scene.path)
        return scene.with_masks(None)
    out = {v: 1 - float(known.mean()) for v, frame in enumerate(scene.frames) if (known := frame.known()) is not None}
    nothing = [v for v, share in out.items() if share == 1]
    kept = [v for v in range(len(scene.frames)) if v not in nothing]
    if len(kept) < 2:
        fault = f"masks leave nothing of {len(nothing)} of {len(scene.frames)} photos"
        raise InputError(f"{fault}: black is left out, white is kept; --no-masks ignores them", where=str(scene.path))
    if nothing:
        names = enumerated([name_of(scene.frames[v]) for v in nothing])
        told.say("notice", f"left out {names}: their masks leave nothing of them", scene.path)
    for meaning, words in ((MOVING, "what moves"), (BACKGROUND, "background, where nothing is")):
        shares = [out[v] for v in kept if v in out and scene.frames[v].is_on_background == (meaning == BACKGROUND)]
        if shares:
            said = f"masks leave out {np.mean(shares):.0%} of {len(shares)} photos as {words}"
            told.say(
                "notice", f"{said}; --masks {MOVING if meaning == BACKGROUND else BACKGROUND} or --no-masks", scene.path
            )
    return scene.views(kept)


def _say_crop(scene: Scene, size: tuple[int, int], told: Told) -> None:
    """Say what photos lose that are cut to a size, (height, width); too much of them is likely not meant."""
    photo = scene.cameras[0].height, scene.cameras[0].width
    scale = max(wanted / side for wanted, side in zip(size, photo, strict=True))
    lost = 1 - size[0] * size[1] / (photo[0] * photo[1] * scale**2)
    if lost < SAID_CROP:
        return
    side = "width" if photo[1] * scale > size[1] + 0.5 else "height"
    said = f"{size[1]}x{size[0]} cuts off {lost:.0%} of the {side} of photos of {photo[1]}x{photo[0]}"
    fitting = [(round(photo[0] * share), round(photo[1] * share)) for share in (scale, scale * (1 - lost))]
    whole = " and ".join(f"{width}x{height}" for height, width in fitting)
    if lost > MOST_CROP and size[0] != size[1]:
        raise InputError(f"{said}; {whole} keep them whole", where="size")
    told.say("notice", f"{said}; {whole} keep them whole", scene.path)
