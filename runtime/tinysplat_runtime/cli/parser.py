"""Commands and their options, as argparse knows them. What commands do: commands.py; how one is run: run.py.

Commands outside the runtime join through the entry-point group `tinysplat.commands`; see `join_commands`.
"""

import argparse
import sys
from collections.abc import Callable
from typing import Any, NoReturn, TypeAlias

from .. import __version__
from ..errors import InputError
from .asks import Compress, Convert, Decode, Doctor, Encode, Info, Models, Render, View
from .files import Reading, Running
from .options import add_options

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
    from ..recipe.request import EncodeRequest, Upright

    parser = _command(commands, "encode", "photos and cameras to a .tsplat file", "SCENE [SCENE …] -o F.tsplat")
    add_options(parser, Encode, EncodeRequest, Upright, Running)


def _compress(commands: Commands) -> None:
    from ..recipe.request import CompressRequest

    parser = _command(
        commands, "compress", "Gaussians of any network, or of a trained scene, to a .tsplat file", "G -o F.tsplat"
    )
    add_options(parser, Compress, CompressRequest, Reading)


def _decode(commands: Commands) -> None:
    from ..recipe.request import ExportRequest

    parser = _command(commands, "decode", "a .tsplat file back to Gaussians", "F.tsplat -o G")
    add_options(parser, Decode, ExportRequest, Reading, without=OF_CONVERT)


def _render(commands: Commands) -> None:
    parser = _command(commands, "render", "a picture or a video of Gaussians", "F -o OUT")
    add_options(parser, Render, Reading)


def _convert(commands: Commands) -> None:
    from ..recipe.request import ExportRequest

    parser = _command(commands, "convert", "Gaussian files to other formats, cut, moved or joined", "IN [IN …] -o OUT")
    add_options(parser, Convert, ExportRequest, Reading)


def _view(commands: Commands) -> None:
    parser = _command(commands, "view", "a scene in the browser, or as one web page", "[F]")
    parser.description = (
        "Serves one page on this machine and opens the browser; with --html writes the page, which opens anywhere"
        " without a network. --player writes a page that opens any .tsplat file."
    )
    add_options(parser, View)


def _info(commands: Commands) -> None:
    add_options(_command(commands, "info", "what a file holds", "F"), Info)


def _models(commands: Commands) -> None:
    add_options(_command(commands, "models", "the networks and graphs at hand"), Models)


def _doctor(commands: Commands) -> None:
    add_options(_command(commands, "doctor", "what is installed, and what is wrong with it"), Doctor)


def _command(commands: Commands, name: str, help: str, usage: str = "") -> _Parser:
    """The parser of a command, still without options; `usage` are the words that it needs."""
    return commands.add_parser(name, help=help, usage=f"%(prog)s {usage} [options]".replace("  ", " "))


_COMMANDS = (_encode, _compress, _decode, _render, _convert, _view, _info, _models, _doctor)


def join_commands(commands: Commands, arguments: list[str]) -> dict[str, Callable[[argparse.Namespace], int | None]]:
    """Add the commands of other packages, but only when one of them, or the list of all, is asked for.

    An entry point of the group names a module with `HELP`, `configure(parser)` and `run(args)`, and where `run` needs
    more than an import of the module does, the packages `NEEDS`. Its options have `asks.Quiet` among them.
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
        joined[point.name] = module.run
    if word in EXTRAS and word not in commands.choices:
        raise missing_extra(word, None)
    return joined


def missing_extra(command: str, module: str | None) -> InputError:
    """What a command of another package says where that or a package that it needs is not installed."""
    needs = f"needs the package '{module}'" if module else "is not installed"
    return InputError(f'{needs}; pip install "tinysplat[{EXTRAS.get(command, command)}]" brings it', where=command)
