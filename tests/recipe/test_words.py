"""Words of a command line and what they stand for."""

from __future__ import annotations

import pytest

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.recipe.words import byte_count


@pytest.mark.parametrize(
    ("text", "bytes_"),
    [
        ("4096", 4096), ("7b", 7), ("100KB", 100_000), ("1.5 MB", 1_500_000), ("2gb", 2_000_000_000),
        ("4KiB", 4096), ("1.5MiB", 1_572_864), ("3 GiB", 3_221_225_472), ("1", 1), ("1023.9 GiB", int(1023.9 * 2**30)),
    ],
)  # fmt: skip
def test_sizes_have_units_of_thousands_or_of_1024(text: str, bytes_: int) -> None:
    assert byte_count(text) == bytes_


@pytest.mark.parametrize("text", ["", "KB", "9 stone", "-4KB", "0.5", "0", "1024 GiB", "1e99", "nan", "4 K"])
def test_what_is_no_size_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="expected a size such as"):
        byte_count(text)
