"""`tinysplat completion`: completion scripts for shells, made from the parsers by shtab."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from tinysplat_runtime.cli.parser import build_parser, join_commands
from tinysplat_runtime.errors import InputError

HELP = "a shell's completion script"
NEEDS = ("shtab",)


def configure(parser: ArgumentParser) -> None:
    """Add the command's options."""
    place = "~/.local/share/bash-completion/completions/tinysplat"
    parser.description = f"Prints a completion script, for bash to be kept in {place}."
    parser.add_argument("shell", metavar="SHELL", help="bash, zsh, tcsh, or another that shtab knows")


def run(args: Namespace) -> None:
    """Print the script of all commands that are installed."""
    import shtab

    if args.shell not in shtab.SUPPORTED_SHELLS:
        raise InputError(f"'{args.shell}', accepted are {', '.join(shtab.SUPPORTED_SHELLS)}", where="shell")
    parser, commands = build_parser()
    join_commands(commands, ["--help"])
    print(shtab.complete(parser, args.shell))
