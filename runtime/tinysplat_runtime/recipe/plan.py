"""What photos will take until they are a file, step by step, said before work begins."""

from __future__ import annotations

from dataclasses import dataclass

from ..graphs.enlarge import LARGE_PIXELS
from ..scene.scenes import Scene
from ..system.threads import available_cores
from .own import OWN_PIXELS, looked_at
from .prepare import ALL_VIEWS
from .refinement import CPU_SECONDS as REFINING

READING = 65e-9
"""Seconds of one core to read a pixel of a photo's file and scale it down; JPEG of 2 and of 8 megapixels."""

LOOKING = 0.1
"""Seconds of one core to compare a photo's thumbnail and corners with those of others."""

NETWORK, CODING, DRAWING = 11e-6, 3e-6, 15e-6
"""Seconds of one core for a pixel that the network is given, that is coded, and that is drawn to be compared."""

PHOTO_BYTES, BYTES_EXPONENT = 26_000, 0.69
"""Bytes of a photo of 256×256 by default, and how they grow with its pixels; captures of 16 to 45 photos took 23,000 to
29,000."""

LONG_S = 20.0
"""A few photos get a plan where they take longer."""


@dataclass(frozen=True)
class Plan:
    """What is to come.

    Attributes:
        seconds: of each step, in the order of work.
        file_bytes: of the file; None where nobody knows.
    """

    seconds: dict[str, float]
    file_bytes: float | None

    @property
    def total(self) -> float:
        """Seconds of all steps."""
        return sum(self.seconds.values())

    def __str__(self) -> str:
        steps = ", ".join(f"{name} {seconds:.0f}" for name, seconds in self.seconds.items() if seconds >= 1)
        size = "" if self.file_bytes is None else f" and {self.file_bytes / 1000:.0f} KB"
        return f"about {max(self.total, 1):.0f} s{size}" + (f": {steps}" if steps else "")


def planned(scene: Scene, *, is_refined: bool, is_usual: bool, cores: int | None = None) -> Plan:
    """The plan of photos as the network will have them.

    Args:
        scene: these photos.
        is_refined: whether they correct what comes of them.
        is_usual: whether they are coded by default, so that bytes are known.
        cores: to work on; None for those available.
    """
    cores = cores or available_cores()
    photos, camera = len(scene.frames), scene.frames[0].camera
    stored = scene.frames[0].photo_camera or camera
    pixels, read = camera.width * camera.height, READING * stored.width * stored.height
    seconds = {
        "checking": photos * (read + LOOKING),
        "network": photos * (read + min(pixels, LARGE_PIXELS) * NETWORK / cores),
        "refining": photos * (read + pixels * REFINING / cores) if is_refined else 0.0,
        "coding": photos * pixels * CODING / cores,
        "comparing": len(looked_at(photos)) * (read + min(pixels, OWN_PIXELS) * DRAWING / cores),
    }
    return Plan(seconds, photos * PHOTO_BYTES * (pixels / 256**2) ** BYTES_EXPONENT if is_usual else None)


def is_worth_saying(plan: Plan, photos: int) -> bool:
    """Whether somebody waits long enough for it."""
    return photos not in ALL_VIEWS or plan.total > LONG_S
