"""Words of a command line and the values that they stand for."""

import pytest

from tinysplat_runtime.system import kinds


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
    assert kinds.byte_count(text) == bytes_


@pytest.mark.parametrize(("text", "size"), [("384x256", (256, 384)), ("1X1", (1, 1)), ("20x3", (3, 20))])
def test_a_size_is_height_by_width(text: str, size: tuple[int, int]) -> None:
    assert kinds.size(text) == size
