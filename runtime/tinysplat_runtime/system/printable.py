"""Characters that print, and text of strangers made fit for a terminal or a page.

The list is docs/FORMAT.md's, "NOTE". It names ranges of characters and not Unicode's categories, which differ from
version to version: a file that one reader takes no other refuses.
"""

import re
from collections.abc import Sequence

UNPRINTED = (
    (0x00, 0x1F), (0x7F, 0x9F), (0xAD, 0xAD), (0x600, 0x605), (0x61C, 0x61C), (0x6DD, 0x6DD), (0x70F, 0x70F),
    (0x890, 0x891), (0x8E2, 0x8E2), (0x180E, 0x180E), (0x200B, 0x200F), (0x2028, 0x202E), (0x2060, 0x206F),
    (0xD800, 0xDFFF), (0xFEFF, 0xFEFF), (0xFFF9, 0xFFFB), (0x110BD, 0x110BD), (0x110CD, 0x110CD), (0x13430, 0x1343F),
    (0x1BCA0, 0x1BCA3), (0x1D173, 0x1D17A), (0xE0000, 0xE007F),
)  # fmt: skip
"""First and last of each range: controls, marks that hide or change direction, ends of lines, halves of pairs."""

_UNPRINTED = re.compile("[" + "".join(f"{re.escape(chr(a))}-{re.escape(chr(b))}" for a, b in UNPRINTED) + "]")


def type_of(value: object) -> str:
    """The type of a value, with its article: `an int`."""
    name = type(value).__name__
    return f"{'an' if name[0] in 'aeiouAEIOU' else 'a'} {name}"


def enumerated(names: Sequence[str], most: int = 3) -> str:
    """The first names of a list, and how many more there are."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def unprinted(text: str) -> str | None:
    """The first character that does not print."""
    match = _UNPRINTED.search(text)
    return match[0] if match else None


def printable(text: str) -> str:
    """The text in one line, with what does not print as Python would write it."""
    return _UNPRINTED.sub(lambda match: repr(match[0])[1:-1], " ".join(text.split()))
