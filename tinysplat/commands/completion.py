"""`tinysplat completion`: completion scripts for shells, made from the parsers by shtab."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

import shtab

from tinysplat_runtime.cli.parser import build_parser, join_commands

HELP = "a shell's completion script"


def configure(parser: ArgumentParser) -> None:
    """Add the command's options."""
    place = "~/.local/share/bash-completion/completions/tinysplat"
    parser.description = f"Prints a completion script, for bash to be kept in {place}."
    parser.add_argument("shell", choices=shtab.SUPPORTED_SHELLS, help="which shell")


def run(args: Namespace) -> None:
    """Print the script of all commands that are installed."""
    parser, commands = build_parser()
    join_commands(commands, [])
    print(shtab.complete(parser, args.shell))
