"""ES modules as one script, so that a page needs no other file: `bundle`.

Each module becomes a function that returns what it exports. What it understands of the language is how our own modules
are written: imports of names from files beside, on a line each, and exports of declarations.
"""

from __future__ import annotations

import re
from collections.abc import Callable

IMPORT = re.compile(r'^import \{ ([^}]*) \} from "\./([\w./-]+)";\n', re.MULTILINE)
EXPORT = re.compile(r"^export ((?:async )?(?:const|let|function\*?|class)) (\w+)", re.MULTILINE)


def bundle(entry: str, read: Callable[[str], str]) -> str:
    """The script of a module and of all that it imports, each once, in the order in which they need one another.

    Args:
        entry: name of the module that is run.
        read: the text of a module by its name.
    """
    done: dict[str, str] = {}
    _add(entry, read, done)
    return "\n".join(done.values())


def _add(name: str, read: Callable[[str], str], done: dict[str, str]) -> None:
    text = read(name)
    for _, other in IMPORT.findall(text):
        if other not in done:
            _add(other, read, done)
    body = IMPORT.sub(lambda found: f"const {{ {_renamed(found[1])} }} = {_variable(found[2])};\n", text)
    names = [found[2] for found in EXPORT.finditer(body)]
    body = EXPORT.sub(r"\1 \2", body)
    done[name] = f"const {_variable(name)} = (() => {{\n{body}\nreturn {{ {', '.join(names)} }};\n}})();"


def _renamed(names: str) -> str:
    return names.replace(" as ", ": ")


def _variable(name: str) -> str:
    return "$" + re.sub(r"\W", "_", name.removesuffix(".js"))
