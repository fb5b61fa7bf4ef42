"""A capture as few Gaussians that any viewer draws: drawn from its pixels, and trained until they show its photos."""

LEAST_GAUSSIANS, MOST_GAUSSIANS = 2_000, 500_000
"""How many a list begins with where nobody says: as many as its photos have detail (`start.Surface`), within these."""

STEPS_A_PHOTO, LEAST_STEPS, MOST_STEPS = 60, 450, 4_000
"""Usual steps: so many a photo, between these; the least are more for photos with more texture."""

FEW_PHOTOS, LEAST_OF_MORE = 6, 800
"""Up to how many photos those are the least steps, and the least of more photos."""

PLAIN, ROUGH = 0.125, 2.0
"""Mean root of contrast up to which photos are plain, and how many times the least steps others take at most."""

LEAST_A_PHOTO = 4
"""Steps of each photo, however many there are."""


def usual_steps(photos: int, texture: float = PLAIN) -> int:
    """Of training on so many photos of so much texture, the mean root of their contrast."""
    least = round(LEAST_STEPS * min(max(texture / PLAIN, 1), ROUGH))
    least = max(least, LEAST_OF_MORE) if photos > FEW_PHOTOS else least
    return max(min(max(least, STEPS_A_PHOTO * photos), MOST_STEPS), LEAST_A_PHOTO * photos)


DEFAULT_SECONDS = 1_800.0
"""For how long steps may go on, where nobody said."""
