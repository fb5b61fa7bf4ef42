"""The JavaScript decoder, one process for all tests of a module."""

from collections.abc import Iterator

import pytest
from web.node import Decoder


@pytest.fixture(scope="module")
def decoder() -> Iterator[Decoder]:
    """tsplat.js in node."""
    with Decoder() as running:
        yield running
