"""Body `Points`, of mode free: Gaussians that belong to no pixels. `free.py` has its sections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from . import layout as L
from .body import Body, Description, Opened, Piece
from .free import FREE, FREE_POINTS, read_free
from .planes import PLANE_KINDS, read_pictures
from .records import FreeScene
from .sections import require


@dataclass(frozen=True, kw_only=True)
class Points(Body):
    """One scene without cameras, whose pictures lie as those of a layer 0 do."""

    mode: ClassVar[str] = "free"
    kinds: ClassVar[frozenset[bytes]] = frozenset({FREE, FREE_POINTS, L.PARAMETER_SETS}) | PLANE_KINDS
    signs: ClassVar[frozenset[bytes]] = frozenset({FREE})

    scene: FreeScene

    @classmethod
    def read(cls, file: Opened) -> Points:
        """Parse and check the sections FREE and FREP."""
        counts = f"{file.views} views and {file.layer_count} layers of Gaussians without pixels"
        require(file.views == file.layer_count == 0, file.scene, counts)
        scene = read_free(file.sections, file.limits)
        records = tuple(channel.record for channel in scene.channels)
        if any(record.streams for record in records):
            file.only(L.PARAMETER_SETS)
        return cls(pictures=read_pictures(file.sections, [records]), scene=scene)

    def describe(self) -> Description:
        """Gaussians, and bytes of their positions."""
        scene = self.scene
        pieces = tuple(Piece("position", None, len(stream)) for stream in scene.grid.streams)
        return Description(gaussians=scene.count, sh_degree=scene.degree, k=scene.basis.shape[1], pieces=pieces)

    def picture_name(self, layer: int, channel: int, view: int) -> str:
        """There is one of each: `color2`."""
        return self.pictures.channels[layer][channel].name
