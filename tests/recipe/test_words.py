"""Words of a command line and what they stand for."""

from __future__ import annotations

import pytest

from tinysplat_runtime.recipe import words
from tinysplat_runtime.recipe.words import AutoViews, byte_count


@pytest.mark.parametrize(
    ("text", "bytes_"),
    [
        ("4096", 4096),
        ("100KB", 100_000),
        ("1.5 MB", 1_500_000),
        ("2gb", 2_000_000_000),
        ("4KiB", 4096),
        ("3 GiB", 3_221_225_472),
        ("1023.9 GiB", int(1023.9 * 2**30)),
    ],
)
def test_sizes_have_units_of_thousands_or_of_1024(text: str, bytes_: int) -> None:
    assert byte_count(text) == bytes_


@pytest.mark.parametrize(
    ("text", "views"),
    [
        ("0,4", (0, 4)), ("7", (7,)), (" 3 , 1", (3, 1)), ("0-8:4,20", (0, 4, 8, 20)), ("2-4", (2, 3, 4)),
        ("5-5", (5,)), ("0-9:3", (0, 3, 6, 9)), ("9999999", (9_999_999,)), ("1-3:1", (1, 2, 3)), ("all", "all"),
        ("auto", AutoViews()), ("auto:2", AutoViews(2)), ("auto:10", AutoViews(10)),
    ],
)  # fmt: skip
def test_views_are_indices_with_ranges_all_or_how_many(text: str, views: object) -> None:
    assert words.views(text) == views


@pytest.mark.parametrize(("text", "size"), [("384x256", (256, 384)), ("1X1", (1, 1)), ("20x3", (3, 20))])
def test_a_size_is_height_by_width(text: str, size: tuple[int, int]) -> None:
    assert words.size(text) == words.size_or_full(text) == size
    assert words.size_or_full("full") == "full"
