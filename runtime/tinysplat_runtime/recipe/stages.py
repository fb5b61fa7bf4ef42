"""The steps from photos to bytes, a function each: network, refinement, coding.

Each is given `Tools`, which a `Runtime` is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from ..codec.decoder import decode_gaussians
from ..codec.job import EncodeStats, Job, PhotoScene
from ..codec.modes import AUTO
from ..codec.modes.choice import choose
from ..codec.modes.registry import MODES
from ..codec.recode import encode_like
from ..codec.search import Coder, code_to_psnr, code_to_size
from ..container.exact import Exact
from ..container.photos import Photos
from ..container.planes import Planes
from ..container.points import Points
from ..container.records import Limits
from ..errors import InputError, warn
from ..gaussian.gaussians import Gaussians
from ..graphs.each import predict_each
from ..graphs.enlarge import LARGE_PIXELS, Enlarger, predict_large
from ..graphs.inference import GraphStore
from ..graphs.predict import NetworkLimits
from ..graphs.predict import predict as run_network
from ..graphs.walk import capture_groups, predict_groups
from ..render import Renderer
from ..render.paths import ring
from ..scene.cameras import Camera
from ..scene.neighbours import CLOSE
from ..scene.scenes import Scene
from ..system.decibels import decibels
from ..system.progress import Show, plain
from ..system.stopwatch import Stopwatch
from ..system.threads import Crew
from .request import Coding, EncodeRequest
from .words import Refinement

if TYPE_CHECKING:
    from ..refine.stats import RefineStats

LEAST_EACH = 3
"""Photos from which on they go through a network's stages one by one: two have nobody else to agree with."""

FREE_VIEWS, MOST_JUDGED = 4, 16
"""Views about Gaussians of no pixels that `target_psnr` is measured from, and of Gaussians with pixels at most."""


class Tools(Protocol):
    """What every step works with.

    Attributes:
        store: opens graphs.
        threads: of each step; no result depends on them.
        limits: what a file may ask for when it is decoded.
    """

    store: GraphStore
    threads: int
    limits: Limits


@dataclass(frozen=True)
class Way:
    """How photos go through a network.

    Attributes:
        enlarger: brings what the network finds on small copies of large photos to every pixel; None where it runs on
            the photos as they are.
        is_each: whether photos go one by one, and not group by group: three or more, which are not large, where the
            network has stages, and where no file is to keep groups.
        is_joint: whether these then agree on depth.
    """

    enlarger: Enlarger | None
    is_each: bool
    is_joint: bool = False

    @classmethod
    def of(cls, scene: Scene, model: str, tools: Tools, *, whole: bool = False, joint: bool = True) -> Way:
        """See `Runtime.predict` for the arguments."""
        if whole:
            return cls(None, False)
        camera = scene.cameras[0]
        graph = tools.store.enlarger() if camera.width * camera.height > LARGE_PIXELS else None
        enlarger = Enlarger.of(graph) if graph is not None else None
        if enlarger is not None and tools.store.shipped_network(model) in enlarger.networks:
            return cls(enlarger, False)
        is_each = len(scene.frames) >= LEAST_EACH and tools.store.has_stages(model)
        return cls(None, is_each, is_each and joint)


def predict(
    scene: Scene, model: str, tools: Tools, way: Way, *, watch: Stopwatch | None = None, show: Show = plain
) -> Gaussians:
    """Gaussians of all views of a scene; see `Runtime.predict`."""
    watch = watch or Stopwatch()
    near, far = scene.depth_range()
    scene.check_one_size()
    stages = tools.store.stages(model) if way.is_each else None
    graph = stages["glance"] if stages else tools.store.network(model)
    try:
        shared = CLOSE if stages else np.inf  # one by one, groups of their own cost no calls
        groups = capture_groups(scene.cameras, near, far, NetworkLimits.of(graph), shared)
    except InputError as error:
        raise error.within(str(scene.path)) from None
    if stages:
        run_jobs = Crew(tools.threads).map if way.is_joint else None
        if run_jobs is not None and find_spec("numba") is None:
            warn('photos do not agree on depth: to let them needs numba; pip install "tinysplat[fast]" brings it')
            run_jobs = None

        def read(view: int) -> NDArray:
            return scene.frames[view].image()

        with watch.stage("network"):
            return predict_each(read, scene.cameras, near, far, stages, groups, show, run_jobs)

    def run(views: Sequence[int]) -> Gaussians:
        part = scene.views(views)
        images = [part.images()]
        with watch.stage("network"):
            if way.enlarger is not None:
                return predict_large(images.pop(), part.cameras, near, far, graph, way.enlarger)
            return run_network(images.pop(), part.cameras, near, far, graph)

    return predict_groups(scene.cameras, near, groups, run, show)


def refine(
    gaussians: Gaussians,
    scene: Scene,
    refinement: Refinement | None,
    coding: Coding,
    tools: Tools,
    *,
    stats: RefineStats | None = None,
    show: Show | None = None,
) -> Gaussians:
    """Gaussians that show their photos better; see `Runtime.refine`, whose default None stands for."""
    try:
        from ..refine.refine import Refining
    except ImportError as error:
        raise InputError(f'needs {error.name}; pip install "tinysplat[fast]" brings it', where="refine") from None
    budget = Refinement() if refinement is None else refinement
    told = coding.planes, coding.step_qp, Crew(tools.threads).map
    return Refining(gaussians, scene, *told, steps=budget.steps, seconds=budget.seconds, stats=stats).run(show)


def code(
    gaussians: Gaussians, coding: Coding, tools: Tools, *, keep_all: bool = False, stats: EncodeStats | None = None
) -> bytes:
    """Gaussians as a `.tsplat` file's bytes.

    Args:
        gaussians: see `Runtime.compress`.
        coding: how.
        tools: to do it with.
        keep_all: of a list, all that show at all, in place of those alone that are worth their bytes.
        stats: filled with what was measured.

    Raises:
        FormatError, InputError, NumericError: as `Runtime.compress`.
    """
    stats, like = stats or EncodeStats(), coding.example()
    if like is not None:
        return encode_like(
            gaussians,
            like,
            tools.store,
            threads=tools.threads,
            limits=tools.limits,
            drop_invalid=coding.drop_invalid,
            stats=stats,
        )
    job = Job(gaussians, coding.planes, coding.step_qp, tools.store, tools.threads, stats, coding.drop_invalid)
    body = Exact if coding.lossless else Planes if gaussians.is_per_pixel else Points
    mode = MODES[body.mode]
    stats.mode = mode.name
    thins = body is Points and not keep_all
    if mode.coder is None or not (thins or coding.target_size or coding.target_psnr is not None):
        return mode.encode(job)
    coder = _thinning(job) if thins else mode.coder(job)
    if coding.target_size is not None:
        return code_to_size(coder, coding.target_size)
    if coding.target_psnr is not None:
        return code_to_psnr(coder, coding.target_psnr, _fidelity(gaussians, tools))
    return coder.code(job.qp)


def code_photos(
    gaussians: Gaussians, request: EncodeRequest, photos: PhotoScene, tools: Tools, *, stats: EncodeStats
) -> bytes:
    """A file of the mode that is asked for, which carries photos; or where `auto` has better, Gaussians.

    Args:
        gaussians: what the network made of the photos.
        request: how.
        photos: what a network was given.
        tools: to do it with.
        stats: filled with what was measured, the mode, and why `auto` came to it.
    """
    seconds = stats.watch.seconds.get("network", 0.0)
    job = Job(gaussians, request.planes, request.step_qp, tools.store, tools.threads, stats, photos=photos)
    mode = MODES[Photos.mode if request.mode == AUTO else request.mode]
    data, stats.mode = mode.encode(job), mode.name
    if request.mode != AUTO:
        return data
    planes = code(gaussians, request, tools, stats=stats)
    stats.mode, stats.reason = choose(planes, data, photos.network, seconds)
    return data if stats.mode == mode.name else planes


def _thinning(job: Job) -> Coder:
    """What leaves Gaussians out; without numba, or where nobody knows what people see of them, what keeps all and a
    warning that says so.
    """
    from ..codec.modes.free import encoder

    try:
        from ..codec.free.encoder import visible
        from ..prune.thinning import ThinningEncoder
        from ..prune.views import views_of
    except ImportError as error:
        fault = f'all Gaussians are kept: to leave some out needs {error.name}; pip install "tinysplat[fast]" brings it'
        warn(fault)
        return encoder(job)
    views, doubt = views_of(visible(job.gaussians))
    if doubt:
        warn(f"all Gaussians are kept: {doubt}")
        return encoder(replace(job, gaussians=replace(job.gaussians.flat(), viewpoints=())))
    return ThinningEncoder(job.gaussians, views, job.profile, threads=job.threads, stats=job.stats)


def _views_of_list(gaussians: Gaussians) -> list[Camera]:
    """Views of Gaussians of no pixels: beside those of their photos, or from all sides."""
    if not gaussians.viewpoints:
        return ring(gaussians, FREE_VIEWS)
    from ..codec.free.encoder import visible
    from ..prune.views import views_of

    return views_of(visible(gaussians))[0].judging[:FREE_VIEWS]


def _fidelity(gaussians: Gaussians, tools: Tools) -> Callable[[bytes], float]:
    """PSNR of a file's pictures to those of `gaussians` as `render` draws them by default, the mean over their views,
    of many over some of them, or over some made up.
    """
    # In numpy, so that no byte depends on whether numba is installed.
    renderer = Renderer(gaussians, threads=tools.threads, compiled=False)
    own = gaussians.cameras
    chosen = np.linspace(0, len(own) - 1, min(MOST_JUDGED, len(own))).round().astype(int)
    cameras = [own[index] for index in chosen] or _views_of_list(gaussians)
    raw = [renderer.render(camera) for camera in cameras]

    def measure(data: bytes) -> float:
        again = decode_gaussians(data, tools.store, threads=tools.threads, limits=tools.limits)
        decoded = Renderer(again, threads=tools.threads, compiled=False)
        errors = [
            float(np.mean((decoded.render(camera).clip(0, 1) - image.clip(0, 1)) ** 2, dtype=np.float64))
            for camera, image in zip(cameras, raw, strict=True)
        ]
        return float(np.mean([decibels(error) for error in errors]))

    return measure
