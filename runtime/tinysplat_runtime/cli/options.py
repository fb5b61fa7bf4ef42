"""Options as argparse knows them: words alone, which `Options` read; one not given is None or False."""

import argparse
import contextlib
import re
from collections.abc import Collection, Iterator, Mapping
from typing import Any, TypeAlias, TypeVar

from ..errors import InputError
from ..system import kinds
from ..system.options import Option, Options
from .outputs import Input, Output

Asked = TypeVar("Asked", bound="Options")

Container: TypeAlias = "argparse._ActionsContainer"
"""A parser, or a group of its options; argparse has no public name for both."""

READ = (kinds.path, kinds.file, kinds.cameras)
"""Kinds of what a command reads."""


def add_options(parser: argparse.ArgumentParser, *asked: type[Options], without: Collection[str] = ()) -> None:
    """Add the options of classes, by their groups, but for some names and groups."""
    groups: dict[str, Container] = {"": parser}
    for name, option in (item for kind in asked for item in kind.options(without=without).items()):
        if option.group not in groups:
            groups[option.group] = parser.add_argument_group(option.group)
        _add(groups[option.group], name, option)


def _add(container: Container, name: str, option: Option) -> None:
    """Add an option, and `--no-…` where it can be off."""
    words = [f"-{option.short}", _word(name, option)] if option.short else [_word(name, option)]
    if not option.metavar and option.off is None:
        container.add_argument(*words, dest=name, action="store_true", help=option.help)
        return
    about: dict[str, Any] = {"choices": [str(choice) for choice in option.choices]} if option.choices else {}
    if option.kind in READ:
        about["type"] = Input
    elif option.kind is kinds.written:
        about["type"] = Output
    if option.is_bare:
        several = "+" if option.is_required else "*"
        about["nargs"] = several if option.is_many else None if option.is_required else "?"
        container.add_argument(name, metavar=option.metavar, help=option.help or argparse.SUPPRESS, **about)
        return
    if option.usual is not None:
        about |= {"nargs": "?", "const": True}
    if option.is_many:
        about["action"] = "append"
    if option.metavar and option.off is not None:
        container = container.add_mutually_exclusive_group()
    if option.metavar:
        about["required"] = option.is_required
        container.add_argument(*words, dest=name, metavar=option.metavar, help=option.help, **about)
    if option.off is not None:
        word = f"--no-{words[-1][2:]}"
        container.add_argument(word, dest=name, action="store_const", const=option.off, help=option.off_help)


def asked(args: argparse.Namespace, kind: type[Asked], *what: Any, without: Collection[str] = ()) -> Asked:
    """What a command line gives of a class's options but for some names and groups; InputError names the one at fault.

    Args:
        what: what the class takes beside options.
    """
    known = kind.options(without=without)
    unsaid = {name: (None,) if option.off is False else (None, False) for name, option in known.items()}
    values = {name: getattr(args, name, None) for name in known}
    with named(known):
        return kind(
            *what, **{name: value for name, value in values.items() if not any(value is one for one in unsaid[name])}
        )


@contextlib.contextmanager
def named(options: Mapping[str, Option]) -> Iterator[None]:
    """Options of a class as the words of a command line that they came from."""
    try:
        yield
    except InputError as error:
        outer, _, name = (error.where or "").rpartition(": ")
        if name not in options:
            raise
        message = re.sub(
            r"^(given with(?:out)?) (\w+)",
            lambda found: f"{found[1]} {_word(found[2], options[found[2]]) if found[2] in options else found[2]}",
            error.message,
        )
        word = _word(name, options[name])
        raise InputError(message, where=f"{outer}: {word}" if outer else word) from None


def _word(name: str, option: Option) -> str:
    return option.metavar if option.is_bare else f"--{option.word or name.replace('_', '-')}"
