"""The decoder in JavaScript: `tsplat.js` and the modules that it consists of, as one text for pages that carry it."""

import importlib.resources
import re
from collections.abc import Callable

ENTRY = "tsplat.js"

_IMPORT = re.compile(r'^import \{([^}]*)\} from "(\.{1,2}/[^"]+)";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:async )?function|const|class|let)", re.MULTILINE)
_COMMENT = re.compile(r"^ */\*\*.*?\*/\n|^ *//[^\n]*\n| // [^\n\"'`]*$|^\s+", re.MULTILINE | re.DOTALL)


def bundled(entry: str = ENTRY, package: str = __name__) -> str:
    """tsplat.js, or another module, and all that it imports as one ES module with the same exports.

    Modules stand in the order in which they are needed, without comments and indentation. They share one scope: names
    at their top are unique.
    """
    folder, texts = importlib.resources.files(package), dict[str, str]()
    _collect(entry, entry, lambda name: folder.joinpath(name).read_text("utf-8"), texts)
    return "".join(texts.values())


def _collect(name: str, entry: str, read: Callable[[str], str], texts: dict[str, str]) -> None:
    if name in texts:
        return
    text = read(name)
    texts[name] = ""  # of two modules that import each other, the one asked for first stands behind
    for _, path in _IMPORT.findall(text):
        _collect(_resolved(name, path), entry, read, texts)
    del texts[name]
    text = _COMMENT.sub("", _IMPORT.sub("", text))
    texts[name] = text if name == entry else _EXPORT.sub("", text)


def _resolved(name: str, path: str) -> str:
    """A path that module `name` imports from, seen from the folder of tsplat.js."""
    parts = name.split("/")[:-1]
    for part in path.split("/"):
        if part == "..":
            parts.pop()
        elif part != ".":
            parts.append(part)
    return "/".join(parts)
