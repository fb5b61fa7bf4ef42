"""A capture as few Gaussians that any viewer draws: drawn from its pixels, and trained until they show its photos."""

DEFAULT_GAUSSIANS = 50_000
"""How many there may be."""

LEAST_STEPS, STEPS_A_PHOTO = 800, 50
"""Usual steps: so many a photo, and no fewer than these."""


def usual_steps(photos: int) -> int:
    """Of training on so many photos."""
    return max(LEAST_STEPS, STEPS_A_PHOTO * photos)


DEFAULT_SECONDS = 900.0
"""For how long steps may go on, where nobody said."""
