"""Which of views and a list is taken by how each shows photos that it has not seen."""

from __future__ import annotations

import pytest

pytest.importorskip("numba")

from tinysplat_runtime.recipe.contest import Contest, Shown


@pytest.mark.parametrize(
    ("views", "one", "wins"),
    [
        ((25.0, 22.0, 0.85), (26.0, 23.0, 0.88), True),
        ((25.0, 22.0, 0.85), (24.0, 23.0, 0.88), False),  # most photos are shown worse
        ((25.0, 22.0, 0.85), (26.0, 19.0, 0.88), False),  # one is far worse
        ((25.0, 22.0, 0.85), (26.0, 23.0, 0.80), False),  # nearer, but blurred
    ],
)
def test_a_list_wins_where_it_is_worse_in_nothing(views: tuple, one: tuple, wins: bool) -> None:
    assert (Contest(Shown(*views), Shown(*one)).winner == "list") == wins
