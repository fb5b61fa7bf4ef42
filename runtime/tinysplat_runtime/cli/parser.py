"""Commands and their options, as argparse knows them. What commands do: commands.py; how one is run: run.py.

Commands outside the runtime join through the entry-point group `tinysplat.commands`; see `join_commands`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from typing import NoReturn, TypeAlias

from .. import __version__
from ..codec.modes import CHOICES
from ..errors import InputError
from ..formats import SH_BITS, SPZ_VERSION
from ..gaussian import FUSE_SECONDS, OWN_VARIANCE
from .arguments import amount, byte_count, count, indices, numbers, port, positive, size
from .options import add_coding, add_notes, add_photos, add_provider

_GAUSSIAN_FILES = ".npz, .ply, .spz, .glb, .sog, .usdz or another Gaussian file (docs/FORMATS.md)"

_EPILOG = "exit status: 0 done | 2 the input is at fault | 130 interrupted | 1 a fault of ours"

ENTRY_POINTS = "tinysplat.commands"

EXTRAS = {
    "eval": "eval",
    "bench": "eval",
    "compare": "eval",
    "poses": "poses",
    "batch": "cluster",
    "completion": "completion",
}
"""Commands that an extra brings, for the message when it is not installed."""


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        print(f"{self.prog}: {message}", file=sys.stderr)
        raise SystemExit(2)


def _common() -> _Parser:
    common = _Parser(add_help=False)
    common.add_argument("-q", "--quiet", action="store_true", help="no progress and no summary")
    common.add_argument("--threads", type=count, metavar="N", help="default: all cores; no result depends on it")
    return common


def _written() -> _Parser:
    written = _Parser(add_help=False)
    written.add_argument("--force", action="store_true", help="overwrite outputs that are there already")
    return written


def _coding() -> _Parser:
    coding = _Parser(add_help=False)
    coding.add_argument("-o", "--output", required=True, metavar="F.tsplat", help="- for standard output")
    add_coding(coding)
    coding.add_argument("--report", metavar="R.json", help="write bytes, seconds, memory and errors as JSON")
    return coding


def _limits() -> _Parser:
    limits = _Parser(add_help=False)
    limits.add_argument("--max-pixels", type=count, metavar="N", help="refuse files of more Gaussians (default 67 M)")
    limits.add_argument(
        "--max-memory", type=byte_count, metavar="SIZE", help="refuse files that take more to decode (default 8GiB)"
    )
    return limits


def _selection() -> _Parser:
    selection = _Parser(add_help=False)
    selection.add_argument(
        "--views",
        type=indices,
        metavar="I,J-K",
        help="only the Gaussians of these views, such as 0,3,10-20",
    )
    selection.add_argument(
        "--trim-border", type=count, metavar="PX", help="leave out the outermost PX pixels of each view"
    )
    selection.add_argument("--min-opacity", type=float, metavar="A", help="only Gaussians of this opacity or more")
    selection.add_argument("--sh-degree", type=int, metavar="N", help="cut SH to this degree")
    selection.add_argument(
        "--dilate", type=positive, nargs="?", const=OWN_VARIANCE, metavar="VARIANCE",
        help=f"widen each Gaussian by its photo's pixel, for other viewers; in pixels², default {OWN_VARIANCE}",
    )  # fmt: skip
    selection.add_argument(
        "--prune", type=amount, metavar="SHARE|DB|N",
        help="leave out this share of the Gaussians (0.5), as many as a quality bears (45dB), or all but N, those that"
        " pictures need least first (needs numba)",
    )  # fmt: skip
    selection.add_argument(
        "--keep-all", action="store_true",
        help="keep all Gaussians: in a .tsplat file also those of no pixels that pictures hardly need, in lists of"
        " points also those of captures that other views show",
    )  # fmt: skip
    selection.add_argument(
        "--fuse", type=positive, nargs="?", const=FUSE_SECONDS, metavar="SECONDS",
        help="for other viewers: keep each surface of a capture once, and correct it for SECONDS; default"
        f" {FUSE_SECONDS:g}",
    )  # fmt: skip
    selection.add_argument(
        "--points", action="store_true", help="write a plain point cloud (.ply) of means and colours"
    )
    selection.add_argument(
        "--sh-bits", type=indices, default=SH_BITS, metavar="A,B",
        help="bits that .spz keeps of SH coefficients of degree 1 and above it, up to 8,8; default 5,4",
    )  # fmt: skip
    selection.add_argument(
        "--spz-version", type=int, choices=(2, 3, 4), default=SPZ_VERSION,
        help="version of .spz files; 4 keeps SH degree 4 and needs readers with zstd; default 3",
    )  # fmt: skip
    selection.add_argument(
        "--gltf-spz", action="store_true",
        help="write .glb and .gltf with SPZ inside: small, by a draft of glTF's extension, which Cesium reads",
    )  # fmt: skip
    return selection


def _notes() -> _Parser:
    notes = _Parser(add_help=False)
    add_notes(notes)
    return notes


def _provider() -> _Parser:
    provider = _Parser(add_help=False)
    add_provider(provider)
    return provider


def _prefix() -> _Parser:
    prefix = _Parser(add_help=False)
    prefix.add_argument(
        "--max-bytes", type=count, metavar="N", help="decode the first N bytes alone; `info` lists useful numbers"
    )
    prefix.add_argument(
        "--partial", action="store_true", help="decode what is intact of a damaged or cut file, and say what is lost"
    )
    prefix.add_argument(
        "--model", metavar="NAME|FILE.onnx", help="the network for a file of photos, where it is not found by its hash"
    )
    return prefix


Commands: TypeAlias = "argparse._SubParsersAction[_Parser]"
"""What `add_subparsers` returns; argparse has no public name for it."""


def build_parser(only: str | None = None) -> tuple[_Parser, Commands]:
    """The parser of the commands that need nothing but the runtime, and where further commands are added.

    Of these, `only` the one that is going to run where it is named: each takes a millisecond.
    """
    parser = _Parser(prog="tinysplat", description="Posed photos in, a tiny 3D Gaussian scene out.", epilog=_EPILOG)
    parser.add_argument("--version", action="version", version=f"tinysplat {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True, parser_class=_Parser)
    adders = {add.__name__[1:]: add for add in _COMMANDS}
    for add in [adders[only]] if only in adders else _COMMANDS:
        add(commands)
    return parser, commands


def _encode(commands: Commands) -> None:
    parser = commands.add_parser(
        "encode",
        parents=[_common(), _written(), _coding(), _notes(), _provider()],
        help="photos and cameras to a .tsplat file",
    )
    parser.add_argument(
        "scene", metavar="SCENE", nargs="+",
        help="folder with cameras.json, transforms.json, transforms_train.json, poses_bounds.npy or COLMAP's sparse/;"
        " a RealEstate10K .txt; two stereo photos; a video with --poses",
    )  # fmt: skip
    add_photos(parser)
    parser.add_argument("--focal", type=float, metavar="PX", help="focal length of a stereo pair in pixels")
    parser.add_argument("--baseline", type=float, metavar="B", help="distance of a stereo pair's cameras")
    parser.add_argument("--save-gaussians", metavar="G.npz", help="also write the network's Gaussians")


def _compress(commands: Commands) -> None:
    parser = commands.add_parser(
        "compress",
        parents=[_common(), _written(), _coding(), _limits(), _prefix(), _notes(), _provider()],
        help="Gaussians of any network, or of a trained scene, to a .tsplat file",
    )
    parser.add_argument(
        "gaussians",
        metavar="G",
        help=f".tsplat, {_GAUSSIAN_FILES}; a list of points belongs to no pixels unless --grid and"
        " --cameras say to which; - for standard input",
    )
    parser.add_argument("--mode", choices=CHOICES, help=argparse.SUPPRESS)
    parser.add_argument("--photos", metavar="SCENE", help="photos by which --refine corrects the Gaussians")
    parser.add_argument("--grid", type=indices, metavar="V,H,W", help="pixel grid of a .ply's points")
    parser.add_argument(
        "--keep-all", action="store_true",
        help="keep Gaussians of no pixels that pictures hardly need, which are left out otherwise (with numba)",
    )  # fmt: skip
    parser.add_argument(
        "--cameras", metavar="SCENE",
        help="cameras of the photos that Gaussians were made from, which decide what pictures need: cameras.json,"
        " transforms.json or a folder with COLMAP's sparse/; of as many Gaussians as pixels, the cameras of these",
    )  # fmt: skip


def _decode(commands: Commands) -> None:
    parser = commands.add_parser(
        "decode",
        parents=[_common(), _written(), _limits(), _prefix(), _selection(), _notes(), _provider()],
        help="a .tsplat file back to Gaussians",
    )
    parser.add_argument("file", metavar="F.tsplat")
    parser.add_argument("-o", "--output", required=True, metavar="G", help=_GAUSSIAN_FILES)
    parser.add_argument("--report", metavar="R.json", help="write bytes, seconds and memory as JSON")


def _render(commands: Commands) -> None:
    parser = commands.add_parser(
        "render",
        parents=[_common(), _written(), _limits(), _prefix(), _provider()],
        help="a picture or a video of Gaussians",
    )
    parser.add_argument("file", metavar="F", help=f".tsplat, {_GAUSSIAN_FILES}")
    parser.add_argument("-o", "--output", required=True, metavar="OUT", help=".png or .mp4")
    parser.add_argument("--camera", metavar="INDEX", help="a view of the file, or cameras.json:INDEX; default 0")
    parser.add_argument("--path", choices=("between", "orbit"), help="camera path of a video; default between")
    parser.add_argument(
        "--frames", type=count, metavar="N", help="frames of a video; default 60, for a capture 8 from view to view"
    )
    parser.add_argument("--size", type=size, metavar="WxH", help="picture size; default: the camera's")
    parser.add_argument("--depth", action="store_true", help="depth as a picture, near in red, far in blue")
    parser.add_argument("--depth-values", action="store_true", help="depth as numbers (z, 16-bit PNG)")
    parser.add_argument("--depth-scale", type=positive, default=1000.0, metavar="S",
                        help="value of --depth-values per scene unit; default 1000")  # fmt: skip
    parser.add_argument("--dilation", choices=("own", "screen"), default="own",
                        help="widen each Gaussian by its own photo's pixel, or the screen's; default own")  # fmt: skip
    parser.add_argument("--order", choices=("near", "depth"), default="near",
                        help="near views cover the others, or all by depth; default near")  # fmt: skip
    parser.add_argument("--report", metavar="R.json", help="write seconds and memory as JSON")


def _convert(commands: Commands) -> None:
    parser = commands.add_parser(
        "convert",
        parents=[_common(), _written(), _limits(), _prefix(), _selection(), _notes(), _provider()],
        help="Gaussian files to other formats, cut, moved or joined",
    )
    parser.add_argument("files", nargs="+", metavar="IN", help=f".tsplat, {_GAUSSIAN_FILES}")
    parser.add_argument("-o", "--output", required=True, metavar="OUT", help=_GAUSSIAN_FILES)
    parser.add_argument("--crop", type=numbers(6), metavar="X,Y,Z,X,Y,Z", help="keep the box between two corners")
    parser.add_argument("--rotate", metavar="AXIS,DEG|W,X,Y,Z", help="first: x,90 or a quaternion")
    parser.add_argument("--scale", type=positive, default=1.0, metavar="S", help="then: enlarge the scene S times")
    parser.add_argument("--translate", type=numbers(3), default=(0, 0, 0), metavar="X,Y,Z", help="then: move it")
    parser.add_argument(
        "--cameras",
        metavar="SCENE",
        help="cameras of the photos that Gaussians were made from, for --prune",
    )
    parser.add_argument("--check", action="store_true", help="read the file back and print its bytes and loss in dB")


def _info(commands: Commands) -> None:
    parser = commands.add_parser("info", parents=[_common(), _limits()], help="what a file holds")
    parser.add_argument("file", metavar="F", help=f".tsplat, {_GAUSSIAN_FILES}")
    parser.add_argument("--json", action="store_true", help="as JSON")


def _view(commands: Commands) -> None:
    parser = commands.add_parser(
        "view", parents=[_common(), _written()], help="a scene in the browser, or as one web page",
        description="Serves one page on this machine and opens the browser; with --html writes the page, which opens"
        " anywhere without a network. --player writes a page that opens any .tsplat file.",
    )  # fmt: skip
    parser.add_argument("file", metavar="F", nargs="?", help=f".tsplat, {_GAUSSIAN_FILES}")
    parser.add_argument("--html", metavar="OUT.html", help="write the page in place of serving it")
    parser.add_argument("--player", action="store_true", help="a page without a scene, which opens files that are"
                        " dropped on it, chosen, or named by ?file=URL")  # fmt: skip
    parser.add_argument("-o", "--output", metavar="OUT", help="where --player writes its page")
    parser.add_argument(
        "--networks", nargs="?", const="node_modules/onnxruntime-web", metavar="PACKAGE",
        help="with --player: -o is a folder for a web server, with networks for files of photos and onnxruntime-web to"
        " run them, copied from npm's package; default node_modules/onnxruntime-web",
    )  # fmt: skip
    parser.add_argument("--photos", metavar="SCENE", help="scene whose photos the page can show beside the render")
    parser.add_argument("--cameras", metavar="cameras.json", help="views of a file that has none")
    parser.add_argument("--port", type=port, default=0, metavar="N", help="where to serve; default: any free port")
    parser.add_argument("--no-browser", action="store_true", help="only print the address")


def _models(commands: Commands) -> None:
    parser = commands.add_parser("models", parents=[_common()], help="the networks and graphs at hand")
    parser.add_argument("--json", action="store_true", help="as JSON")


def _doctor(commands: Commands) -> None:
    parser = commands.add_parser("doctor", parents=[_common()], help="what is installed, and what is wrong with it")
    parser.add_argument("--json", action="store_true", help="as JSON")
    parser.add_argument(
        "--provider", metavar="NAME[:KEY=VALUE,…]",
        help="run a made-up scene with it, and print how many nodes of which graph it ran",
    )  # fmt: skip


_COMMANDS = (_encode, _compress, _decode, _render, _convert, _view, _info, _models, _doctor)


def join_commands(commands: Commands, arguments: list[str]) -> dict[str, Callable[[argparse.Namespace], int | None]]:
    """Add the commands of other packages, but only when one of them, or the list of all, is asked for.

    An entry point of the group names a module with `HELP`, `configure(parser)` and `run(args)`, and where `run` needs
    more than an import of the module does, the packages `NEEDS`.
    """
    word = next((a for a in arguments if not a.startswith("-")), None)
    if word in commands.choices or (word is None and "--version" in arguments):
        return {}
    from importlib.metadata import entry_points
    from importlib.util import find_spec

    joined: dict[str, Callable[[argparse.Namespace], int | None]] = {}
    points, wants_help = entry_points(group=ENTRY_POINTS), bool({"-h", "--help"} & set(arguments))
    known = {*commands.choices, *EXTRAS, *(point.name for point in points)}
    if word not in known and not (word is None and wants_help):
        found = f"'{word}'" if word else "none given"
        more = "" if word else "; `tinysplat --help` says what they do"
        raise InputError(f"{found}, accepted are {', '.join(sorted(known))}{more}", where="command")
    for point in points:
        if word not in (None, point.name):
            continue
        try:
            module = point.load()
        except ImportError as error:
            if word == point.name and not wants_help:
                raise missing_extra(word, error.name) from None
            missing = str(missing_extra(point.name, error.name).message)
            commands.add_parser(point.name, help=missing, description=f"This command {missing}.")
            continue
        absent = next((name for name in getattr(module, "NEEDS", ()) if find_spec(name) is None), None)
        if absent and word == point.name and not wants_help:
            raise missing_extra(word, absent)
        module.configure(commands.add_parser(point.name, parents=[_common()], help=module.HELP))
        joined[point.name] = module.run
    if word in EXTRAS and word not in commands.choices:
        raise missing_extra(word, None)
    return joined


def missing_extra(command: str, module: str | None) -> InputError:
    """What a command of another package says where that or a package that it needs is not installed."""
    needs = f"needs the package '{module}'" if module else "is not installed"
    return InputError(f'{needs}; pip install "tinysplat[{EXTRAS.get(command, command)}]" brings it', where=command)
