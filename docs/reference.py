"""The references in pages, made from what they describe: docs/CLI.md of the parsers, docs/API.md of docstrings.

Between `<!-- of NAME -->` and `<!-- end -->` a page holds the signature and docstring of NAME, or with `commands` every
command. `make reference` writes them anew; a test holds them to be as the code has it.
"""

import argparse
import inspect
import pkgutil
import re
import sys
import textwrap
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
PAGES = ("CLI.md", "API.md")
PACKAGE = "tinysplat_runtime"
WIDTH = 100
"""Signatures of more columns stand a parameter to a line."""

MARK = re.compile(r"<!-- of ([\w.]+) -->\n.*?<!-- end -->", re.DOTALL)
SECTION = re.compile(r"^(Args|Attributes|Returns|Yields|Raises):\n((?:    .*\n|\n)+)", re.MULTILINE)
ITEM = re.compile(r"^([\w*][\w*, ]*): (.*)$")


def filled(page: str) -> str:
    """A page's text with every mark filled."""
    marks = {found[1] for found in MARK.finditer(page)}
    return MARK.sub(lambda found: f"<!-- of {found[1]} -->\n{_of(found[1], marks)}\n<!-- end -->", page)


def _of(name: str, marks: Collection[str]) -> str:
    return "\n\n".join(_commands() if name == "commands" else _described(name, marks))


def _commands() -> Iterator[str]:
    """Every command: what it does, how it is called, and its options by group."""
    from tinysplat_runtime.cli.parser import build_parser, join_commands

    _, commands = build_parser()
    join_commands(commands, ["--help"])  # those of other packages, too
    helps = {action.dest: action.help for action in commands._choices_actions}
    for name, command in sorted(commands.choices.items()):
        usage = command.usage or _usage(command)
        yield f"## {name}\n\n{_sentence(helps[name] or '')}\n\n```text\n{usage.replace('%(prog)s', command.prog)}\n```"
        if command.description:
            yield " ".join(command.description.split())
        for group in command._action_groups:
            rows = [_row(action) for action in group._group_actions if action.help != argparse.SUPPRESS]
            if rows:
                title = "" if group.title in ("positional arguments", "options") else _sentence(f"{group.title}:")
                yield "\n\n".join(filter(None, [title, "\n".join(["| | |", "|---|---|", *rows])]))


def _usage(command: argparse.ArgumentParser) -> str:
    """What a command takes, where its parser leaves the line to argparse, whose line differs by version."""
    words = [str(action.metavar) for action in command._actions if not action.option_strings]
    return " ".join([command.prog, *words, "[options]"])


def _row(action: argparse.Action) -> str:
    value = action.metavar or ("{" + ",".join(map(str, action.choices)) + "}" if action.choices else "")
    shown = f"[{value}]" if action.nargs == "?" and action.option_strings else value
    names = ", ".join(action.option_strings)
    said = " ".join((action.help or "").split())
    return f"| `{_cell(f'{names} {shown}'.strip())}` | {_cell(said)} |"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + ("" if text.endswith((".", ":")) else ".")


def _described(name: str, marks: Collection[str]) -> Iterator[str]:
    """A class with its public members that have no mark, a function, or all that is public in a module."""
    found = pkgutil.resolve_name(f"{PACKAGE}.{name}")
    if inspect.ismodule(found):
        yield _text(found)
        for member in vars(found).values():
            if getattr(member, "__module__", "") == found.__name__ and not member.__name__.startswith("_"):
                yield from _described(f"{name}.{member.__name__}", marks)
        return
    yield f"### `{found.__name__}`"
    options = getattr(found, "options", None)
    if not options and not (inspect.isclass(found) and issubclass(found, Exception)):
        yield _signature(found)
    yield _text(found)
    if options:
        rows = [_option(option, about, found) for option, about in options().items() if option in vars(found)]
        yield "\n".join(["| | | default |", "|---|---|---|", *rows])
    for member, value in vars(found).items() if inspect.isclass(found) and not options else ():
        if member.startswith("_") or f"{name}.{member}" in marks:
            continue
        if isinstance(value, property):
            yield f"`{found.__name__}.{member}`: {_text(value)}"
        elif inspect.isfunction(value) or isinstance(value, classmethod):
            yield f"#### `{found.__name__}.{member}`"
            yield _signature(getattr(found, member))
            yield _text(value)


def _signature(found: Any) -> str:
    signature = inspect.signature(found)
    parameters = [parameter for parameter in signature.parameters.values() if parameter.name != "self"]
    parts = [re.sub(r": '([^']*)'", r": \1", str(parameter)) for parameter in parameters]
    parts = [re.sub(r"<[\w.]+ object at 0x\w+>", "…", part) for part in parts]
    kinds = [parameter.kind for parameter in parameters]
    if inspect.Parameter.KEYWORD_ONLY in kinds and inspect.Parameter.VAR_POSITIONAL not in kinds:
        parts.insert(kinds.index(inspect.Parameter.KEYWORD_ONLY), "*")
    returns = "" if inspect.isclass(found) else f" -> {signature.return_annotation}"
    line = f"{found.__name__}({', '.join(parts)}){returns}"
    if len(line) > WIDTH:
        line = f"{found.__name__}(\n" + "".join(f"    {part},\n" for part in parts) + f"){returns}"
    return f"```py\n{line}\n```"


def _text(found: Any) -> str:
    """A docstring as Markdown: what stands under Args and its like becomes a list."""
    text = inspect.cleandoc(found.__doc__ or "") + "\n"
    return SECTION.sub(lambda section: f"{section[1]}:\n\n{_items(section[2])}\n", text).strip()


def _items(block: str) -> str:
    items: list[str] = []
    for line in textwrap.dedent(block).splitlines():
        if start := ITEM.match(line):
            items.append(f"- `{start[1]}`: {start[2]}")
        elif items:
            items[-1] += f" {line.strip()}" if line.strip() else ""
        elif line.strip():
            items.append(f"- {line.strip()}")
    return "\n".join(items) + "\n"


def _option(name: str, about: Any, owner: type) -> str:
    default = owner.__dataclass_fields__[name].default  # type: ignore[attr-defined]
    value = f"{name}={about.metavar}" if about.metavar else name
    said = about.help or f"False: {about.off_help}"
    return f"| `{_cell(value)}` | {_cell(said)} | `{default}` |"


if __name__ == "__main__":
    sys.path[:0] = [str(DOCS.parent / "runtime"), str(DOCS.parent)]
    for name in PAGES:
        path = DOCS / name
        path.write_text(filled(path.read_text("utf-8")), "utf-8")
