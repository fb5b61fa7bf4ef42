"""Scenes that commands are given, made ready for a network: which photos, how large, and between what depths."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace

from ..errors import InputError
from ..scene.intake.layouts import load_scene
from ..scene.intake.stereo import stereo_scene
from ..scene.intake.video import video_scene
from ..scene.look import range_guessed, range_seen, thumbnail_size
from ..scene.scenes import Scene
from ..scene.viewchoice import choose_views
from .arguments import AutoViews
from .checks import sized

ALL_VIEWS = range(2, 7)
"""Numbers of photos of which all are used when none are chosen."""


def prepared(args: Namespace, scene: Scene) -> Scene:
    """The scene with the views, size and depth range that the network is to have, whether given or found."""
    chosen = _with_range(args, _chosen_views(args, scene))
    return sized(args, chosen)


def _with_range(args: Namespace, scene: Scene) -> Scene:
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
    if not args.quiet:
        found = f"near {near:.4g} and far {far:.4g}, from what the photos agree about"
        print(f"{scene.path}: {found}; --near and --far say otherwise", file=sys.stderr)
    return replace(scene, near=near, far=far)


def named_scene(args: Namespace) -> Scene:
    """The scene that `encode` names: one path, two photos of a stereo pair, or a video with `--poses`."""
    if args.poses is not None:
        if len(args.scene) != 1:
            raise InputError(f"with {len(args.scene)} paths, expected one video", where="--poses")
        return video_scene(args.scene[0], args.poses, near=args.near, far=args.far, first_number=args.first_number)
    given = [name for name in ("focal", "baseline") if getattr(args, name) is not None]
    if len(args.scene) == 1 and not given:
        return load_scene(args.scene[0], near=args.near, far=args.far)
    if len(args.scene) != 2 or len(given) != 2:
        options = " and ".join(f"--{name}" for name in given) or "neither --focal nor --baseline"
        found = f"{len(args.scene)} paths with {options}"
        raise InputError(f"{found}, expected one scene, or two photos with --focal and --baseline", where="encode")
    left, right = args.scene
    return stereo_scene(left, right, args.focal, args.baseline, near=args.near, far=args.far)


def _chosen_views(args: Namespace, scene: Scene) -> Scene:
    """The views of `--views`; without it all, or of more than a few those that see most."""
    count, asked = len(scene.frames), args.views
    if isinstance(asked, Sequence):
        if len(asked) < 2:
            raise InputError(f"{len(asked)} photo, expected two or more", where="--views")
        return scene.views(asked)
    if count < 2:
        raise InputError("one photo, expected two or more of the same place from different ones", where=str(scene.path))
    if asked is None and count in ALL_VIEWS:
        return scene
    near, far = (scene.near, scene.far) if scene.near and scene.far else range_guessed(scene.cameras)
    chosen = choose_views(scene.cameras, near, far, asked.count if asked else AutoViews.count)
    if not asked and not args.quiet:
        names = ", ".join(map(str, chosen))
        print(f"{scene.path}: views {names} of {count}; --views chooses others, --views auto:4 more", file=sys.stderr)
    return scene.views(chosen)
