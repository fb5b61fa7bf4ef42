"""Characters that print are those of docs/FORMAT.md's list, and text of strangers is one line of them."""

import re
from pathlib import Path

import pytest

from tinysplat_runtime.system.printable import printable, unprinted

PAGE = Path(__file__).resolve().parents[2] / "docs" / "FORMAT.md"


def test_what_does_not_print_is_what_the_format_lists() -> None:
    listed = re.search(r"^U\+(0000–001F, .*)\.$", PAGE.read_text("utf-8"), re.MULTILINE)
    assert listed
    ends = [part.split("–") for part in re.split(", | and ", listed[1])]
    ranges = [range(int(end[0], 16), int(end[-1], 16) + 1) for end in ends]
    for n in {at for one in ranges for at in (one[0] - 1, one[0], one[-1], one[-1] + 1) if at >= 0}:
        assert unprinted(f"a{chr(n)}b\x7f") == (chr(n) if any(n in one for one in ranges) else "\x7f")
    assert unprinted("größer – 3 µm") is None


@pytest.mark.parametrize(
    ("text", "line"),
    [("a\t b\n\nc ", "a b c"), ("\x1b[31mred\u202e!", r"\x1b[31mred\u202e!"), ("Łódź'\"\\", "Łódź'\"\\")],
)
def test_text_of_strangers_is_one_line_that_steers_nothing(text: str, line: str) -> None:
    assert printable(text) == line
