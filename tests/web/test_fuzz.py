"""A fixed small set of the attacks of `web.campaign`."""

from __future__ import annotations

from web.campaign import attack


def test_damaged_files_are_refused_or_decoded_as_in_python() -> None:
    result = attack(0, 400)
    assert result["findings"] == []
    assert result["outcomes"]["refused, runtime refused"] > 150  # the damage does reach the checks
    assert result["outcomes"]["decoded, runtime decoded"] > 40  # and what is right is read
