"""A capture's photos: every fourth is left out, to be drawn from others."""

from __future__ import annotations

from dataclasses import dataclass, replace

from tinysplat_runtime.recipe.prepare import prepared
from tinysplat_runtime.recipe.request import EncodeRequest
from tinysplat_runtime.recipe.words import ALL
from tinysplat_runtime.scene.scenes import Scene
from tinysplat_runtime.system.evenly import evenly

TARGETS = 8
"""Photos drawn at most."""


@dataclass(frozen=True)
class Capture:
    """Photos left out, and the others."""

    targets: Scene
    others: Scene

    @classmethod
    def of(cls, scene: Scene) -> Capture:
        """Of the photos left out those that are drawn, from the first on."""
        left_out = range(2, len(scene.frames), 4)
        others = scene.views(i for i in range(len(scene.frames)) if i not in left_out)
        return cls(scene.views(left_out[:: max(1, len(left_out) // TARGETS)][:TARGETS]), others)

    def resized(self, given: tuple[int, int], drawn: tuple[int, int]) -> Capture:
        """With photos of these sizes (height, width): those given, and those that pictures are held against."""
        return Capture(self.targets.resized(*drawn), self.others.resized(*given))

    def given(self, count: int) -> Scene:
        """So many of the others, spread over the capture; all where there are no more."""
        return self.others.views(evenly(len(self.others.frames), count))


def found_for(scene: Scene) -> Scene:
    """A scene between the depths that `encode` finds where its layout states none, as those of most tools do."""
    return prepared(EncodeRequest(replace(scene, near=None, far=None), views=ALL, size="full"))
