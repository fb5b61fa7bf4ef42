"""What is to be coded and with what, and what coding did."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

from numpy.typing import NDArray

from ..container.photos import NetworkRef
from ..container.planes import Planes
from ..errors import InputError
from ..gaussian.gaussians import Gaussians
from ..gaussian.planes import PlaneClass
from ..graphs.inference import GraphStore
from ..system.stopwatch import Stopwatch
from ..system.told import NOBODY, Told
from .profiles import EncoderSettings, Profile

if TYPE_CHECKING:  # who decodes loads no more than it needs
    from ..scene.neighbours import Group
    from ..scene.scenes import Scene
    from .hevc import CodedPlane

MAX_GLOBAL_QP = 60
"""Largest magnitude of Q_g: steps of a thousandth, and of a thousand times, the profile's own."""

PlaneCoder: TypeAlias = "Callable[[NDArray, int, EncoderSettings, NDArray | None], CodedPlane]"
"""Codes one plane; arguments and result of `hevc.encode_plane`."""


def check_qp(qp: float) -> None:
    """InputError for a Q_g beyond ±60."""
    if not -MAX_GLOBAL_QP <= qp <= MAX_GLOBAL_QP:  # also refuses NaN
        raise InputError(f"{qp:g}, accepted are -{MAX_GLOBAL_QP} to {MAX_GLOBAL_QP}", where="qp")


@dataclass
class EncodeStats:
    """What coding did.

    Attributes:
        clipped: samples outside the representable range, by class label.
        watch: seconds per stage.
        mode: what the file carries; see `modes`.
        left_out: Gaussians of a list that pictures hardly need.
        psnr: of a list, dB of pictures of the whole file against those of all that was given.
        views: where these were looked at from, for people.
    """

    clipped: dict[str, int] = field(default_factory=dict)
    watch: Stopwatch = field(default_factory=Stopwatch)
    mode: str = Planes.mode
    left_out: int = 0
    psnr: float | None = None
    views: str = ""

    def add_clipped(self, plane_class: PlaneClass, count: int) -> None:
        """So many samples of a class were clipped."""
        self.clipped[plane_class.label] = self.clipped.get(plane_class.label, 0) + count


@dataclass(frozen=True)
class PhotoScene:
    """Photos as the network was given them, and which network it was.

    Attributes:
        images: (V, H, W, 3) float32 RGB in [0, 1].
        network: the network's name and hash, and its depth range.
        model: the network as the user named it.
        groups: in which it was given them.
    """

    images: NDArray
    network: NetworkRef
    model: str
    groups: tuple[Group, ...]

    @classmethod
    def of(cls, scene: Scene, model: str, store: GraphStore) -> PhotoScene:
        """The photos of a scene that the network `model` was run on."""
        from ..network.predict import NetworkLimits
        from ..network.walk import capture_groups

        near, far = scene.depth_range()
        groups = capture_groups(scene.cameras, near, far, NetworkLimits.of(store.network(model)))
        return cls(scene.images(), NetworkRef(*store.network_ref(model), near, far), model, groups)


@dataclass(frozen=True)
class Job:
    """What is to be coded, and with what.

    Attributes:
        gaussians: per pixel, with cameras; the file carries their notes.
        profile: how planes and photos are coded.
        qp: Q_g.
        store: opens graphs.
        threads: planes coded at a time; never changes the bytes.
        stats: filled with what coding measured.
        drop_invalid: make Gaussians at or behind their own camera transparent in place of refusing them.
        photos: what a network made the Gaussians of, for the modes that carry it.
        plane_coder: what codes a plane; None for `hevc.encode_plane`.
        told: who is told how many planes are coded.
    """

    gaussians: Gaussians
    profile: Profile
    qp: float
    store: GraphStore
    threads: int
    stats: EncodeStats
    drop_invalid: bool = False
    photos: PhotoScene | None = None
    plane_coder: PlaneCoder | None = None
    told: Told = NOBODY
