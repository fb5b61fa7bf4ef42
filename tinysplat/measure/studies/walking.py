"""What is a whole capture worth? Every fourth photo is left out and drawn from the others: a few of them, or many.

Ways: `walk`, so many of the others spread over the capture in one scene, near and far as found from them; `walk, range
stated`, the same between the depths that the layout states; `refined walk`, the same corrected by these
photos in as many steps as are usual, where numba is installed; `six spread`, six of 24 of them; `own pair`,
for every picture a scene of the two taken nearest to it; `nearest photo`, that one itself, shown in its place. A walk
is coded, and its pictures are drawn from the file too. With `--drawn`, pictures are drawn and judged at another size
than photos are given at: that of a screen, for instance. Of 24 photos a path is drawn through their cameras: flicker is
the largest change between frames, in medians of the changes about it.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.render import Renderer, between
from tinysplat_runtime.render.near import FEW
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.neighbours import view_places
from tinysplat_runtime.scene.scenes import Scene

from ..metrics import METRICS
from ..pictures import rescaled
from ..rows import Row
from ..show.tables import Cell, Listing, decibels, digits, kilobytes, mean, said
from ..study import Run, Study
from ..subjects.captures import Capture, found_for, spread

STUDY = "walk"
REFINED, STATED = "refined walk", "walk, range stated"
COUNTS, QUICK_COUNTS = (12, 24, 48), (8,)
COMPARED = 24
"""Photos of which the other ways take their own."""

PATH_FRAMES_A_VIEW, ABOUT = 6, 4
"""Of the path for flicker: frames from photo to photo, and changes on either side that one is held against."""


def walk_rows(run: Run) -> Iterator[Row]:
    """Every way of every scene folder."""
    return run.of_scenes(lambda name, scene: _scene_rows(name, Capture.of(scene).resized(run.size, drawn_at(run)), run))


def drawn_at(run: Run) -> tuple[int, int]:
    """(height, width) that pictures are judged at."""
    return run.options.drawn or run.size


def _scene_rows(name: str, capture: Capture, run: Run) -> Iterator[Row]:
    cameras = capture.targets.cameras
    runtime, model = run.runtime, run.models[0]

    size = {"drawn": "{1}×{0}".format(*run.options.drawn)} if run.options.drawn else {}

    def row(way: str, photos: int, asked: str, figures: dict[str, float]) -> Row:
        return Row(STUDY, name, way, {"photos": photos, "asked": asked, "model": model, **size}, figures)

    def to_photos(pictures: Iterable[NDArray]) -> dict[str, float]:
        """Means of what pictures are judged by, and the worst picture's dB."""
        pairs = zip(pictures, capture.targets.frames, strict=True)
        scores = [
            {name: metric(picture, frame.image()) for name, metric in METRICS.items()} for picture, frame in pairs
        ]
        means = {name: statistics.fmean(score[name] for score in scores) for name in METRICS}
        return {**means, "worst": min(score["psnr"] for score in scores)}

    def drawn(gaussians: Gaussians) -> dict[str, float]:
        return to_photos(map(Renderer(gaussians, run.threads).render, cameras))

    def walked(way: str, photos: int, asked: str, gaussians: Gaussians) -> tuple[Row, Gaussians]:
        """A way with its file."""
        data = runtime.compress(gaussians, drop_invalid=True)
        coded = drawn(runtime.decompress(data))
        more = {"bytes": len(data), **{_coded(figure): value for figure, value in coded.items()}}
        known_row = row(way, photos, asked, drawn(gaussians))
        return replace(known_row, figures={**known_row.figures, **more}), gaussians

    known: dict[int, list[tuple[Row, Gaussians]]] = {}  # of small captures several counts are all photos
    for count in run.options.views or (QUICK_COUNTS if run.quick else COUNTS):
        given, asked = found_for(capture.given(count)), str(count)
        photos = len(given.frames)
        if photos not in known:
            gaussians = runtime.predict(given, model)
            known[photos] = [walked(STUDY, photos, asked, gaussians)]
            if photos > FEW and find_spec("numba") is not None:
                known[photos].append(walked(REFINED, photos, asked, runtime.refine(gaussians, given)))
        ways = list(known[photos])
        if count == COMPARED and capture.others.near and capture.others.far:
            ways.append(walked(STATED, photos, asked, runtime.predict(capture.given(count), model)))
        for known_row, gaussians in ways:
            swing = {"flicker": flicker(gaussians, run.threads)} if count == COMPARED or run.quick else {}
            yield replace(
                known_row, setting={**known_row.setting, "asked": asked}, figures={**known_row.figures, **swing}
            )
    given, compared = found_for(capture.given(COMPARED)), str(COMPARED)
    yield row("six spread", 6, compared, drawn(runtime.predict(spread(given, 6), model)))
    nearest = [_nearest(given, camera, 2) for camera in cameras]
    pairs = [
        Renderer(runtime.predict(given.views(pair), model), run.threads).render(camera)
        for pair, camera in zip(nearest, cameras, strict=True)
    ]
    yield row("own pair", 2, compared, to_photos(pairs))
    shown = [rescaled(given.frames[pair[0]].image(), *drawn_at(run)) for pair in nearest]
    yield row("nearest photo", 1, compared, to_photos(shown))


def _nearest(scene: Scene, camera: Camera, count: int) -> list[int]:
    """Photos taken nearest to a camera, by places and directions."""
    *places, own = view_places([*scene.cameras, camera], *scene.depth_range())
    distance = np.linalg.norm(np.stack(places) - own, axis=1)
    return [int(i) for i in np.argsort(distance, kind="stable")[:count]]


def flicker(gaussians: Gaussians, threads: int) -> float:
    """The largest change between frames on the way through all cameras, in medians of the changes about it."""
    draw, cameras = Renderer(gaussians, threads).render, gaussians.cameras
    changes, before = [], None
    for camera in between(cameras, PATH_FRAMES_A_VIEW * (len(cameras) - 1) + 1):
        frame = draw(camera)
        if before is not None:
            changes.append(float(np.sqrt(np.mean(np.square(frame - before)))))
        before = frame
    about = (changes[max(i - ABOUT, 0) : i + ABOUT + 1] for i in range(len(changes)))
    return max(change / max(statistics.median(near), 1e-6) for change, near in zip(changes, about, strict=True))


def _named(rows: Sequence[Row]) -> str:
    """The way, and of a walk how many photos were asked for."""
    row = rows[0]
    name = f"{row.way}, {row.setting['asked']}" if row.way in (STUDY, REFINED, STATED) else row.way
    return f"{name}, drawn at {row.setting['drawn']}" if "drawn" in row.setting else name


def _photos(rows: Sequence[Row]) -> str:
    """How many were given: one number, or from how few to how many."""
    counts = sorted({row.setting["photos"] for row in rows})
    return str(counts[0]) if len(counts) == 1 else f"{counts[0]}–{counts[-1]}"


def _of_file(name: str, write: Callable[[Any], str]) -> Cell:
    """A figure of pictures from the file; of ways without one, of the way itself."""
    return lambda rows: mean(_coded(name) if "coded" in rows[0].figures else name, write)(rows)


def _coded(name: str) -> str:
    """What a figure of pictures is called where they are drawn from the file."""
    return "coded" if name == "psnr" else f"coded_{name}"


_IN_SHORT = {REFINED: "as `encode` does it", STUDY: "with `--no-refine`", "nearest photo": "the nearest photo"}
"""Ways that README shows, of as many photos as the others are compared with."""

_JUDGED = {
    "SSIM": _of_file("ssim", digits(3)),
    "FLIP": _of_file("flip", digits(3)),
    "sharpness": _of_file("sharpness", digits(2)),
    "KB": mean("bytes", kilobytes),
}

_COLUMNS = {
    "": _named,
    "photos": _photos,
    "dB at photos left out": mean("psnr", decibels),
    "worst picture": mean("worst", decibels),
    "from the file": mean("coded", decibels),
    "worst": mean("coded_worst", decibels),
    **_JUDGED,
    "flicker": mean("flicker", digits(1)),
}

WALK = Study(
    "Captures",
    walk_rows,
    {
        f"{STUDY} summary": Listing(STUDY, _COLUMNS, by=("way", "asked", "drawn")),
        f"{STUDY} scenes": Listing(
            STUDY, {"scene": said("subject"), **_COLUMNS}, wanted=lambda row: row.way in (STUDY, REFINED)
        ),
        f"{STUDY} in short": Listing(
            STUDY,
            {
                "": lambda rows: _IN_SHORT[rows[0].way],
                "dB at photos left out": _of_file("psnr", decibels),
                "worst picture": _of_file("worst", decibels),
                **_JUDGED,
            },
            by=("way",),
            wanted=lambda row: row.way in _IN_SHORT and row.setting["asked"] == str(COMPARED),
        ),
    },
)
