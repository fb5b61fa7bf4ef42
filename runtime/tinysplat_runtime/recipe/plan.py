"""What photos become, said before a network runs: bytes. How long it takes, each step tells by what it has done."""

from __future__ import annotations

from ..scene.scenes import Scene

PHOTO_BYTES, BYTES_EXPONENT = 26_000, 0.69
"""Bytes of a photo of 256×256 by default, and how they grow with its pixels that count; captures of 16 to 45 photos
took 23,000 to 29,000."""


def expected_bytes(scene: Scene) -> float:
    """Of the file of photos as the network will have them, where they are coded by default."""
    camera = scene.cameras[0]
    known = (frame.known() for frame in scene.frames)
    counted = (camera.width * camera.height * (1.0 if which is None else float(which.mean())) for which in known)
    return sum(PHOTO_BYTES * (pixels / 256**2) ** BYTES_EXPONENT for pixels in counted)
