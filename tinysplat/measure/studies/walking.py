"""What is a whole capture worth? Every fourth photo is left out and drawn from the others: a few of them, or many.

Ways: `walk`, so many of the others spread over the capture in one scene, near and far as found from them; `walk, range
stated`, the same between the depths that the layout states; `refined walk`, the same corrected by these
photos in as many steps as are usual, where numba is installed; `six spread`, six of 24 of them; `own pair`,
for every picture a scene of the two taken nearest to it; `nearest photo`, that one itself, shown in its place. A walk
is coded, and its pictures are drawn from the file too. Of 24 photos a path is drawn through their cameras: flicker is
the largest change between frames, in medians of the changes about it.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec

import numpy as np

from tinysplat_runtime.errors import TinySplatError
from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.recipe.prepare import prepared
from tinysplat_runtime.recipe.request import EncodeRequest
from tinysplat_runtime.recipe.words import ALL
from tinysplat_runtime.render import Renderer, between
from tinysplat_runtime.render.near import FEW
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.intake.layouts import load_scene
from tinysplat_runtime.scene.neighbours import view_places
from tinysplat_runtime.scene.scenes import Scene

from ..metrics import psnr
from ..rows import Row
from ..show.tables import Cell, Listing, decibels, digits, kilobytes, mean
from ..study import Run, Study
from ..subjects.sources import FolderSource

STUDY = "walk"
REFINED, STATED = "refined walk", "walk, range stated"
COUNTS, QUICK_COUNTS = (12, 24, 48), (8,)
COMPARED = 24
"""Photos of which the other ways take their own."""

TARGETS = 8
PATH_FRAMES_A_VIEW, ABOUT = 6, 4
"""Of the path for flicker: frames from photo to photo, and changes on either side that one is held against."""


@dataclass(frozen=True)
class Capture:
    """A scene's photos: some to draw, the others to draw them from."""

    scene: Scene
    targets: tuple[int, ...]
    others: tuple[int, ...]

    @classmethod
    def of(cls, scene: Scene) -> Capture:
        """Every fourth photo is left out, and so many of those drawn, from the first on."""
        left_out = range(2, len(scene.frames), 4)
        others = tuple(i for i in range(len(scene.frames)) if i not in left_out)
        return cls(scene, tuple(left_out[:: max(1, len(left_out) // TARGETS)][:TARGETS]), others)

    def given(self, count: int) -> Scene:
        """So many of the other photos, spread over the capture; all where there are no more."""
        spread = np.rint(np.linspace(0, len(self.others) - 1, min(count, len(self.others)))).astype(int)
        return self.scene.views(self.others[i] for i in spread)

    def psnr(self, pictures: Sequence[np.ndarray]) -> list[float]:
        """dB of pictures to the photos left out."""
        photos = (self.scene.frames[i].image() for i in self.targets)
        return [psnr(picture, photo) for picture, photo in zip(pictures, photos, strict=True)]

    @property
    def cameras(self) -> list[Camera]:
        """Of the photos left out."""
        return [self.scene.cameras[i] for i in self.targets]


def walk_rows(run: Run) -> Iterator[Row]:
    """Every way of every scene folder."""
    for source in run.sources:
        if not isinstance(source, FolderSource):
            continue
        try:
            capture = Capture.of(load_scene(source.path, near=source.near, far=source.far).resized(*run.size))
            yield from _scene_rows(source.name, capture, run)
        except TinySplatError as error:
            run.left_out.append(f"left out {source.name}: {error}")


def _scene_rows(name: str, capture: Capture, run: Run) -> Iterator[Row]:
    runtime, model = run.runtime, run.models[0]

    def row(way: str, photos: int, asked: str, psnr: Sequence[float]) -> Row:
        figures = {"psnr": statistics.fmean(psnr), "worst": min(psnr)}
        return Row(STUDY, name, way, {"photos": photos, "asked": asked, "model": model}, figures)

    def drawn(gaussians: Gaussians) -> list[float]:
        return capture.psnr(list(map(Renderer(gaussians, run.threads).render, capture.cameras)))

    def walked(way: str, photos: int, asked: str, gaussians: Gaussians) -> tuple[Row, Gaussians]:
        """A way with its file."""
        data = runtime.compress(gaussians, drop_invalid=True)
        coded = drawn(runtime.decompress(data))
        more = {"bytes": len(data), "coded": statistics.fmean(coded), "coded_worst": min(coded)}
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
        if count == COMPARED and capture.scene.near and capture.scene.far:
            ways.append(walked(STATED, photos, asked, runtime.predict(capture.given(count), model)))
        for known_row, gaussians in ways:
            swing = {"flicker": flicker(gaussians, run.threads)} if count == COMPARED or run.quick else {}
            yield replace(
                known_row, setting={**known_row.setting, "asked": asked}, figures={**known_row.figures, **swing}
            )
    given, compared = found_for(capture.given(COMPARED)), str(COMPARED)
    six = Capture(given, (), tuple(range(len(given.frames)))).given(6)
    yield row("six spread", 6, compared, drawn(runtime.predict(six, model)))
    nearest = [_nearest(given, camera, 2) for camera in capture.cameras]
    pairs = [
        Renderer(runtime.predict(given.views(pair), model), run.threads).render(camera)
        for pair, camera in zip(nearest, capture.cameras, strict=True)
    ]
    yield row("own pair", 2, compared, capture.psnr(pairs))
    yield row("nearest photo", 1, compared, capture.psnr([given.frames[pair[0]].image() for pair in nearest]))


def found_for(scene: Scene) -> Scene:
    """A scene between the depths that `encode` finds where its layout states none, as those of most tools do."""
    return prepared(EncodeRequest.of(replace(scene, near=None, far=None), views=ALL, size="full"), str)


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
    return f"{row.way}, {row.setting['asked']}" if row.way in (STUDY, REFINED, STATED) else row.way


def _photos(rows: Sequence[Row]) -> str:
    """How many were given: one number, or from how few to how many."""
    counts = sorted({row.setting["photos"] for row in rows})
    return str(counts[0]) if len(counts) == 1 else f"{counts[0]}–{counts[-1]}"


def _of_file(name: str, instead: str) -> Cell:
    """dB of pictures from the file; of ways without one, of the way itself."""
    return lambda rows: mean(name if name in rows[0].figures else instead, decibels)(rows)


_IN_SHORT = {REFINED: "as `encode` does it", STUDY: "with `--no-refine`", "nearest photo": "the nearest photo"}
"""Ways that README shows, of as many photos as the others are compared with."""

_COLUMNS = {
    "": _named,
    "photos": _photos,
    "dB at photos left out": mean("psnr", decibels),
    "worst picture": mean("worst", decibels),
    "from the file": mean("coded", decibels),
    "KB": mean("bytes", kilobytes),
    "flicker": mean("flicker", digits(1)),
}

WALK = Study(
    "Captures",
    walk_rows,
    {
        f"{STUDY} summary": Listing(STUDY, _COLUMNS, by=("way", "asked")),
        f"{STUDY} in short": Listing(
            STUDY,
            {
                "": lambda rows: _IN_SHORT[rows[0].way],
                "dB at photos left out": _of_file("coded", "psnr"),
                "worst picture": _of_file("coded_worst", "worst"),
                "KB": _COLUMNS["KB"],
            },
            by=("way",),
            wanted=lambda row: row.way in _IN_SHORT and row.setting["asked"] == str(COMPARED),
        ),
    },
)
