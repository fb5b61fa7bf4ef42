"""Photos made ready for a network: which of them, how large, and between what depths."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace

from ..errors import InputError
from ..graphs.enlarge import LARGE_PIXELS
from ..scene.intake.layouts import load_scene
from ..scene.intake.stereo import stereo_scene
from ..scene.intake.video import video_scene
from ..scene.look import range_guessed, range_seen, thumbnail_size
from ..scene.scenes import Scene
from ..scene.viewchoice import choose_views
from .request import EncodeRequest
from .types import shown
from .words import AutoViews

ALL_VIEWS = range(2, 7)
"""Numbers of photos of which all are used when none are chosen."""


def prepared(request: EncodeRequest, notice: Callable[[str], object]) -> Scene:
    """The scene with the views, size and depth range that the network is to have, whether given or found.

    Args:
        request: what is asked for.
        notice: gets a line for each thing that was found rather than given.

    Raises:
        InputError: no scene, too few photos, views that there are not, photos that agree about no depths.
    """
    scene = named_scene(request)

    def say(text: str) -> None:
        notice(f"{scene.path}: {text}")

    return _sized(request, _with_range(_chosen_views(request, scene, say), say), say)


def named_scene(request: EncodeRequest) -> Scene:
    """The scene asked for: one that is at hand, one path, two photos of a stereo pair, or a video with its poses."""
    given = [name for name in ("focal", "baseline") if getattr(request, name) is not None]
    near, far = request.near, request.far
    if isinstance(request.scene, Scene):
        if given or request.poses is not None:
            raise InputError("with a Scene, which has its cameras; expected none", where=(*given, "poses")[0])
        scene = request.scene
        return replace(scene, near=scene.near if near is None else near, far=scene.far if far is None else far)
    paths = [request.scene] if isinstance(request.scene, str | os.PathLike) else request.scene
    is_list = isinstance(paths, Sequence) and not isinstance(paths, bytes)
    if not is_list or not all(isinstance(path, str | os.PathLike) for path in paths):
        raise InputError(f"{shown(request.scene)}, expected a Scene, a path or a list of them", where="scene")
    if request.poses is not None:
        if len(paths) != 1:
            raise InputError(f"with {len(paths)} paths, expected one video", where="--poses")
        return video_scene(paths[0], request.poses, near=near, far=far, first_number=request.first_number)
    if len(paths) == 1 and not given:
        return load_scene(paths[0], near=near, far=far)
    if len(paths) != 2 or request.focal is None or request.baseline is None:
        options = " and ".join(f"--{name}" for name in given) or "neither --focal nor --baseline"
        found = f"{len(paths)} paths with {options}"
        raise InputError(f"{found}, expected one scene, or two photos with --focal and --baseline", where="encode")
    left, right = paths
    return stereo_scene(left, right, request.focal, request.baseline, near=near, far=far)


def _chosen_views(request: EncodeRequest, scene: Scene, say: Callable[[str], None]) -> Scene:
    """The views asked for; without any all, or of more than a few those that see most."""
    count, asked = len(scene.frames), request.views
    if isinstance(asked, Sequence):
        if len(asked) < 2:
            raise InputError(f"{len(asked)} photo, expected two or more", where="--views")
        return scene.views(asked)
    if count < 2:
        raise InputError("one photo, expected two or more of the same place from different ones", where=str(scene.path))
    if asked is None and count in ALL_VIEWS:
        return scene
    near, far = (scene.near, scene.far) if scene.near and scene.far else range_guessed(scene.cameras)
    chosen = choose_views(scene.cameras, near, far, (asked or AutoViews()).count)
    if not asked:
        names = ", ".join(map(str, chosen))
        say(f"views {names} of {count}; --views chooses others, --views auto:4 more")
    return scene.views(chosen)


def _with_range(scene: Scene, say: Callable[[str], None]) -> Scene:
    """The scene between the depths that its photos agree about, where it states none."""
    if scene.near is not None and scene.far is not None:
        return scene
    if len(scene.frames) < 2:
        return scene
    small = scene.resized(*thumbnail_size(scene.cameras[0]))
    try:
        near, far = range_seen(small.images(), small.cameras)
    except InputError as error:
        raise error.within(str(scene.path)) from None
    near, far = scene.near or near, scene.far or far
    if not near < far:
        raise InputError(
            f"photos agree about depths from {near:g} to {far:g}; give --near and --far", where=str(scene.path)
        )
    say(f"near {near:.4g} and far {far:.4g}, from what the photos agree about; --near and --far say otherwise")
    return replace(scene, near=near, far=far)


def fitting_size(scene: Scene) -> tuple[int, int] | None:
    """(height, width) to which photos larger than LARGE_PIXELS are scaled; None where they are not."""
    camera = scene.frames[0].camera
    share = (LARGE_PIXELS / (camera.width * camera.height)) ** 0.5
    return (round(camera.height * share), round(camera.width * share)) if share < 1 else None


def _sized(request: EncodeRequest, scene: Scene, say: Callable[[str], None]) -> Scene:
    """The scene at the size asked for, or at one that networks are good for."""
    if isinstance(request.size, str):
        return scene
    size = request.size or fitting_size(scene)
    if size is None:
        return scene
    if not request.size:
        camera = scene.frames[0].camera
        found = f"photos of {camera.width}x{camera.height} scaled to {size[1]}x{size[0]}"
        say(f"{found}, which {request.model} is good for; --size full takes all of them")
    return scene.resized(*size)
