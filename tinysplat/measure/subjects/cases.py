"""A subject, from what there is to photos to Gaussians: Source → Window → Shots → Case."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.api import Runtime
from tinysplat_runtime.errors import TinySplatError
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.graphs.masked import hidden
from tinysplat_runtime.graphs.predict import predict
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.scenes import Scene
from tinysplat_runtime.system.stopwatch import Stopwatch

from ..rows import code_fingerprint, digest, model_fingerprint

DEPTHS = 16
"""Places along a pixel's ray, uniform in inverse depth from far to near."""

SHARE = 0.5
"""Share of them that must lie in the frame of a context view for the pixel to be covered."""

FILE = "file"
"""Kind of the one window of a Gaussian file."""


@dataclass(frozen=True)
class Window:
    """Frames of one scene: those that a network gets, and those that its Gaussians are held against.

    Attributes:
        kind: `near`, `wide`, `multi`, a data set's name or FILE.
        context, targets: frames.
    """

    kind: str
    context: tuple[int, ...]
    targets: tuple[int, ...]

    def __str__(self) -> str:
        return f"{self.kind} {','.join(map(str, self.context))}"


@dataclass(frozen=True)
class LeftOut:
    """Something that was not measured, and why, in a line.

    Attributes:
        where: scene, and window where only one is at fault.
        why: one line.
        count: windows lost, as far as can be told; a scene whose index cannot be read counts as one.
    """

    where: str
    why: str
    count: int = 1

    def __str__(self) -> str:
        return f"left out {self.where}: {self.why}"


@dataclass(frozen=True, eq=False)
class PhotoViews:
    """Views of one size.

    Attributes:
        images: (V, H, W, 3) float32 in [0, 1]; of what is drawn, NaN where a mask leaves pixels out.
        cameras: one per view.
    """

    images: NDArray
    cameras: tuple[Camera, ...]


@dataclass(frozen=True, eq=False)
class Shots:
    """A window's photos at one size, and its depth range; `scene` where its context is a scene folder's."""

    context: PhotoViews
    targets: PhotoViews
    near: float
    far: float
    scene: Scene | None = None


class Source(Protocol):
    """A scene with windows. Sources are small and picklable: worker processes read photos themselves."""

    @property
    def name(self) -> str:
        """The scene's name in results."""

    @property
    def needs_network(self) -> bool:
        """Whether a model turns its photos into Gaussians."""

    def windows(self) -> tuple[list[Window], list[LeftOut]]:
        """Windows that can be tried, and those whose entry is at fault; InputError if there is no index to read."""

    def shots(self, window: Window, size: tuple[int, int]) -> Shots:
        """Photos at (height, width); InputError names what is at fault, and Gaussian files, which have none."""

    def case(self, window: Window, model: str, size: tuple[int, int], runtime: Runtime) -> Case:
        """Bring a window to Gaussians; TinySplatError names what is at fault."""

    def fingerprint(self, window: Window) -> str:
        """Changes when what the window's figures depend on, apart from model and code, changes."""


class PhotoSource(Source, Protocol):
    """What sources with photos have in common."""

    needs_network: bool = True

    def case(self, window: Window, model: str, size: tuple[int, int], runtime: Runtime) -> Case:
        """See `Source`."""
        return predicted(f"{self.name} {window}", model, self.shots(window, size), runtime)


@dataclass(frozen=True)
class WindowJob:
    """A window and a model."""

    source: Source
    window: Window
    model: str
    size: tuple[int, int]

    def __str__(self) -> str:
        return f"{self.source.name} {self.window}, {self.model}"

    def case(self, runtime: Runtime) -> Case:
        """The window brought to Gaussians; TinySplatError names what is at fault."""
        return self.source.case(self.window, self.model, self.size, runtime)

    def stamp(self, *options: object) -> str:
        """Changes when anything that the window's figures depend on does: photos, network, code, libraries, options."""
        model = model_fingerprint(self.model) if self.source.needs_network else ""
        try:
            source = self.source.fingerprint(self.window)
        except (TinySplatError, OSError):
            source = ""  # the fault of the window, which will say so when it is measured
        return digest(source, model, self.size, code_fingerprint(), *options)


@dataclass(frozen=True, eq=False)
class Case:
    """A window brought to Gaussians.

    Attributes:
        name: for reports.
        model: the network, or a Gaussian file's name.
        gaussians: per pixel, with cameras.
        cameras: where pictures are taken.
        photos: (H, W, 3) float32 per camera, or None where there is none.
        shots: what the Gaussians were predicted from, or None.
        seconds: of the stage `network`.
    """

    name: str
    model: str
    gaussians: Gaussians
    cameras: tuple[Camera, ...]
    photos: tuple[NDArray | None, ...]
    shots: Shots | None = None
    seconds: dict[str, float] = field(default_factory=dict)

    @classmethod
    def without_photos(cls, name: str, gaussians: Gaussians, cameras: Sequence[Camera]) -> Case:
        """Gaussians that no network made here, and where pictures of them are taken."""
        return cls(name, name, gaussians, tuple(cameras), (None,) * len(cameras))


def predicted(name: str, model: str, shots: Shots, runtime: Runtime) -> Case:
    """What a network makes of a window's photos, held against its targets."""
    watch = Stopwatch()
    graph = runtime.store.network(model)
    with watch.stage("network"):
        gaussians = predict(shots.context.images, shots.context.cameras, shots.near, shots.far, graph)
        if shots.scene is not None:
            gaussians = hidden(gaussians, shots.scene)
    targets = shots.targets
    return Case(name, model, gaussians, targets.cameras, tuple(targets.images), shots, watch.seconds)


def nearest_views(camera: Camera, among: Sequence[Camera], count: int) -> list[int]:
    """The views whose centres are nearest to a camera's, in the order in which they are given."""
    distances = [float(np.linalg.norm(other.centre - camera.centre)) for other in among]
    return sorted(np.argsort(distances, kind="stable")[:count].tolist())


def covered_pixels(target: Camera, context: Sequence[Camera], near: float, far: float) -> NDArray:
    """Pixels whose ray runs inside the context views' frames: (H, W) bool.

    A place counts where any context view has it before its camera and within its picture, occluded or not. With
    targets between the contexts this leaves out the margins that no photo shows, whatever stands there.

    Args:
        target: the view looked at.
        context: the views that a network gets.
        near, far: z of the nearest and the farthest surface, scene units, 0 < near < far.
    """
    row, column = np.mgrid[: target.height, : target.width] + 0.5
    pixels = np.stack([column, row, np.ones_like(row)], axis=-1)
    rays = pixels @ np.linalg.inv(target.K).T @ target.c2w[:3, :3].T  # world, unit z in the target's frame
    inside = np.zeros((target.height, target.width))
    for inverse_depth in np.linspace(1 / far, 1 / near, DEPTHS):
        points = target.c2w[:3, 3] + rays / inverse_depth
        inside += np.any([_in_frame(points, camera) for camera in context], axis=0)
    return inside >= SHARE * DEPTHS


def _in_frame(points: NDArray, camera: Camera) -> NDArray:
    """Where world points (H, W, 3) appear in a camera's picture: (H, W) bool."""
    shown = (points - camera.c2w[:3, 3]) @ camera.c2w[:3, :3] @ camera.K.T
    z = shown[..., 2]
    x, y = (shown[..., i] / np.where(z > 0, z, 1) for i in (0, 1))
    return (z > 0) & (x >= 0) & (x <= camera.width) & (y >= 0) & (y <= camera.height)
