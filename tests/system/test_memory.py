"""How much memory there is: the machine's or the container's, whichever is less, and what is known of either."""

from collections.abc import Callable

import pytest

from tinysplat_runtime.system.memory import available_bytes

MEMINFO = "MemTotal:       4000 kB\nMemFree:         500 kB\nMemAvailable:   3000 kB\nBuffers:  70 kB\n"


@pytest.mark.parametrize(
    ("meminfo", "limit", "used", "expected"),
    [
        (MEMINFO, None, None, 3000 * 1024),
        (MEMINFO, "max", "1000", 3000 * 1024),
        (MEMINFO, "2000000\n", "300000\n", 1_700_000),
        (MEMINFO, "90000000", "1000", 3000 * 1024),
        (MEMINFO, "2000", None, 3000 * 1024),
        ("MemFree: 500 kB\n", "2000", "500", 1500),
        ("MemFree: 500 kB\n", None, None, None),
        (None, "2000", "500", 1500),
        (None, None, None, None),
    ],
)
def test_the_lesser_of_what_machine_and_container_leave(
    free_memory: Callable[..., None], meminfo: str | None, limit: str | None, used: str | None, expected: int | None
) -> None:
    free_memory(meminfo, limit, used)
    assert available_bytes() == expected
