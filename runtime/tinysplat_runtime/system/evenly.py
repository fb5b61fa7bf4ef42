"""Which of many, where some are looked at: evenly, from the first to the last."""

import numpy as np


def evenly(count: int, most: int) -> list[int]:
    """Rising indices of at most so many of `count`: all where there are no more, else as evenly as they can lie."""
    return np.linspace(0, count - 1, min(count, most)).round().astype(int).tolist()
