"""A video and the poses of some of its frames make a scene.

Which frame a pose is of: the last number in the photo's name counts frames of the video (`frame_00012.png`), except in
a RealEstate10K file, which has the time of each. Frames are decoded when their pictures are asked for.
"""

import re
from dataclasses import replace
from pathlib import Path

from ...errors import InputError, within
from ...system.files import StrPath
from ..footage import SUFFIXES, open_video
from ..scenes import Frame, Scene
from .layouts import load_scene
from .realestate import load_realestate


def video_scene(
    video: StrPath, poses: StrPath, near: float | None = None, far: float | None = None, first_number: int = 0
) -> Scene:
    """The frames of a video that have a pose.

    Args:
        video: .mp4, .mov, .m4v, .mkv, .webm or .ts.
        poses: a RealEstate10K file (.txt), a transforms.json, a cameras.json, or a folder with one of these or with a
            COLMAP model; photos that it names need not exist.
        near, far: depths of the nearest and the farthest surface, scene units; replace the poses' own.
        first_number: the number that names give to the video's first frame; 1 after `ffmpeg -i VIDEO %05d.png`.

    Raises:
        InputError: names the file and the frame: no such frame, a name without a number, another size of picture.
    """
    if Path(video).suffix.lower() not in SUFFIXES:
        raise InputError(f"expected a video ({', '.join(SUFFIXES)}) beside --poses", where=str(video))
    if Path(poses).suffix == ".txt":
        return load_realestate(Path(poses), Path(video)).between(near, far)
    clip = open_video(video)
    scene = load_scene(poses, near=near, far=far)
    frames = []
    for frame in scene.frames:
        frame = _as_taken(frame)
        stated = frame.lens or frame.photo_camera or frame.camera
        with within(f"{poses}: {frame.path.name}"):
            index = clip.check_index(_number(frame) - first_number)
            if (stated.height, stated.width) not in ((clip.height, clip.width), clip.stored):
                fault = f"{clip.width}x{clip.height} pixels, but the camera states {stated.width}x{stated.height}"
                raise InputError(fault, where=str(video))
        frames.append(replace(frame, path=clip.path, video=clip, index=index))
    return replace(scene, frames=tuple(frames))


def _as_taken(frame: Frame) -> Frame:
    """The frame of a photo that was made free of distortion as the video has it, at the same size."""
    lens = frame.taken_with
    if lens is None:
        return frame
    return Frame.through(lens, frame.camera.c2w, frame.path).resized(frame.camera.height, frame.camera.width)


def _number(frame: Frame) -> int:
    """The last number in the name of a frame's photo."""
    numbers = re.findall(r"\d{1,9}", frame.path.stem)
    if not numbers:
        raise InputError("no number in the name, expected that of a frame of the video")
    return int(numbers[-1])
