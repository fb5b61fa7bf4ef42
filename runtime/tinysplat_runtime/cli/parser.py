"""Commands and their options, as argparse knows them. What commands do: commands.py; how one is run: run.py.

Commands outside the runtime join through the entry-point group `tinysplat.commands`; see `join_commands`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from typing import Any, NoReturn, TypeAlias

from .. import __version__
from ..errors import InputError
from .arguments import Input, Output, byte_count, colour, count, grid, port, positive, size
from .options import Container, add_option, add_options, add_provider, add_threads

_COLOUR = "where nothing is: white, black or #rrggbb"
_GAUSSIAN_FILES = ".npz, .ply, … (docs/FORMATS.md)"

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


OF_CONVERT = ("crop", "rotate", "scale", "translate", "cameras")
"""Options that `decode` has not."""

OF_EXPORTS = ("level", "length")
"""Options of `convert` that `encode` has, too, where it writes no .tsplat file."""


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, and nothing of `--help` to those who have found it."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**{"formatter_class": _Help, "add_help": False, **options})
        self.add_argument("-h", "--help", action="help", help=argparse.SUPPRESS)

    def error(self, message: str) -> NoReturn:
        print(f"{self.prog}: {message}", file=sys.stderr)
        raise SystemExit(2)


class _Help(argparse.HelpFormatter):
    """A line for most options."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=30)

    def _format_action_invocation(self, action: argparse.Action) -> str:
        """`-o, --output FILE`, which before Python 3.13 says FILE twice."""
        if len(action.option_strings) < 2 or action.nargs == 0:
            return super()._format_action_invocation(action)
        return f"{', '.join(action.option_strings)} {action.metavar}"


def _quiet(options: Container) -> None:
    options.add_argument("-q", "--quiet", action="store_true", help="no progress and no summary")


def _written(options: Container) -> None:
    options.add_argument("--force", action="store_true", help="overwrite outputs that exist")


def _limits(options: Container) -> None:
    options.add_argument("--max-pixels", type=count, metavar="N", help="refuse files of more Gaussians (67 M)")
    options.add_argument("--max-memory", type=byte_count, metavar="SIZE", help="refuse files that take more (8GiB)")


def _prefix(options: Container) -> None:
    options.add_argument("--max-bytes", type=count, metavar="N", help="decode the first N bytes (`info` lists some)")
    options.add_argument("--partial", action="store_true", help="decode what is intact and name what is lost")
    options.add_argument("--model", metavar="NAME|FILE.onnx", help="the network of a file of photos")


def _reading(parser: _Parser) -> None:
    reading = parser.add_argument_group("reading, and what runs it")
    _prefix(reading)
    _limits(reading)
    add_provider(reading)
    add_threads(reading)


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
    from ..recipe.request import VIDEO, EncodeRequest, ExportRequest

    parser = commands.add_parser(
        "encode", help="photos and cameras to a .tsplat file", usage="%(prog)s SCENE [SCENE …] -o F.tsplat [options]"
    )
    parser.add_argument(
        "scene", type=Input, metavar="SCENE", nargs="+", help="photos with cameras; two stereo photos; video"
    )
    parser.add_argument(
        "-o", "--output", type=Output, required=True, metavar="F.tsplat", help=".spz, .ply …: one list for any viewer"
    )
    _written(parser)
    _quiet(parser)
    groups, exports = add_options(parser, EncodeRequest), ExportRequest.options()
    for name in OF_EXPORTS:
        add_option(parser, name, exports[name])
    more = groups[VIDEO]
    more.add_argument("--report", type=Output, metavar="R.json", help="bytes, seconds, memory and errors as JSON")
    add_provider(more)
    add_threads(more)


def _compress(commands: Commands) -> None:
    from ..recipe.request import CompressRequest

    parser = commands.add_parser(
        "compress",
        help="Gaussians of any network, or of a trained scene, to a .tsplat file",
        usage="%(prog)s G -o F.tsplat [options]",
    )
    parser.add_argument("gaussians", type=Input, metavar="G", help=f".tsplat, {_GAUSSIAN_FILES}; - for standard input")
    parser.add_argument("-o", "--output", type=Output, required=True, metavar="F.tsplat", help="- for standard output")
    _written(parser)
    _quiet(parser)
    parser.add_argument("--report", type=Output, metavar="R.json", help="bytes, seconds, memory and errors as JSON")
    parser.add_argument("--grid", type=grid, metavar="V,H,W", help="the list is of pixels of V views of HxW")
    add_options(parser, CompressRequest)
    _reading(parser)


def _decode(commands: Commands) -> None:
    from ..recipe.request import ExportRequest

    parser = commands.add_parser(
        "decode", help="a .tsplat file back to Gaussians", usage="%(prog)s F.tsplat -o G [options]"
    )
    parser.add_argument("file", type=Input, metavar="F.tsplat", help="- for standard input")
    parser.add_argument("-o", "--output", type=Output, required=True, metavar="G", help=_GAUSSIAN_FILES)
    _written(parser)
    _quiet(parser)
    parser.add_argument("--report", type=Output, metavar="R.json", help="bytes, seconds and memory as JSON")
    add_options(parser, ExportRequest, without=OF_CONVERT)
    _reading(parser)


def _render(commands: Commands) -> None:
    parser = commands.add_parser(
        "render", help="a picture or a video of Gaussians", usage="%(prog)s F -o OUT [options]"
    )
    parser.add_argument("file", type=Input, metavar="F", help=f".tsplat, {_GAUSSIAN_FILES}")
    parser.add_argument("-o", "--output", type=Output, required=True, metavar="OUT", help=".png or .mp4")
    _written(parser)
    _quiet(parser)
    parser.add_argument(
        "--camera", type=Input, metavar="INDEX", help="a view or photo of the file, or cameras.json:INDEX; 0"
    )
    parser.add_argument("--path", choices=("between", "orbit"), help="of a video; default between")
    parser.add_argument("--story", type=Input, metavar="FILE", help="a video along the views of a page's story")
    frames = "of a video; 60, of a capture 8 a view, of a story 30 a second"
    parser.add_argument("--frames", type=count, metavar="N", help=frames)
    parser.add_argument("--size", type=size, metavar="WxH", help="of pictures; default: the camera's")
    parser.add_argument("--background", type=colour, default=(0, 0, 0), metavar="COLOUR", help=f"{_COLOUR}; black")
    parser.add_argument("--panorama", action="store_true", help="a 360° picture from the camera's place")
    parser.add_argument("--depth", action="store_true", help="depth as a picture, near in red, far in blue")
    parser.add_argument("--depth-values", action="store_true", help="depth as numbers (z, 16-bit PNG)")
    more = parser.add_argument_group("more")
    more.add_argument("--depth-scale", type=positive, default=1000.0, metavar="S", help="values per scene unit; 1000")
    more.add_argument(
        "--dilation", choices=("own", "screen"), default="own", help="widen by the photo's or the screen's pixel; own"
    )
    more.add_argument(
        "--order", choices=("near", "depth"), default="near", help="draw near views first, or all by depth; near"
    )
    more.add_argument("--report", type=Output, metavar="R.json", help="write seconds and memory as JSON")
    _reading(parser)


def _convert(commands: Commands) -> None:
    from ..recipe.request import ExportRequest

    parser = commands.add_parser(
        "convert",
        help="Gaussian files to other formats, cut, moved or joined",
        usage="%(prog)s IN [IN …] -o OUT [options]",
    )
    parser.add_argument("files", type=Input, nargs="+", metavar="IN", help=argparse.SUPPRESS)  # usage tells
    parser.add_argument(
        "-o", "--output", type=Output, required=True, metavar="OUT", help=f"as IN: .tsplat, {_GAUSSIAN_FILES}"
    )
    _written(parser)
    _quiet(parser)
    parser.add_argument("--check", action="store_true", help="print bytes and loss in dB of the file")
    add_options(parser, ExportRequest)
    _reading(parser)


def _info(commands: Commands) -> None:
    parser = commands.add_parser("info", help="what a file holds")
    parser.add_argument("file", type=Input, metavar="F", help=f".tsplat, {_GAUSSIAN_FILES}")
    parser.add_argument("--json", action="store_true", help="as JSON")
    _quiet(parser)
    _limits(parser)


def _view(commands: Commands) -> None:
    parser = commands.add_parser(
        "view",
        help="a scene in the browser, or as one web page",
        description="Serves one page on this machine and opens the browser; with --html writes the page, which opens"
        " anywhere without a network. --player writes a page that opens any .tsplat file.",
    )
    parser.add_argument("file", type=Input, metavar="F", nargs="?", help=f".tsplat, {_GAUSSIAN_FILES}")
    parser.add_argument("--html", type=Output, metavar="OUT.html", help="write the page in place of serving it")
    parser.add_argument(
        "--files",
        dest="as_files",
        action="store_true",
        help="--html names a folder, whose files work on sites that allow no inline scripts",
    )
    parser.add_argument(
        "--player",
        action="store_true",
        help="--html writes a page without a scene, which opens files dropped on it, chosen, or named by ?file=URL",
    )
    parser.add_argument(
        "--photos", type=Input, metavar="SCENE", help="scene whose photos the page can show beside the render"
    )
    parser.add_argument(
        "--story", type=Input, nargs="?", const="", metavar="S.json", help="named views and notes; alone: to be made"
    )
    parser.add_argument("--cameras", type=Input, metavar="cameras.json", help="views of a file that has none")
    parser.add_argument(
        "--background", type=colour, metavar="COLOUR", help=f"{_COLOUR}; default: of the scene's own colours"
    )
    parser.add_argument("--port", type=port, default=0, metavar="N", help="where to serve; default: any free port")
    parser.add_argument("--no-browser", action="store_true", help="only print the address")
    _quiet(parser)
    _written(parser)


def _models(commands: Commands) -> None:
    parser = commands.add_parser("models", help="the networks and graphs at hand")
    parser.add_argument("--json", action="store_true", help="as JSON")
    _quiet(parser)


def _doctor(commands: Commands) -> None:
    parser = commands.add_parser("doctor", help="what is installed, and what is wrong with it")
    _quiet(parser)
    parser.add_argument("--json", action="store_true", help="as JSON")
    parser.add_argument("--warm", action="store_true", help="compile what is else compiled on first use")
    parser.add_argument(
        "--provider",
        metavar="NAME[:KEY=VALUE,…]",
        help="run a made-up scene with it, and count the nodes of each graph that it ran",
    )


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
        fault = f"'{word}'" if word else "none given"
        more = "" if word else "; `tinysplat --help` says what they do"
        raise InputError(f"{fault}, accepted are {', '.join(sorted(known))}{more}", where="command")
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
        command = commands.add_parser(point.name, help=module.HELP)
        module.configure(command)
        _quiet(command)
        joined[point.name] = module.run
    if word in EXTRAS and word not in commands.choices:
        raise missing_extra(word, None)
    return joined


def missing_extra(command: str, module: str | None) -> InputError:
    """What a command of another package says where that or a package that it needs is not installed."""
    needs = f"needs the package '{module}'" if module else "is not installed"
    return InputError(f'{needs}; pip install "tinysplat[{EXTRAS.get(command, command)}]" brings it', where=command)
