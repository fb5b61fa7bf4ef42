"""What all modes share: the job that one is given, and what a mode is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

from numpy.typing import NDArray

from ...container.body import Body
from ...container.photos import NetworkRef
from ...gaussian.gaussians import Gaussians
from ...graphs.inference import GraphStore
from ..layers import OpenFile

if TYPE_CHECKING:  # who decodes loads no encoder
    from ...scene.neighbours import Group
    from ...scene.scenes import Scene
    from ..encoder import EncodeStats, PlaneCoder, SceneEncoder
    from ..profiles import Profile
    from ..search import Coder


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
        from ...graphs.predict import NetworkLimits
        from ...graphs.walk import capture_groups

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

    def encoder(self) -> SceneEncoder:
        """The Gaussians' own encoder, under the profile."""
        from ..encoder import SceneEncoder

        return SceneEncoder(
            self.gaussians,
            self.profile,
            self.store,
            threads=self.threads,
            drop_invalid=self.drop_invalid,
            stats=self.stats,
            plane_coder=self.plane_coder,
        )


BodyKind = TypeVar("BodyKind", bound=Body)


@dataclass(frozen=True)
class Mode(Generic[BodyKind]):
    """What a file can carry; `container/bodies.py` has the body of the same mode, which reads and describes itself.

    Attributes:
        name: as users say; its body's `mode`.
        encode: a job to the file's bytes; InputError and NumericError for what cannot be coded.
        decode: an opened file and its body to its Gaussians; FormatError where it is damaged.
        coder: what codes a job at any Q_g, of modes in which a size or a fidelity can be searched for.
    """

    name: str
    encode: Callable[[Job], bytes]
    decode: Callable[[OpenFile, BodyKind], Gaussians]
    coder: Callable[[Job], Coder] | None = None
