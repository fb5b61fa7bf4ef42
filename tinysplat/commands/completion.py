"""`tinysplat completion`: completion scripts for shells, made from the parsers by shtab."""

from argparse import ArgumentParser, Namespace
from dataclasses import dataclass

from tinysplat_runtime.cli.asks import Quiet
from tinysplat_runtime.cli.options import add_options, asked
from tinysplat_runtime.cli.parser import build_parser, join_commands
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system import kinds
from tinysplat_runtime.system.options import REQUIRED, option

HELP = "a shell's completion script"
NEEDS = ("shtab",)


@dataclass(frozen=True, kw_only=True)
class Completion(Quiet):
    """What the command asks for."""

    shell: str = option(
        kinds.text, REQUIRED, is_bare=True, metavar="SHELL", help="bash, zsh, tcsh, or another that shtab knows"
    )


def configure(parser: ArgumentParser) -> None:
    """Add the command's options."""
    place = "~/.local/share/bash-completion/completions/tinysplat"
    parser.description = f"Prints a completion script, for bash to be kept in {place}."
    add_options(parser, Completion)


def run(args: Namespace) -> None:
    """Print the script of all commands that are installed."""
    import shtab

    shell = asked(args, Completion).shell
    if shell not in shtab.SUPPORTED_SHELLS:
        raise InputError(f"'{shell}', accepted are {', '.join(shtab.SUPPORTED_SHELLS)}", where="shell")
    parser, commands = build_parser()
    join_commands(commands, ["--help"])
    print(shtab.complete(parser, shell))
