"""Are depths where photos agree that they are? Corners that three photos or more of a capture show alike, held against
the depth that the network gives at their pixels; no photo needs to be left out.

The way `network` is what `encode --fast` codes.
"""

from collections.abc import Iterator

import numpy as np

from tinysplat_runtime.scene.scenes import Scene
from tinysplat_runtime.system.evenly import evenly

from ..rows import Row
from ..show.tables import Listing, mean, said
from ..study import Run, Study
from ..subjects.captures import found_for
from ..subjects.corners import agreed_corners, corner_errors

STUDY = "corners"
COUNTS, QUICK_COUNTS = (24,), (8,)

LANDS = 2 / 256
"""How far beside its place a corner may land in another photo, as a share of the photo's shorter side."""


def corner_rows(run: Run) -> Iterator[Row]:
    """A row per scene, number of photos and way."""
    return run.of_scenes(lambda name, scene: _scene_rows(name, scene.resized(*run.size), run))


def _scene_rows(name: str, scene: Scene, run: Run) -> Iterator[Row]:
    for count in run.options.views or (QUICK_COUNTS if run.quick else COUNTS):
        given = found_for(scene.views(evenly(len(scene.frames), count)))
        agreed = agreed_corners(given)
        errors, off = corner_errors(agreed, run.runtime.predict(given, run.model))
        setting = {"photos": len(given.frames), "model": run.model}
        figures: dict[str, float] = {"corners": len(errors)}
        if len(errors):
            figures |= {"depth": float(np.median(errors)), "off": float(np.mean(off > LANDS * min(run.size)))}
        yield Row(STUDY, name, "network", setting, figures)


_FIGURES = {
    "corners": mean("corners", "{:,.0f}".format),
    "error of depth, median": mean("depth", "{:.2%}".format),
    "lands over 2 px off, of 256": mean("off", "{:.1%}".format),
}

CORNERS = Study(
    "Corners that photos agree on",
    corner_rows,
    {
        STUDY: Listing(STUDY, {"scene": said("subject"), "": said("way"), "photos": said("photos"), **_FIGURES}),
        f"{STUDY} summary": Listing(STUDY, {"": said("way"), **_FIGURES}, by=("way", "photos")),
    },
)
