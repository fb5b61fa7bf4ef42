"""How much a file may ask for."""

from __future__ import annotations

from dataclasses import dataclass

from .layout import MAX_VIEWS


@dataclass(frozen=True)
class Limits:
    """What a reader accepts before it takes memory.

    Attributes:
        max_pixels: Gaussians over all views and layers.
        max_memory_bytes: bytes that decoding takes, as `bounds.decoding_bytes` counts them.
        max_views: views.
        max_layers: layers.
    """

    max_pixels: int = 1 << 26
    max_memory_bytes: int = 8 << 30
    max_views: int = MAX_VIEWS
    max_layers: int = 16

    @classmethod
    def for_describing(cls, max_pixels: int | None = None, max_memory_bytes: int | None = None) -> Limits:
        """As many Gaussians and as much memory as any file states unless they are given: describing takes neither."""
        return cls(max_pixels or 1 << 62, max_memory_bytes or 1 << 62)
