"""Body `Points`, of mode free: Gaussians that belong to no pixels. `free.py` has its sections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from ..scene.cameras import Camera
from . import layout as L
from .body import Body, Description, Opened, Piece
from .free import FREE, FREE_POINTS, FREE_TIER, read_free
from .planes import PLANE_KINDS, read_pictures
from .records import FreeScene, PlanePictures
from .sections import Section, require
from .viewpoints import VIEWPOINTS, read_viewpoints


@dataclass(frozen=True)
class TierPictures(PlanePictures):
    """The pictures of tiers."""

    def prefixes(self) -> list[dict[str, Any]]:
        """Where a picture gets better; `layer` is the tier. A tier behind the first shows with its colours at once."""
        found: list[dict[str, Any]] = []
        for entry in super().prefixes():
            is_of_last = bool(found) and found[-1]["layer"] == entry["layer"] > 0
            if is_of_last and not any(name.startswith("color") for name in found[-1]["adds"]):
                found[-1] = {**entry, "adds": [*found[-1]["adds"], *entry["adds"]]}
            else:
                found.append(entry)
        return found


@dataclass(frozen=True, kw_only=True)
class Points(Body):
    """One scene without cameras of pixels; the pictures of its tiers lie as those of layers do."""

    mode: ClassVar[str] = "free"
    kinds: ClassVar[frozenset[bytes]] = (
        frozenset({FREE, FREE_TIER, FREE_POINTS, VIEWPOINTS, L.PARAMETER_SETS}) | PLANE_KINDS
    )
    signs: ClassVar[frozenset[bytes]] = frozenset({FREE})

    scene: FreeScene
    points: tuple[Section, ...]
    viewpoints: tuple[Camera, ...] = ()

    @classmethod
    def read(cls, file: Opened) -> Points:
        """Parse and check the sections FREE, TIER, FREP and SEEN."""
        counts = f"{file.views} views and {file.layer_count} layers of a list"
        require(file.views == file.layer_count == 0, file.scene, counts)
        scene = read_free(file.sections, file.limits)
        channels = [tuple(channel.record for channel in tier.channels) for tier in scene.tiers]
        for number, records in enumerate(channels):
            if any(record.streams for record in records):
                file.only(L.PARAMETER_SETS, number)
        points = tuple(section for section in file.sections if section.kind == FREE_POINTS)
        found = read_pictures(file.sections, channels)
        pictures = TierPictures(found.channels, found.data, found.sections)
        seen = read_viewpoints(file.sections, file.origin)
        return cls(pictures=pictures, scene=scene, points=points, viewpoints=seen)

    def describe(self) -> Description:
        """Gaussians, and bytes of their positions."""
        scene = self.scene
        lengths = (stream.length for stream in self.points)
        pieces = tuple(Piece("position", None, length) for length in lengths)
        tiers = tuple(tier.count for tier in scene.tiers)
        return Description(
            gaussians=scene.count,
            sh_degree=scene.degree,
            k=scene.basis.shape[1],
            pieces=pieces,
            tiers=tiers,
            viewpoints=self.viewpoints,
        )

    def picture_name(self, layer: int, channel: int, view: int) -> str:
        """There is one of each in a tier: `color2`, `tier 1 color2`."""
        return f"tier {layer} " * (layer > 0) + self.pictures.channels[layer][channel].name
