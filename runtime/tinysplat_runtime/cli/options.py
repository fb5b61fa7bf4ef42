"""Options as argparse knows them: words alone, whose values `recipe.options` reads; one not given is None or False."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

from .arguments import Input, Output, count

if TYPE_CHECKING:
    from ..recipe.options import Option, Options

Container: TypeAlias = "argparse._ActionsContainer"
"""A parser, or a group of its options; argparse has no public name for both."""


def add_options(
    parser: argparse.ArgumentParser, asked: type[Options], *, without: Collection[str] = ()
) -> Mapping[str, Container]:
    """Add the options of a class but for some names and groups; its groups by name, "" the parser itself."""
    groups: dict[str, Container] = {"": parser}
    for name, option in asked.options(without=without).items():
        if option.group not in groups:
            groups[option.group] = parser.add_argument_group(option.group)
        add_option(groups[option.group], name, option)
    return groups


def add_option(container: Container, name: str, option: Option) -> None:
    """Add an option, and `--no-…` where it can be off."""
    from ..recipe import words

    word = name.replace("_", "-")
    if not option.metavar and option.off is None:
        container.add_argument(f"--{word}", action="store_true", help=option.help)
        return
    about: dict[str, Any] = {"choices": [str(choice) for choice in option.choices]} if option.choices else {}
    if option.kind in (words.path, words.file, words.cameras):
        about["type"] = Input
    elif option.kind is words.written:
        about["type"] = Output
    if option.usual is not None:
        about |= {"nargs": "?", "const": True}
    if option.metavar and option.off is not None:
        container = container.add_mutually_exclusive_group()
    if option.metavar:
        container.add_argument(f"--{word}", metavar=option.metavar, help=option.help, **about)
    if option.off is not None:
        container.add_argument(f"--no-{word}", dest=name, action="store_const", const=option.off, help=option.off_help)


def add_provider(options: Container) -> None:
    """What runs graphs."""
    options.add_argument("--provider", metavar="NAME[:K=V,…]", help="of onnxruntime (`tinysplat doctor` lists them)")


def add_threads(options: Container) -> None:
    """How many threads work; for commands whose work has some."""
    options.add_argument("--threads", type=count, metavar="N", help="default: all cores; changes no result")
