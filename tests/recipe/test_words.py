"""Words of requests and what they stand for."""

import pytest

from tinysplat_runtime.recipe import words
from tinysplat_runtime.recipe.words import AutoViews


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


def test_a_size_can_be_that_of_the_photos() -> None:
    assert words.size_or_full("full") == "full" and words.size_or_full("20x3") == (3, 20)
