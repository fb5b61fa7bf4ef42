"""Captures photo by photo: each goes once through the stages of a network, beside the partners of its group.

Stages follow one another as each needs what the one before made of a photo and of its partners: a glance at cells of
8 × 8 pixels, from which exposures and depth ranges come; then, along a way from neighbour to neighbour, matching and
estimating. What these find of all photos waits on disk until all agree on depth (`joint.py`); then, along that way
again, dressing and finishing. What no photo needs any more is let go, so that in memory there are maps of the photos
about the one at hand. Contracts: docs/MODELS.md, role `stage`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..gaussian.gaussians import Gaussians
from ..graphs.inference import Graph, as_input
from ..scene.images import doubled
from ..scene.neighbours import Group, view_places
from ..scene.scenes import Frame, Scene
from ..system import disk
from ..system.told import NOBODY, Told
from .exposure import Exposures, Pair, one_exposure
from .predict import NetworkLimits, assembled, checked_inputs, padded
from .walk import predict_groups

CELL = 8
"""Side of the cells that are glanced at, pixels."""

LEAST_SOUND = 0.01
"""Cells that are less sure to match tell nothing about exposure."""


def predict_each(
    scene: Scene,
    stages: Mapping[str, Graph],
    groups: Sequence[Group],
    told: Told = NOBODY,
    run_jobs: Callable | None = None,
) -> Gaussians:
    """As `walk.predict_groups`, by the stages of a network.

    Args:
        scene: photos of one size, each of which is read once, and the depths between which they lie.
        stages: opened graphs by name.
        groups: in which every photo is kept once, beside its partners.
        told: is told of each photo, once its depth is found and once it is done.
        run_jobs: calls a function of each of a list, as `system.threads.Crew.map` does, for the step in which photos
            agree on depth; None leaves that out.

    Raises:
        InputError, NumericError, ModelError: as `predict.predict`.
    """
    cameras = scene.cameras
    near, far = scene.depth_range()
    places = view_places(cameras, near, far)
    neighbours: list[tuple[int, ...]] = [()] * len(cameras)  # of each photo, it and its partners, nearest first
    for group in groups:
        for v in group.kept:
            others = [u for u in group.views if u != v]
            away = np.square(places[others] - places[v]).sum(axis=1)
            neighbours[v] = (v, *(others[i] for i in np.argsort(away, kind="stable")))
    capture = _Capture(scene, stages, neighbours)
    order = [v for group in groups for v in group.kept]
    first = _first_asked(order, neighbours)
    for view in told.progress("depth of photos", order, costs=[1 + 2 * count for count in first]):
        capture.estimated(view)
    if run_jobs is not None:
        capture.agree(run_jobs, scene.frames, told)
    alone = [Group((v,), (v,)) for v in order]
    costs = [1 + 5 * count for count in first]
    return predict_groups(cameras, near, alone, lambda views: capture.finished(views[0]), told, costs)


def _first_asked(order: Sequence[int], neighbours: Sequence[tuple[int, ...]]) -> list[int]:
    """Of photos in this order, to how many of its neighbours each comes first: a stage runs once on each."""
    seen, counts = set[int](), []
    for view in order:
        counts.append(len({*neighbours[view]} - seen))
        seen.update(neighbours[view])
    return counts


class _Capture:
    """Photos, and what is known of those that are still needed: arrays by stage, view and name."""

    def __init__(self, scene: Scene, stages: Mapping[str, Graph], neighbours: Sequence[tuple[int, ...]]) -> None:
        cameras, (near, far) = scene.cameras, scene.depth_range()
        self.cameras, self.near, self.far, self.stages, self.neighbours = cameras, near, far, stages, neighbours
        self.photos = np.zeros((0, 0, 0, 3), np.uint16)  # (V, H, W, 3), padded to the network's stride
        self.units: list[NDArray] = []  # K divided by the size of that
        cells, limits = [], NetworkLimits.of(stages["glance"])
        for v, camera in enumerate(cameras):
            try:
                images = checked_inputs(
                    scene.frames[v].image()[None], [camera], near, far, replace(limits, min_views=1)
                )
            except InputError as error:
                raise InputError(error.message, where=(error.where or "images").replace("[0]", f"[{v}]")) from None
            grown, K = padded(images, [camera], limits)
            if not v:
                self.photos = disk.zeros((len(cameras), *grown.shape[1:]), np.uint16)
            self.photos[v] = np.rint(grown[0] * np.float32(65535))
            self.units.append(as_input(K[0]))
            cells.append(_means(self._planes(v), CELL))
        views, height, width, _ = self.photos.shape
        self.images = disk.zeros((views, 3, height, width))  # in the exposure that they are matched in
        self.ranges = [as_input([[1 / far, 1 / near - 1 / far]])] * len(cameras)
        self.exposures = self._exposures(cells)
        self.made: dict[tuple[str, int], dict[str, NDArray]] = {}
        self.estimates: dict[str, NDArray] = {}  # (V, 1, …) by name
        needed = np.bincount([u for around in neighbours for u in around], minlength=len(cameras))
        self.needed = {name: needed.tolist() for name in ("half", "match", "dress")}
        self.needed["half"] = [2 * count for count in self.needed["half"]]

    def finished(self, view: int) -> Gaussians:
        """A photo's Gaussians."""
        around = self.neighbours[view]
        for u in around:
            self._dress(u)
        own, camera = self.made["dress", view], self.cameras[view]
        outputs = self._run(
            "finish",
            view,
            shown=self.exposures.shown(self._planes(view), view),
            far=as_input([self.far]),
            levels=self._of("dress", "level", around),
            alphas=self._of("dress", "opacity", around),
            footprint=own.pop("footprint"),
            colours=own.pop("colours"),
            changes=own.pop("changes"),
        )
        self._let_go("dress", around)
        return assembled(outputs, [camera], self.near, self.stages["finish"].name)

    def _dress(self, view: int) -> None:
        if ("dress", view) in self.made:
            return
        around = self.neighbours[view]
        self.made["dress", view] = self._run(
            "dress",
            view,
            images=self.images[list(around)],
            shown=self.exposures.shown(self._planes(view), view),
            levels=self.estimates["level"][list(around), 0],
            agreements=self.estimates["agreement"][list(around), 0],
            **{name: self.estimates[name][view] for name in ("features", "coarse_features", "full", "clues")},
        )

    def agree(self, run_jobs: Callable, frames: Sequence[Frame], told: Told) -> None:
        """Correct depths of all photos, of which every one is estimated, until they agree."""
        from .joint import Photos, joint_depth, marks_of  # needs numba

        camera, levels = self.cameras[0], self.estimates["level"]
        views, _, _, *padded_to = levels.shape
        height, width = -(-camera.height // 2), -(-camera.width // 2)  # no photo shows what it is padded with
        offset, span = np.concatenate(self.ranges).T[:, :, None, None]
        inverse = disk.zeros((views, height, width))
        colours = disk.zeros((views, height, width, 3))
        for v in range(views):
            inverse[v] = offset[v] + span[v] * levels[v, 0, 0, :height, :width]
            colours[v] = _means(self.images[v : v + 1], 2)[0, :, :height, :width].transpose(1, 2, 0)
        marks = marks_of(frames, height, width)
        size = np.array([[padded_to[1]], [padded_to[0]], [1.0]])
        Ks = np.stack(self.units).astype(np.float64) * size
        photos = Photos(colours, Ks, self.cameras, self.near, self.far, marks)
        found = joint_depth(inverse, photos, run_jobs, told)
        rest = [(0, padded_to[0] - height), (0, padded_to[1] - width)]
        for v in range(views):
            maps = np.pad(found[v], rest, mode="edge")
            for name, its in (("level", maps), ("full", doubled(doubled(maps, 0), 1) / 16)):
                self.estimates[name][v, 0, 0] = ((its - offset[v]) / span[v]).clip(0, 1)

    def estimated(self, view: int) -> None:
        """Find a photo's depth."""
        around = self.neighbours[view]
        for u in around:
            self._match(u)
        own = self.made["match", view]
        heavy = {name: own.pop(name) for name in ("costs", "paths", "coarse_paths")}
        found = self._run(
            "estimate", view, half=self._of("half", "half", around), levels=self._of("match", "level", around), **heavy
        )
        for name, maps in found.items():
            if name not in self.estimates:
                self.estimates[name] = disk.zeros((len(self.cameras), *maps.shape))
            self.estimates[name][view] = maps
        self._let_go("match", around)
        self._let_go("half", around)

    def _match(self, view: int) -> None:
        if ("match", view) in self.made:
            return
        around = self.neighbours[view]
        for u in around:
            if ("half", u) not in self.made:
                image = self.exposures.matched(self._planes(u), u)
                self.images[u] = image[0]
                self.made["half", u] = {"half": _means(image, 2)}
        self.made["match", view] = self._run("match", view, half=self._of("half", "half", around))
        self._let_go("half", around)

    def _planes(self, view: int) -> NDArray:
        """(1, 3, H, W) float32 of a photo."""
        return (self.photos[view] * np.float32(1 / 65535)).transpose(2, 0, 1)[None]

    def _run(self, stage: str, view: int, **maps: NDArray) -> dict[str, NDArray]:
        """What a stage makes of a photo and its partners, given their cameras and maps."""
        around = self.neighbours[view]
        own = self.cameras[view].centre
        c2w = np.stack([np.eye(4)] * len(around))
        for pose, camera in zip(c2w, (self.cameras[u] for u in around), strict=True):
            pose[:3, :3], pose[:3, 3] = camera.rotation.T, camera.centre - own
        K = np.stack([self.units[u] for u in around])
        ranges = np.concatenate([self.ranges[u] for u in around])
        return self.stages[stage].run({"K": K, "c2w": as_input(c2w), "ranges": ranges, **maps})

    def _of(self, stage: str, name: str, around: Sequence[int]) -> NDArray:
        """(N, …) what a stage made of a photo and its partners."""
        return np.concatenate([self.made[stage, u][name] for u in around])

    def _let_go(self, stage: str, around: Sequence[int]) -> None:
        """A photo has had what this stage made of it and of its partners: what nobody else needs is dropped."""
        for u in around:
            self.needed[stage][u] -= 1
            if not self.needed[stage][u]:
                del self.made[stage, u]

    def _exposures(self, cells: Sequence[NDArray]) -> Exposures:
        """Exposures by what cells show; narrows the ranges to what they take up."""
        levels, pairs, ranges = [], [], []
        for v, around in enumerate(self.neighbours):
            levels.append(self._run("glance", v, cells=np.concatenate([cells[u] for u in around]))["level"])
        for v, around in enumerate(self.neighbours):
            among, beside = (np.concatenate([maps[u] for u in around]) for maps in (cells, levels))
            settled = self._run("settle", v, cells=among, levels=beside)
            ranges.append(settled["range"])
            here = cells[v][0].reshape(3, -1).T
            for u, there, sound in zip(
                around[1:], settled["there"], settled["sound"].reshape(len(around) - 1, -1), strict=True
            ):
                tells = sound > LEAST_SOUND
                pairs.append(Pair(v, u, here[tells], there.reshape(3, -1).T[tells], sound[tells], sound.size))
        self.ranges = ranges
        return one_exposure(pairs, [around[1:] for around in self.neighbours])


def _means(planes: NDArray, side: int) -> NDArray:
    """Means over side × side pixels of (1, 3, H, W)."""
    _, channels, height, width = planes.shape
    blocks = planes.reshape(1, channels, height // side, side, width // side, side)
    return blocks.mean(axis=(3, 5), dtype=np.float32)
