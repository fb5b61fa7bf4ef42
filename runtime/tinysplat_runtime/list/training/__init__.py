"""A capture as few Gaussians that any viewer draws: drawn from its pixels, and trained until they show its photos."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ...scene.scenes import Scene

LEAST_GAUSSIANS, MOST_GAUSSIANS = 2_000, 500_000
"""How many a list begins with where nobody says: as many as its photos have detail (`start.Surface`), within these."""

NETWORK_SIDE, MOST_SIDE = 256, 320
"""Pixels of the shorter side of copies that a network makes a list's first Gaussians of, and how many photos have that
are not made smaller: of about the size that it was trained at, it finds most, and a list needs few of their pixels."""

KEPT, BYTES_EACH = 0.43, 12.5
"""Share of these that is left at the end, and bytes that a file takes for each, about."""

STEPS_A_PHOTO, LEAST_STEPS, MOST_STEPS = 45, 800, 4_000
"""Usual steps: so many a photo, between these."""

FEW_PHOTOS, STEPS_OF_FEW, LEAST_OF_FEW = 6, 100, 450
"""Up to how many photos are few; their steps, a photo and at least: more where photos have more texture."""

PLAIN, ROUGH = 0.125, 2.0
"""Mean root of contrast up to which few photos are plain, and how many times as many steps others take at most."""

LEAST_A_PHOTO = 4
"""Steps of each photo, however many there are."""


def usual_steps(photos: int, texture: float = PLAIN) -> int:
    """Of training on so many photos of so much texture, the mean root of their contrast."""
    if photos <= FEW_PHOTOS:
        return round(max(LEAST_OF_FEW, STEPS_OF_FEW * photos) * min(max(texture / PLAIN, 1), ROUGH))
    return max(min(max(LEAST_STEPS, STEPS_A_PHOTO * photos), MOST_STEPS), LEAST_A_PHOTO * photos)


DEFAULT_SECONDS = 1_800.0
"""For how long steps may go on, where nobody said."""


def for_network(scene: Scene) -> Scene:
    """A scene's photos at the size that a network makes a list's first Gaussians of."""
    camera = scene.cameras[0]
    share = NETWORK_SIDE / min(camera.height, camera.width)
    if min(camera.height, camera.width) <= MOST_SIDE:
        return scene
    return scene.resized(round(share * camera.height), round(share * camera.width))
