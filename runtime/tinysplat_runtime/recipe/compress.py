"""Gaussians to a file."""

import math
from dataclasses import dataclass, replace

from ..codec.job import EncodeStats
from ..formats.viewpoints import pixels_of
from ..gaussian.gaussians import Gaussians
from ..scene.scenes import Scene
from ..system.told import NOBODY, Told
from .coding import code
from .kinds import kind_of
from .request import CompressRequest
from .steps import Kind, Tools


@dataclass(frozen=True)
class Encoded:
    """The result of a request.

    Attributes:
        data: the file's bytes.
        gaussians: what was coded, if `keep` asked for it: those of large photos take gigabytes.
        raw_bytes: size of their arrays.
        stats: what coding measured, including the seconds of each step.
        kind: what they became.
        scene: the photos that they were made of, if there were any.
        doubts: what is likely wrong with the scene, a line each.
    """

    data: bytes
    gaussians: Gaussians | None
    raw_bytes: int
    stats: EncodeStats
    kind: Kind
    scene: Scene | None = None
    doubts: tuple[str, ...] = ()

    @property
    def seconds(self) -> float:
        """Seconds of all steps."""
        return sum(self.stats.watch.seconds.values())

    @property
    def photos(self) -> Scene:
        """The scene of Gaussians that came from photos."""
        assert self.scene is not None
        return self.scene


def compress(
    request: CompressRequest, tools: Tools, told: Told = NOBODY, *, stats: EncodeStats | None = None, keep: bool = False
) -> Encoded:
    """Gaussians of any network, or of a trained scene, to a `.tsplat` file's bytes.

    Args:
        request: which Gaussians, and how.
        tools: to do it with, such as a `Runtime`.
        told: who is told what goes on.
        stats: filled with what coding measured.
        keep: hand on the Gaussians too.

    Raises:
        FormatError, InputError, NumericError: see `Runtime.compress`.
    """
    stats, gaussians = stats or EncodeStats(), request.gaussians
    if request.cameras is not None:
        gaussians = pixels_of(gaussians, request.cameras)
    gaussians = gaussians.with_notes(replace(gaussians.notes, **request.notes))
    kind = kind_of(gaussians, request, keep_all=request.keep_all, seconds=request.seconds or math.inf)
    told.plan(kind.shares)
    data = code(gaussians, request, tools, kind, stats=stats, told=told)
    return Encoded(data, gaussians if keep else None, gaussians.nbytes, stats, kind)
