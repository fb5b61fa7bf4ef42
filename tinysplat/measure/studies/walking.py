"""What is a whole capture worth, and each step that it takes? Every fourth photo is left out and drawn from the others.

Ways: `network alone`, so many of the others spread over the capture in one scene, near and far as found from them;
`walk`, the same once all photos agree on depth, as `encode --fast` codes it; of 24 photos `list`, as `encode` makes it;
the latter two where numba is installed. `own pair` is, for every picture, a scene of the two photos taken nearest to
it, and `nearest photo` that one itself, shown in its place. A walk is coded, and its pictures are drawn from the file
too. With `--drawn`, pictures are drawn and judged at another size than photos are given at: that of a screen, for
instance. Of 24 photos a path is drawn through their cameras: flicker is the largest change between frames, in medians
of the changes about it.

`walk steps` says of each step the processor seconds that it takes.
"""

import statistics
from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib.util import find_spec

import numpy as np

from tinysplat_runtime.gaussian.gaussians import Gaussians
from tinysplat_runtime.list.training import FEW_PHOTOS
from tinysplat_runtime.recipe.kinds import LIST, LIST_QP, TRAIN
from tinysplat_runtime.recipe.request import EncodeRequest
from tinysplat_runtime.recipe.steps import Run as Recipe
from tinysplat_runtime.render import Renderer, between
from tinysplat_runtime.scene.neighbours import nearest_views
from tinysplat_runtime.scene.scenes import Scene

from ..clock import cpu_of
from ..pictures import as_photos, to_photos
from ..rows import TRAINER, Row
from ..show.tables import Cell, Listing, Write, decibels, digits, kilobytes, mean, said
from ..study import Run, Study
from ..subjects.captures import Capture, found_for

STUDY = "walk"
ALONE, LISTED = "network alone", "list"
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
    runtime, model = run.runtime, run.model
    size = {"drawn": "{1}×{0}".format(*run.options.drawn)} if run.options.drawn else {}

    def row(way: str, photos: int, asked: int, figures: dict[str, float]) -> Row:
        return Row(STUDY, name, way, {"photos": photos, "asked": str(asked), "model": model, **size}, figures)

    def drawn(gaussians: Gaussians) -> tuple[dict[str, float], float]:
        """What the pictures are like, and the CPU seconds of one."""
        pictures, cpu = cpu_of(lambda: as_photos(gaussians, cameras, run.threads))
        return to_photos(pictures, capture.targets), cpu / len(cameras)

    def coded(known: Row, gaussians: Gaussians) -> Row:
        """A way with what its file is like; training has left out what a list does without."""
        is_list = known.way == LISTED
        qp = LIST_QP if is_list else None
        data, coding = cpu_of(lambda: runtime.compress(gaussians, qp=qp, drop_invalid=True, keep_all=is_list))
        decoded, decoding = cpu_of(lambda: runtime.decompress(data))
        pictures, drawing = drawn(decoded)
        figures = {**known.figures, "bytes": len(data), **{_coded(name): value for name, value in pictures.items()}}
        costs = {**known.costs, "coding": coding, "decoding": decoding, "drawing": drawing}
        return replace(known, figures=figures, costs=costs)

    def walked(given: Scene, asked: int) -> Iterator[Row]:
        """Rows of the network's Gaussians and of every step after it."""
        is_compared, photos = asked == COMPARED or run.quick, len(given.frames)
        has_steps = photos > FEW_PHOTOS and find_spec("numba") is not None
        gaussians, cpu = cpu_of(lambda: runtime.predict(given, model))
        steps = [(STUDY, gaussians, cpu)]
        if has_steps and is_compared:
            steps.insert(0, (ALONE, *cpu_of(lambda: runtime.predict(given, model, joint=False))))
            start = Recipe(EncodeRequest(given), LIST, runtime, given, given, gaussians=gaussians)
            listed, more = cpu_of(lambda: TRAIN.take(start).made)
            steps.insert(0, (LISTED, listed, cpu + more))
        for way, gaussians, cpu in steps:
            known = replace(row(way, photos, asked, drawn(gaussians)[0]), costs={"cpu": cpu})
            done = coded(known, gaussians)
            swing = {"flicker": flicker(gaussians, run.threads)} if is_compared and way not in (ALONE, LISTED) else {}
            yield replace(done, figures={**done.figures, **swing})

    rows: dict[int, list[Row]] = {}  # of small captures several counts are all photos
    for asked in run.options.views or (QUICK_COUNTS if run.quick else COUNTS):
        given = found_for(capture.given(asked))
        if asked == COMPARED or len(given.frames) not in rows:
            rows[len(given.frames)] = list(walked(given, asked))
        for known in rows[len(given.frames)]:
            yield replace(known, setting={**known.setting, "asked": str(asked)})
    given = found_for(capture.given(COMPARED))
    near, far = given.depth_range()
    nearest = [nearest_views(given.cameras, camera, 2 / (1 / near + 1 / far), 2) for camera in cameras]
    pairs = [
        Renderer(runtime.predict(given.views(pair), model), run.threads).render(camera)
        for pair, camera in zip(nearest, cameras, strict=True)
    ]
    yield row("own pair", 2, COMPARED, to_photos(pairs, capture.targets))
    shown = (given.views(pair[:1]).resized(*drawn_at(run)).frames[0].image() for pair in nearest)
    yield row("nearest photo", 1, COMPARED, to_photos(shown, capture.targets))


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
    name = f"{row.way}, {row.setting['asked']}" if row.way.startswith((ALONE, STUDY, LISTED)) else row.way
    return f"{name}, drawn at {row.setting['drawn']}" if "drawn" in row.setting else name


def _photos(rows: Sequence[Row]) -> str:
    """How many were given: one number, or from how few to how many."""
    counts = sorted({row.setting["photos"] for row in rows})
    return str(counts[0]) if len(counts) == 1 else f"{counts[0]}–{counts[-1]}"


def _of_file(name: str, write: Write) -> Cell:
    """A figure of pictures from the file; of ways without one, of the way itself."""
    return lambda rows: mean(_coded(name) if "coded" in rows[0].figures else name, write)(rows)


def _coded(name: str) -> str:
    """What a figure of pictures is called where they are drawn from the file."""
    return "coded" if name == "psnr" else f"coded_{name}"


_IN_SHORT = {LISTED: "as `encode` does it", STUDY: "with `--fast`", "nearest photo": "the nearest photo"}
"""Ways of our own that README shows, of as many photos as the others are compared with."""

_SHOWN = (ALONE, *_IN_SHORT, "own pair", TRAINER)
"""Ways that tables show; files of other qualities, and ways that are gone, have rows too."""

_JUDGED = {
    "SSIM": _of_file("ssim", digits(3)),
    "FLIP": _of_file("flip", digits(3)),
    "sharpness": _of_file("sharpness", digits(2)),
    "KB": mean("bytes", kilobytes),
}


def _short(rows: Sequence[Row]) -> str:
    """What README calls a way; a trainer's also says how long it trained."""
    row = rows[0]
    return f"{TRAINER}, {row.setting['steps']:,} steps" if row.way == TRAINER else _IN_SHORT[row.way]


_COLUMNS = {
    "photos": _photos,
    "dB at photos left out": _of_file("psnr", decibels),
    "worst": _of_file("worst", decibels),
    "fitted": _of_file("fitted", decibels),
    "worst fitted": _of_file("fitted_worst", decibels),
    **_JUDGED,
}

_STEPS = {ALONE: "the network", STUDY: "and photos agree on depth", LISTED: "and one list of it, trained"}


WALK = Study(
    "Captures",
    walk_rows,
    {
        f"{STUDY} summary": Listing(
            STUDY,
            {"": _named, **_COLUMNS, "flicker": mean("flicker", digits(1))},
            by=("way", "asked", "drawn"),
            wanted=lambda row: row.way in _SHOWN,
        ),
        f"{STUDY} steps": Listing(
            STUDY,
            {
                "": lambda rows: _STEPS[rows[0].way],
                "CPU s": mean("cpu", digits(1), "costs"),
                "coding": mean("coding", digits(1), "costs"),
                "decoding": mean("decoding", digits(2), "costs"),
                "a picture": mean("drawing", digits(2), "costs"),
                "dB at photos left out": _of_file("psnr", decibels),
                "worst": _of_file("worst", decibels),
                "SSIM": _of_file("ssim", digits(3)),
                "KB": mean("bytes", kilobytes),
            },
            by=("way",),
            wanted=lambda row: row.way in _STEPS and row.setting["asked"] == str(COMPARED),
        ),
        f"{STUDY} scenes": Listing(
            STUDY,
            {"scene": said("subject"), **_COLUMNS, "CPU s": mean("cpu", digits(0), "costs")},
            wanted=lambda row: row.way in (ALONE, STUDY, LISTED, TRAINER),
        ),
        f"{STUDY} in short": Listing(
            STUDY,
            {
                "": _short,
                **{head: cell for head, cell in _COLUMNS.items() if head != "photos"},
                "CPU s": mean("cpu", digits(0), "costs"),
            },
            by=("way", "steps"),
            wanted=lambda row: row.way in (*_IN_SHORT, TRAINER) and row.setting["asked"] == str(COMPARED),
        ),
    },
)
