"""Body `Points`, of mode list: Gaussians that belong to no pixels. `free.py` has its sections."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import ClassVar

from ..gaussian.planes import PlaneClass
from ..scene.cameras import Camera
from . import layout as L
from .body import Body, Description, Opened
from .free import CLASSES, LIST, TIER, FreeScene, read_list
from .records import ChannelRecord
from .sections import require


@dataclass(frozen=True, kw_only=True)
class Points(Body):
    """One scene without cameras of pixels, in tiers.

    Attributes:
        scene: metadata.
        viewpoints: cameras of the photos that the Gaussians were made from, as far as they are known.
    """

    mode: ClassVar[str] = "list"
    sign: ClassVar[bytes] = LIST
    kinds: ClassVar[frozenset[bytes]] = frozenset({LIST, TIER, L.CAMERAS, L.PARAMETER_SETS})

    scene: FreeScene
    viewpoints: tuple[Camera, ...] = ()

    @classmethod
    def read(cls, file: Opened) -> Points:
        """Parse and check the sections LIST, TIER and CAMS."""
        most = file.limits.max_layers
        require(1 <= file.layer_count <= most, file.scene, f"{file.layer_count} tiers, accepted are 1 to {most}")
        require(file.views <= L.MAX_VIEWS, file.scene, f"{file.views} cameras, accepted are 0 to {L.MAX_VIEWS}")
        require(file.table.count == 1, file.scene, f"rows of a list with {file.table.count} pictures")
        file.check_rows(CLASSES)
        return cls(scene=read_list(file), viewpoints=file.cameras_of(range(file.views)))

    def describe(self) -> Description:
        """Gaussians, tiers, and cameras of photos."""
        scene = self.scene
        tiers = tuple(tier.count for tier in scene.tiers)
        found = scene.count, scene.degree, scene.basis.shape[1]
        return Description(*found, tiers=tiers, viewpoints=self.viewpoints)

    @staticmethod
    def step(layer: int, record: ChannelRecord, number: int) -> Hashable:
        """Shapes, colours and rotations; a tier behind the first shows with its colours at once."""
        if record.plane_class == PlaneClass.ROTATION:
            return 2
        return int(layer == 0 and record.plane_class == PlaneClass.COLOR)

    def picture_name(self, layer: int, channel: ChannelRecord, view: int) -> str:
        """There is one of each in a tier: `color2`, `tier 1 color2`."""
        return f"tier {layer} " * (layer > 0) + channel.name
