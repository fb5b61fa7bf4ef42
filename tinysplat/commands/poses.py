"""`tinysplat poses`: photos without cameras, or a video, to a scene folder, by structure from motion with pycolmap."""

from argparse import ArgumentParser, Namespace
from dataclasses import dataclass
from pathlib import Path

from tinysplat.poses.request import PosesRequest
from tinysplat.poses.scene import posed
from tinysplat_runtime.cli.asks import Quiet
from tinysplat_runtime.cli.options import add_options, asked, named
from tinysplat_runtime.system import kinds
from tinysplat_runtime.system.options import REQUIRED, option

HELP = "camera poses of photos or a video, as a scene folder"
NEEDS = ("pycolmap",)


@dataclass(frozen=True, kw_only=True)
class Poses(Quiet):
    """What the command asks for beside its request."""

    output: str = option(kinds.path, REQUIRED, short="o", metavar="SCENE", help="folder to write, new or empty")


def configure(parser: ArgumentParser) -> None:
    """Add the command's options."""
    parser.usage = "tinysplat poses PHOTOS -o SCENE [options]"
    parser.description = (
        "Finds where each photo was taken from, takes lens distortion out, and writes photos, cameras.json,"
        " transforms.json and COLMAP's text files. Of a video, sharp frames are chosen, apart by as much as the camera"
        " moved, and more where few of them can be placed. The world stands upright, by gravity where photos of an"
        " iPhone state it, with y down and the ground at 0; its unit is arbitrary. Photos"
        " that could not be placed are named on standard error."
    )
    add_options(parser, Poses, PosesRequest)


def run(args: Namespace) -> None:
    """Place the photos, write the scene, say which are missing."""
    own, request = asked(args, Poses), asked(args, PosesRequest)
    with named(request.options()):
        scene = posed(request, Path(own.output), own.voice)
    depths = "" if scene.near is None or scene.far is None else f", near {scene.near:.4g}, far {scene.far:.4g}"
    said = f"{len(scene.cameras)} photos{depths}; `tinysplat encode {own.output} -o F.tsplat` takes it"
    own.voice.done(said, own.output)
