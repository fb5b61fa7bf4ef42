"""`tinysplat render`: which cameras look, and pictures, depth maps and videos as files."""

import sys
from argparse import Namespace
from collections.abc import Sequence
from functools import partial
from itertools import chain, groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..container.layout import SUFFIX
from ..errors import InputError, within
from ..gaussian.gaussians import Gaussians
from ..render import Renderer, between, orbit
from ..render.panorama import panorama, panorama_png
from ..render.paths import halting, outside
from ..scene.cameras import Camera
from ..scene.frusta import middle_depth
from ..scene.pictures import png_bytes
from ..system.stopwatch import Stopwatch, peak_rss_bytes
from .asks import Render
from .files import Reading, read_file, write_file, write_json
from .options import asked, named
from .outputs import STANDARD

DEEPEST = 65535
"""Largest value of a depth map's 16 bits."""

FRAMES, FRAMES_A_VIEW = 60, 8
"""Of a video where none are asked for: at least the first, and the second from view to view."""

VIEW_SECONDS, WAY_SECONDS = 5.0, 2.0
"""Of a story's film: for a view where the story does not say, and, of these, at most half, for the way to the next."""

FPS, PANORAMA = 30, (1024, 2048)


def render(args: Namespace) -> None:
    """A picture or a video of Gaussians."""
    own, reading, watch = asked(args, Render), asked(args, Reading), Stopwatch()
    suffix = ".png" if own.output == STANDARD else Path(own.output).suffix.lower()
    if suffix not in (".png", ".mp4"):
        raise InputError(f"'{suffix}', accepted are .png and .mp4", where=own.output)
    with named(own.options()):
        own.check_output("-.png" if own.output == STANDARD else own.output)
    if own.panorama and own.size and own.size[1] != 2 * own.size[0]:
        raise InputError("a 360° picture is twice as wide as high, such as 2048x1024", where="--size")
    gaussians = reading.load(own.file, reading.runtime(own.voice), watch)
    is_many, wants_depth = suffix == ".mp4" or own.panorama, own.depth or own.depth_values
    # Loading compiled code takes longer than drawing one picture without it.
    renderer = Renderer(
        gaussians.flat() if own.panorama else gaussians,  # which views are near would differ from face to face
        reading.threads,
        dilation=own.dilation,
        order=own.order,
        compiled=None if is_many else False,
        keep=is_many,
    )
    if own.panorama:
        camera, height = _chosen_camera(own.camera, gaussians), (own.size or PANORAMA)[0]
        down = sum((one.rotation[1] for one in gaussians.cameras or gaussians.viewpoints), 0 * camera.centre)
        with watch.stage("render"):
            draw = partial(renderer.render, background=own.background)
            picture = panorama(draw, camera, down, height)
        write_file(own.output, panorama_png(picture))
    elif suffix == ".png":
        camera = _chosen_camera(own.camera, gaussians)
        with watch.stage("render"):
            wanted = ("depth",) if wants_depth else ("rgb",)
            image = renderer.render(camera, own.size, outputs=wanted, background=own.background)
        if wants_depth:
            image = (
                depth_map(own.output, image["depth"], own.depth_scale)
                if own.depth_values
                else depth_colours(image["depth"])
            )
        write_file(own.output, png_bytes(image))
    else:
        from ..render.video import write_video

        if own.story:
            path = _story_path(gaussians, own.story, own.camera, own.frames, own.size)
        else:
            path = _camera_path(gaussians, own.file, own.camera, own.path, own.frames)
        with watch.stage("render"):
            # libx264 codes on threads of its own while the next frame is drawn; drawing ahead of it gains nothing.
            drawn = groupby(path, key=id)  # one that stands still is drawn once
            pictures = ((renderer.render(next(same), own.size, background=own.background), same) for _, same in drawn)
            frames = (picture for picture, same in pictures for _ in chain([0], same))
            write_video(own.output, own.voice.progress("render", frames, total=len(path)), FPS)
    if own.report:
        from ..container.inspection import inspect_bytes
        from ..recipe.report import file_report

        about = {"gaussians": gaussians.count, "sh_degree": gaussians.degree}
        report = {**about, "seconds": watch.seconds, "peak_rss_bytes": peak_rss_bytes()}
        if Path(own.file).suffix.lower() == SUFFIX:
            report = file_report(inspect_bytes(read_file(own.file), is_prefix=reading.is_in_part), watch)
        write_json(own.report, report)
    seconds = watch.seconds["render"]
    rate = "" if suffix == ".png" else f", {len(path)} frames, {len(path) / seconds:.1f} frames/s"
    own.voice.done(f"{seconds:.3f} s{rate}", own.output)


def depth_colours(depth: NDArray) -> NDArray:
    """Depths z (H, W) float32 as (H, W, 3) float32 in [0, 1], even in 1/z: red near, blue far, black without depth."""
    seen = depth > 0
    inverse = np.divide(1, depth, out=np.zeros_like(depth), where=seen)
    far, near = np.percentile(inverse[seen], (2, 98)) if seen.any() else (0.0, 1.0)
    t = ((inverse - far) / max(near - far, 1e-12))[..., None]
    return np.clip(1.5 - 3 * np.abs(t - (0.75, 0.5, 0.25)), 0, 1).astype(np.float32) * seen[..., None]


def depth_map(output: str, depth: NDArray, scale: float) -> NDArray:
    """Depths z in scene units as (H, W) uint16 of z · scale, 0 where nothing is seen; says what reaches beyond."""
    scaled = np.rint(depth.astype(np.float64) * scale)
    beyond = int((scaled > DEEPEST).sum())
    if beyond:
        reach = DEEPEST / scale
        print(
            f"{output}: {beyond} pixels deeper than {reach:g} units written as {reach:g}; a smaller --depth-scale"
            " reaches farther",
            file=sys.stderr,
        )
    return np.where(scaled > 0, scaled.clip(1, DEEPEST), 0).astype(np.uint16)


def _chosen_camera(text: str | None, gaussians: Gaussians) -> Camera:
    """`INDEX` of the file's own views or photos, or `cameras.json:INDEX`."""
    source, _, index_text = (text or "0").rpartition(":")
    try:
        index = int(index_text)
    except ValueError:
        raise InputError(f"'{text}', expected INDEX or cameras.json:INDEX", where="--camera") from None
    cameras = _load_cameras(source) if source else gaussians.cameras or gaussians.viewpoints or (outside(gaussians),)
    if not 0 <= index < len(cameras):
        raise InputError(f"{index}, accepted are 0 to {len(cameras) - 1}", where="--camera")
    return cameras[index]


def _load_cameras(source: str) -> Sequence[Camera]:
    from ..scene.intake.layouts import load_cameras  # every layout of folders there is, which a picture rarely needs

    return load_cameras(source)


def _camera_path(
    gaussians: Gaussians, file: str, camera: str | None, path: str | None, frames: int | None
) -> list[Camera]:
    """Along the file's views or photos, or those of `--camera`; around Gaussians of neither, as `view` frames them."""
    cameras = _cameras(gaussians, camera)
    if not cameras and path == "between":
        raise InputError(
            f"{file} has no views to fly between; --path orbit, or --camera cameras.json:0", where="--path"
        )
    views = cameras or (outside(gaussians),)
    if path == "orbit" or not cameras:
        return orbit(views, frames or FRAMES, _median_depth(gaussians, views[0]))
    return between(views, frames or max(FRAMES, FRAMES_A_VIEW * (len(views) - 1)))


def _story_path(
    gaussians: Gaussians, file: str, camera: str | None, frames: int | None, size: tuple[int, int] | None
) -> list[Camera]:
    """Along the views of a story's file, with the angles of view of a page."""
    from ..page.front import front_of
    from ..page.story import load_story

    story = load_story(file)
    taken = _cameras(gaussians, camera) or (front_of(gaussians),)
    views = story.cameras(taken, size)
    with within(file):
        story.check_scene(gaussians.flat().means + gaussians.origin, taken[0].centre)
        if not views:
            raise InputError("none, expected at least one", where="views")
    seconds = story.document["seconds"] or VIEW_SECONDS
    number = frames or max(round(FPS * seconds * len(views)), 1)
    return halting(views, number, max(1 - WAY_SECONDS / seconds, 0.5), _median_depth(gaussians, views[0]))


def _cameras(gaussians: Gaussians, camera: str | None) -> tuple[Camera, ...]:
    """All of `--camera`'s file, or the Gaussians' own."""
    source = (camera or "").rpartition(":")[0]
    if camera and not source:
        raise InputError("a video takes all views, those of --camera cameras.json:INDEX", where="--camera")
    return tuple(_load_cameras(source)) if source else gaussians.cameras or gaussians.viewpoints


def _median_depth(gaussians: Gaussians, camera: Camera) -> float:
    flat = gaussians.flat()
    return middle_depth(flat.means.astype(np.float64) + flat.origin, camera)
