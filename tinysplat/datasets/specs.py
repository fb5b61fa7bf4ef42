"""What the official evaluations fix for each data set; docs/MEASURING.md has the sources."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DatasetSpec:
    """One data set as the official evaluations use it.

    Attributes:
        name: what commands call it.
        size: (height, width) that frames are prepared at unless asked otherwise.
        near, far: depth range that the released networks were run with unless asked otherwise, scene units.
        frame_shapes: (height, width) of stored frames; scenes with others are not evaluated.
        max_fov_degrees: scenes with a wider horizontal or vertical field of view are not evaluated.
    """

    name: str
    size: tuple[int, int]
    near: float
    far: float
    frame_shapes: tuple[tuple[int, int], ...]
    max_fov_degrees: float = 100.0


SPECS = {
    spec.name: spec
    for spec in (
        # near and far are MVSplat's; DepthSplat's networks were run with 0.5 and 100.
        DatasetSpec("re10k", (256, 256), 1.0, 100.0, ((360, 640),)),
        DatasetSpec("acid", (256, 256), 1.0, 100.0, ((360, 640),)),
        # Stored as `images_4` (540 × 960) or `images_8` (270 × 480).
        DatasetSpec("dl3dv", (256, 448), 0.5, 200.0, ((540, 960), (270, 480))),
    )
}
