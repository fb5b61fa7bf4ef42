"""Tiny synthetic scenes that tests share: cameras in a row, Gaussians in front of them, photos on disk; and what tests
ask of results: decibels, refusals in one line, fast paths that agree with plain ones.

    from scenes import make_cameras, make_gaussians, write_scene

Everything is a function of its arguments: the same call gives the same arrays.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tinysplat_runtime.codec.job import EncodeStats, Job
from tinysplat_runtime.codec.profiles import find_profile
from tinysplat_runtime.errors import InputError
from tinysplat_runtime.gaussian.gaussians import FIELDS, Gaussians
from tinysplat_runtime.gaussian.quaternions import matrices_to_quats, normalize_quats, quats_to_matrices
from tinysplat_runtime.graphs.inference import GraphStore
from tinysplat_runtime.list.coding.encoder import ListEncoder
from tinysplat_runtime.list.coding.levels import Level, Tiers
from tinysplat_runtime.list.coding.rounding import Rounding
from tinysplat_runtime.list.views import views_of
from tinysplat_runtime.render import DEFINITION, between, render
from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.pictures import write_png
from tinysplat_runtime.system.told import Kind, Told

NEAR, FAR = 1.5, 8.0


def camera_at(x: float, y: float = 0.0, turn: float = 0.0) -> Camera:
    """At (x, y, 0), turned by `turn` radians about y; 128×96."""
    c2w = np.eye(4)
    c2w[:3, :3] = [[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]]
    c2w[:2, 3] = x, y
    return Camera([[100, 0, 64], [0, 100, 48], [0, 0, 1]], c2w, 128, 96)


def make_cameras(
    views: int = 2,
    height: int = 8,
    width: int = 12,
    spacing: float = 0.2,
    *,
    turn: float = 0.05,
    focal: float = 1.1,
    shift: tuple[float, float] = (0.3, -0.2),
) -> list[Camera]:
    """Cameras `spacing` apart along x, each turned by `turn` towards the others.

    Their focal length is `focal` widths, and the principal point lies `shift` pixels off the centre.
    """
    cameras = []
    for v in range(views):
        offset = v - (views - 1) / 2
        angle = -turn * offset
        c2w = np.eye(4)
        c2w[:3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
        c2w[0, 3] = spacing * offset
        right, down = shift
        K = [[focal * width, 0, width / 2 + right], [0, focal * width, height / 2 + down], [0, 0, 1]]
        cameras.append(Camera(K, c2w, width=width, height=height))
    return cameras


def make_gaussians(
    views: int = 2, height: int = 8, width: int = 12, degree: int = 1, layers: int = 1, seed: int = 0
) -> Gaussians:
    """Per-pixel Gaussians (V, H, W) on the rays of `make_cameras`, between NEAR and FAR.

    Every further layer has half the rows and columns of the one before (at least 1) and wider Gaussians.
    """
    rng = np.random.default_rng(seed)
    made = []
    for n in range(layers):
        cameras = make_cameras(views, max(height >> n, 1), max(width >> n, 1))
        made.append(_pixel_gaussians(cameras, degree, rng))
    first, *rest = made
    return Gaussians(**{name: getattr(first, name) for name in FIELDS}, cameras=first.cameras, extra_layers=tuple(rest))


def _pixel_gaussians(cameras: Sequence[Camera], degree: int, rng: np.random.Generator) -> Gaussians:
    lead = (len(cameras), cameras[0].height, cameras[0].width)
    depth = rng.uniform(NEAR, FAR, lead)
    y, x = np.mgrid[0 : lead[1], 0 : lead[2]] + 0.5
    pixels = np.stack([x, y, np.ones_like(x)], axis=-1)  # (H, W, 3)
    rays = np.stack([pixels @ np.linalg.inv(c.K).T @ c.c2w[:3, :3].T for c in cameras])  # (V, H, W, 3), z = 1
    centres = np.stack([c.centre for c in cameras])[:, None, None]
    pixel_footprint = (depth / cameras[0].focal)[..., None]
    return Gaussians(
        means=centres + rays * depth[..., None],
        quats=rng.normal(size=(*lead, 4)),
        scales=pixel_footprint * rng.uniform(0.3, 1.5, (*lead, 3)),
        opacities=rng.uniform(0.05, 1, lead),
        sh=rng.normal(scale=0.3, size=(*lead, (degree + 1) ** 2, 3)),
        cameras=tuple(cameras),
    )


def make_skewed_cameras(
    views: int, height: int, width: int, *, seed: int = 0, centre: NDArray | None = None, turn: float = 0.2
) -> list[Camera]:
    """Cameras around `centre`, looking roughly along z, with skew and an off-centre principal point."""
    rng = np.random.default_rng(seed)
    cameras = []
    for _ in range(views):
        f = max(height, width) * rng.uniform(0.8, 1.2)
        K = np.array([[f, 0.01 * f, width * 0.47], [0, f * 1.05, height * 0.52], [0, 0, 1]])
        c2w = np.eye(4)
        c2w[:3, :3] = quats_to_matrices(normalize_quats(np.array([1, *rng.uniform(-turn, turn, 3)])))
        c2w[:3, 3] = rng.uniform(-0.3, 0.3, 3) + (0 if centre is None else centre)
        cameras.append(Camera(K, c2w, width, height))
    return cameras


def make_smooth_gaussians(
    views: int = 2,
    height: int = 24,
    width: int = 32,
    degree: int = 1,
    *,
    seed: int = 0,
    layers: int = 1,
    origin: NDArray | None = None,
) -> Gaussians:
    """Smooth per-pixel Gaussians, as a network might predict: one per pixel of every view, z between 2 and 4."""
    origin = np.zeros(3) if origin is None else np.asarray(origin, np.float64)
    cameras = make_skewed_cameras(views, height, width, seed=seed, centre=origin)
    first = _smooth_pixels(cameras, degree, seed, origin)
    extra = []
    for n in range(1, layers):
        coarse = make_skewed_cameras(views, -(-height // 4) + n, -(-width // 4) + n, seed=seed, centre=origin)
        coarse = [Camera(c.K, full.c2w, c.width, c.height) for c, full in zip(coarse, cameras, strict=True)]
        extra.append(_smooth_pixels(coarse, 0, seed + n, origin))
    return Gaussians(
        first.means, first.quats, first.scales, first.opacities, first.sh, tuple(cameras), origin, tuple(extra)
    )


def _smooth_pixels(cameras: list[Camera], degree: int, seed: int, origin: NDArray) -> Gaussians:
    rng = np.random.default_rng(seed + 1000)
    height, width = cameras[0].height, cameras[0].width
    v, u = np.mgrid[:height, :width] + 0.5
    grid = (len(cameras), height, width)
    means = np.empty((*grid, 3))
    for i, camera in enumerate(cameras):
        z = 3 + np.sin(u / 7 + i) * np.cos(v / 5) + 0.01 * rng.standard_normal((height, width))
        pixels = np.stack([u + rng.uniform(-0.4, 0.4, u.shape), v, np.ones_like(u)], axis=-1)
        rays = pixels @ np.linalg.inv(camera.K).T
        means[i] = (rays * z[..., None]) @ camera.c2w[:3, :3].T + camera.centre - origin
    quats = np.array([1.0, 0.2, -0.1, 0.3]) + 0.2 * rng.standard_normal((*grid, 4))
    quats[rng.random(grid) < 0.3] *= -1
    scales = 0.02 * np.exp(0.3 * rng.standard_normal((*grid, 3)))
    functions = (degree + 1) ** 2
    sh = rng.standard_normal((*grid, functions, 3)) * 0.5 / (1 + np.arange(functions))[:, None]
    return Gaussians(means, quats, scales, rng.uniform(0.1, 1, grid), sh, tuple(cameras), origin)


@st.composite
def photographed(draw: st.DrawFn) -> tuple[Gaussians, Camera, dict[str, str]]:
    """Gaussians of photos, where to look at them from, and how they are drawn.

    From one photo to a capture of which some are not drawn at all; with holes or closed; from points to several pixels
    wide; from afar, at their size or enlarged; from a photo's place, between two, inside the scene or turned away.
    """
    views = draw(st.sampled_from([1, 2, 6, 7, 8, 14]))
    height, width = draw(st.sampled_from([(1, 1), (4, 3), (9, 12)]))
    rng = np.random.default_rng(draw(st.integers(0, 1 << 16)))
    layers, degree = draw(st.sampled_from([1, 2])), draw(st.integers(0, 2))
    made = make_gaussians(views, height, width, degree, layers, int(rng.integers(99)))
    size, opacity = draw(st.sampled_from([1e-5, 1.0, 4.0])), draw(st.sampled_from([0.02, 0.5, 1.0]))
    holes = draw(st.sampled_from([0.0, 0.5, 1.0])) * (draw(st.booleans()) or np.arange(views) < 0.6 * views)
    first, *others = (
        Gaussians(
            **{name: getattr(layer, name) for name in ("means", "quats", "sh", "cameras")},
            scales=size * layer.scales,
            opacities=opacity * layer.opacities * (rng.random(layer.opacities.shape) >= np.reshape(holes, (-1, 1, 1))),
        )
        for layer in made.layers
    )
    camera = made.cameras[draw(st.integers(0, views - 1))] if draw(st.booleans()) else between(made.cameras, 5)[1]
    c2w = camera.c2w.copy()
    c2w[:3, 3] += rng.normal(size=3) * draw(st.sampled_from([0, 0.2, 3]))
    shown = draw(st.sampled_from([(1, 1), (height, width), (18, 25)]))
    drawing = {"dilation": draw(st.sampled_from(["own", "screen"])), "order": draw(st.sampled_from(["near", "depth"]))}
    camera = Camera(camera.K, c2w, width, height).resized(*shown)
    return Gaussians(**{**vars(first), "extra_layers": tuple(others)}), camera, drawing


def make_list(count: int, degree: int, rng: np.random.Generator, size: float = 1.0) -> Gaussians:
    """Gaussians of no pixels: a lumpy shell of radius about `size` whose colours vary smoothly along it."""
    towards = rng.normal(size=(count, 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    means = size * towards * (1 + 0.1 * np.sin(5 * towards).sum(axis=1, keepdims=True))
    functions = (degree + 1) ** 2
    mix = rng.normal(size=(3, functions, 3)) * np.exp(-np.sqrt(np.arange(functions)))[:, None]
    sh = np.einsum("nc,cbk->nbk", np.sin(3 * towards), mix) + 0.05 * rng.normal(size=(count, functions, 3))
    scales = 0.05 * np.exp(rng.normal(0, 0.7, (count, 3)))
    return Gaussians(means, rng.normal(size=(count, 4)), scales, rng.uniform(0.02, 1, count), sh)


def list_in_tiers(gaussians: Gaussians, qp: float = 0.0, growths: tuple[float, ...] = (0.3, 0.1)) -> bytes:
    """A list in three tiers, those of the largest opacities first."""
    levels = (Level(0.1, 0.7, 0.75), Level(0.3, 0.8, 0.8), Level(1, 1.1, 1))
    ranks = np.argsort(np.argsort(-gaussians.opacities, kind="stable"))
    numbers = sum(ranks >= level.share * gaussians.count for level in levels[:2]).astype(np.uint8)
    job = Job(gaussians, find_profile("balanced"), qp, GraphStore(), threads=1, stats=EncodeStats())
    rounding = Rounding.of(gaussians, views_of(gaussians), threads=1)
    return ListEncoder(job, rounding, tiers=Tiers(levels, numbers, growths)).code(qp)


def make_photo(height: int, width: int, seed: int = 0) -> NDArray:
    """(H, W, 3) uint8 with smooth colours and edges."""
    y, x = np.mgrid[0:height, 0:width] / max(height, width)
    phase = np.random.default_rng(seed).uniform(0, 6, 3)
    waves = [np.sin(9 * x + p) + np.cos(7 * y - p) + (x + y > 0.3 * p) for p in phase]
    return (np.stack(waves, axis=-1) * 40 + 100).clip(0, 255).astype(np.uint8)


def scene_document(cameras: Sequence[Camera]) -> dict[str, object]:
    """What `cameras.json` holds for photos named images/0000.png and so on."""
    frames = [
        {"file": f"images/{i:04}.png", "width": c.width, "height": c.height, "K": c.K.tolist(), "c2w": c.c2w.tolist()}
        for i, c in enumerate(cameras)
    ]
    return {"near": NEAR, "far": FAR, "frames": frames}


def transforms_document(cameras: Sequence[Camera]) -> dict[str, object]:
    """A `transforms.json` as nerfstudio writes it; y and z of each camera point up and backward."""
    first, frames = cameras[0], []
    for i, camera in enumerate(cameras):
        matrix = camera.c2w.copy()
        matrix[:, 1:3] *= -1
        frames.append({"file_path": f"images/{i:04}.png", "transform_matrix": matrix.tolist()})
    shared = {"fl_x": first.K[0, 0], "fl_y": first.K[1, 1], "cx": first.K[0, 2], "cy": first.K[1, 2]}
    size = {"w": first.width, "h": first.height}
    return {**shared, **size, "camera_model": "OPENCV", "frames": frames, "near": 1.0, "far": 9.0}


def colmap_texts(cameras: Sequence[Camera], points: NDArray, camera: str | None = None) -> dict[str, str]:
    """A model in COLMAP's text format by file name, in which every photo observes all points (N, 3); `camera` is its
    camera's line without the id.
    """
    K, width, height = cameras[0].K, cameras[0].width, cameras[0].height
    camera = camera or f"PINHOLE {width} {height} {K[0, 0]} {K[1, 1]} {K[0, 2]} {K[1, 2]}"
    lines = []
    for i, view in reversed(list(enumerate(cameras))):
        qw, qx, qy, qz = matrices_to_quats(view.w2c[:3, :3])
        pose = " ".join(f"{value:.17g}" for value in (qw, qx, qy, qz, *view.w2c[:3, 3]))
        seen = " ".join(f"1.0 1.0 {p + 1}" for p in range(len(points)))
        lines.append(f"{i + 1} {pose} 1 {i:04}.png\n{seen}\n")
    tracks = " ".join(f"{i + 1} {{0}}" for i in range(len(cameras)))
    rows = [f"{p + 1} {x} {y} {z} 9 9 9 0.5 {tracks.format(p)}\n" for p, (x, y, z) in enumerate(points)]
    return {"cameras.txt": f"# cameras\n1 {camera}\n", "images.txt": "".join(lines), "points3D.txt": "".join(rows)}


def realestate_line(stamp: int, camera: Camera) -> str:
    """A camera's line of a RealEstate10K file: time in microseconds, fx fy cx cy over the image's size, two unused
    numbers, world to camera row by row.
    """
    K = camera.K_unit
    return " ".join(map(str, [stamp, K[0, 0], K[1, 1], K[0, 2], K[1, 2], 0, 0, *camera.w2c[:3].ravel()]))


def write_scene(folder: Path, views: int = 3, height: int = 24, width: int = 32) -> Path:
    """Write a scene folder of PNG photos and `cameras.json`; returns the folder."""
    cameras = make_cameras(views, height, width)
    (folder / "images").mkdir(parents=True)
    for i in range(views):
        write_png(folder / "images" / f"{i:04}.png", make_photo(height, width, seed=i))
    (folder / "cameras.json").write_text(json.dumps(scene_document(cameras)))
    return folder


def psnr(found: NDArray, wanted: NDArray) -> float:
    """Decibels of pictures whose white is 1."""
    return float(-10 * np.log10(np.mean((found.astype(np.float64) - wanted) ** 2)))


def drawn_psnr(found: Gaussians, wanted: Gaussians) -> float:
    """Decibels of all pictures in the views of `wanted`, drawn as defined."""
    drawn = [[render(g, camera, **DEFINITION) for camera in wanted.cameras] for g in (found, wanted)]
    return psnr(*(np.concatenate([picture.ravel() for picture in pictures]) for pictures in drawn))


def assert_same(found: Gaussians, wanted: Gaussians, views: list[int] | None = None) -> None:
    """The same numbers, cameras, origin and notes in all layers; of some views, where they are given."""
    assert found.notes == wanted.notes
    for one, other in zip(found.layers, wanted.layers, strict=True):
        np.testing.assert_array_equal(one.origin, other.origin)
        for name in FIELDS:
            array = getattr(other, name)
            np.testing.assert_array_equal(getattr(one, name), array if views is None else array[views], err_msg=name)
        cameras = other.cameras if views is None else [other.cameras[view] for view in views]
        for own, its in zip(one.cameras, cameras, strict=True):
            np.testing.assert_array_equal(own.c2w, its.c2w)
            np.testing.assert_array_equal(own.K, its.K)
            assert (own.width, own.height) == (its.width, its.height)


def refused(call: Callable[..., Any], path: Path, *rest: Any, **options: Any) -> str:
    """What a reader says of a file that it must refuse: one short line, which begins with the file's name."""
    with pytest.raises(InputError) as caught:
        call(path, *rest, **options)
    message = str(caught.value)
    assert message.startswith(f"{path}: ") and "\n" not in message and len(message) < 500
    return message


class Heard(Told):
    """Keeps what it is told: kinds and lines, how many items of each step passed, the steps that no other holds, one
    after the other, and those that were planned.
    """

    listens = True

    def __init__(self) -> None:
        self.kinds: list[str] = []
        self.lines: list[str] = []
        self.passed = Counter[str]()
        self.steps: list[str] = []
        self.planned: list[str] = []
        self._within = 0

    def plan(self, stages: Iterable[tuple[str, float]]) -> None:
        self.planned = [label for label, _ in stages]
        self.steps.clear()

    def say(self, kind: Kind, text: str, where: object = "") -> None:
        self.kinds.append(kind)
        self.steps += [text] * (kind == "step" and text not in self.steps[-1:])
        self.lines += [f"{where}: {text}" if where else text] * (kind != "step")

    def progress(self, label: str, items: Iterable[Any], *rest: object, **more: object) -> Iterator[Any]:
        self.steps += [label] * (not self._within and label not in self.steps[-1:])
        self._within += 1
        for item in items:
            self.passed[label] += 1
            yield item
        self._within -= 1


def tells(message: str, words: str) -> bool:
    """Whether a message has what another wording of `words` would have: its numbers, names and quoted values, which are
    all that is no plain word; where there are none of these, the words themselves, so that refusals are told apart.
    """
    parts = re.split(r"[\s,;:()]+", words.replace("\\", ""))
    is_pattern = re.compile(r"[.\])][*+]|[|^]|\$$").search
    told = [part for part in parts if re.search(r"[^a-z.…]", part) and not is_pattern(part)]
    return all(part in message for part in told) if told else bool(re.search(words, message))


@contextmanager
def refusing(kind: type[Exception], words: str) -> Iterator[pytest.ExceptionInfo[Exception]]:
    """What must raise an error of that kind, which `tells` what stands in `words`."""
    with pytest.raises(kind) as caught:
        yield caught
    assert tells(str(caught.value), words), str(caught.value)


def agree(
    fast: Callable[[Any], Any],
    plain: Callable[[Any], Any],
    made: st.SearchStrategy[Any],
    *,
    rtol: float = 0.0,
    atol: float = 0.0,
    examples: int = 60,
) -> None:
    """Fail on what a generator makes that a fast path answers otherwise than the plain one, up to rounding."""

    @settings(max_examples=examples)
    @given(made)
    def check(one: Any) -> None:
        np.testing.assert_allclose(fast(one), plain(one), rtol=rtol, atol=atol)

    check()
