"""The public door: `Renderer` for many frames of the same Gaussians, `render` for one."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from functools import cache
from numbers import Real
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, check_is
from ..gaussian.gaussians import Gaussians
from ..scene.cameras import Camera
from ..scene.viewpoints import corrected
from ..system.threads import Crew, available_cores
from .composite import Band, Canvas, Workspace, composite, tile_groups
from .near import NearViews
from .prepare import Block, Part, parts
from .project import Splats, View, may_show, parts_show, project
from .tiles import MAX_PAIRS, TILE_HEIGHT, TILE_WIDTH, TileGrid, bands, depth_order, find_pairs, runs

if TYPE_CHECKING:
    from typing import Unpack

OUTPUTS = ("rgb", "depth", "alpha")

DEFINITION: dict[str, Any] = {"dilation": "screen", "order": "depth"}
"""Options that draw what 3DGS defines: for comparisons, and where bytes of files follow from a picture."""

DILATIONS = ("own", "screen")
"""What a splat is widened by, so that surfaces stay closed: the pixel that it stands for, or the screen's alone."""

ORDERS = ("near", "depth")
"""What covers what: near views all others, or what lies nearer."""

KEPT_BYTES = 512 << 20
"""Most that a renderer keeps from frame to frame of what does not depend on the camera, beyond what one frame needs."""

SAMPLE = 16
"""Of so many Gaussians of a block one is looked at, whether leaving out what does not show is worth while."""

MANY_PARTS = 16
"""From so many parts on, half of which a picture often does not reach, a frame asks which it does."""

NEAR_PLANE = 0.01
"""Scene units; nearer Gaussians are not drawn."""


class Renderer:
    """Renders one set of Gaussians from any number of cameras.

    Holds what does not depend on the camera (planar coefficients, principal axes), about 110 bytes per Gaussian of
    SH degree 0 and 290 of degree 3, but no more than `KEPT_BYTES`; of more Gaussians it is made for every frame,
    block by block. A frame's buffers take 60 bytes for every Gaussian that it shows. Compiled, it holds 70 bytes
    per Gaussian of degree 0, and 80 for every one that shows; for one frame alone, nothing but the latter. Pictures
    do not depend on the number of threads, bit for bit. Frames asked for from several threads at once are made one
    after the other.
    """

    def __init__(
        self,
        gaussians: Gaussians,
        threads: int | None = None,
        *,
        dilation: str = "own",
        order: str = "near",
        compiled: bool | None = None,
        keep: bool = True,
    ) -> None:
        """Prepare to render all layers of `gaussians` together.

        Args:
            gaussians: (V, H, W) with or without further layers, or (N,).
            threads: how many to use; None for one per available core.
            dilation: "own" or "screen", see `render`.
            order: "near" or "depth", see `render`.
            compiled: whether frames are drawn by compiled code, which needs numba (`tinysplat[fast]`) and gives the
                same pictures to 1e-5 except where rounding decides a threshold; None where numba is installed.
            keep: whether there will be further frames, for which what does not depend on the camera is kept.

        Raises:
            InputError: `gaussians` are none, `threads` is no whole number above 0, `dilation` or `order` is neither of
                the two, or `compiled` is asked for without numba.
        """
        check_is(gaussians, Gaussians, "gaussians", "Gaussians")
        self._threads = _whole_number("threads", threads) if threads is not None else available_cores()
        self._origin, self._viewpoints = gaussians.origin, gaussians.viewpoints
        self._run = Crew(self._threads).map
        module = _compiled_module(required=compiled is True) if compiled is not False else None
        _check_choice("dilation", dilation, DILATIONS)
        _check_choice("order", order, ORDERS)
        self._near = NearViews.of(gaussians) if order == "near" else None
        self._shares = np.array([[0.0], [1.0]]).repeat(max(len(gaussians.cameras), 1), axis=1)
        by_photo = bool(gaussians.cameras) and (self._near is not None or dilation == "own")
        cut = list(parts(gaussians, by_view=by_photo, own_pixels=dilation == "own"))
        row_bytes = 56 + 4 * 3 * gaussians.sh.shape[-2]
        self._parts = cut
        self._keeps = keep and sum(part.size for part in cut) * row_bytes <= KEPT_BYTES
        self._compiled = module.Rasteriser(cut, self._keeps, self._run) if module else None
        self._block = cache(lambda number: cut[number].block())
        self._splats = Splats(0)
        self._work = Workspace()
        self._lock = threading.Lock()

    @property
    def is_compiled(self) -> bool:
        """Whether frames are drawn by compiled code."""
        return self._compiled is not None

    def render(
        self,
        camera: Camera,
        size: tuple[int, int] | None = None,
        *,
        outputs: Sequence[str] = ("rgb",),
        background: ArrayLike = (0.0, 0.0, 0.0),
        near_plane: float = NEAR_PLANE,
        exposed: bool = False,
    ) -> Any:
        """Render one frame; see `render` for arguments, result and errors."""
        outputs = _checked_outputs(outputs)
        colour = _checked_background(background)
        check_is(camera, Camera, "camera", "a Camera")
        if size is not None:
            camera = camera.resized(*_checked_size(size))
        if not (isinstance(near_plane, Real) and 0 <= near_plane < math.inf):
            raise InputError(f"{near_plane!r}, expected a finite number ≥ 0 in scene units", where="near_plane")
        camera, gain = corrected(camera, self._viewpoints)
        with self._lock:
            canvas = self._draw(View.of(camera, self._origin, float(near_plane)), "depth" in outputs)
        makers: dict[str, Callable[[], NDArray]] = {
            "rgb": lambda: _rgb(canvas, colour, gain if exposed else np.ones(3)),
            "depth": lambda: _depth(canvas),
            "alpha": lambda: np.float32(1) - canvas.left,
        }
        images = {name: makers[name]() for name in outputs}
        return images["rgb"] if outputs == ("rgb",) else images

    def _draw(self, view: View, with_depth: bool) -> Canvas:
        fronts, opaque = self._shares if self._near is None else self._near.shares(view.camera)
        drawn = [number for number, part in enumerate(self._parts) if opaque[part.view]]
        if len(drawn) >= MANY_PARTS:
            shows = parts_show([self._parts[number] for number in drawn], view)
            drawn = [n for n, does in zip(drawn, shows, strict=True) if does] or drawn[:1]
        if self._compiled is not None:
            canvas: Canvas = self._compiled.draw(drawn, view, fronts, opaque, with_depth)
            return canvas
        cuts: list[Part | Block] = [self._block(n) if self._keeps else self._parts[n] for n in drawn]
        ends = np.cumsum([0, *(cut.size for cut in cuts)])  # of a stripe that nothing reaches, there are none
        if self._splats.count < ends[-1]:
            self._splats = Splats(int(ends[-1]))
        splats = self._splats

        def project_part(piece: tuple[int, Part | Block, int]) -> NDArray:
            number, cut, first = piece
            if not cut.size:
                return np.zeros(0, np.int32)
            if isinstance(cut, Part):
                block = cut.block(may_show(cut, view))
            else:  # picking rows costs about as much as projecting a few more
                block = cut.compress(may_show(cut, view)) if may_show(cut, view, SAMPLE).mean() < 0.75 else cut
            of = self._parts[number]
            shares = (fronts[of.view] if of.is_surface else 0.0), opaque[of.view]
            return project(block, view, (TILE_WIDTH, TILE_HEIGHT), splats, first=first, shares=shares)

        ids = self._run(project_part, list(zip(drawn, cuts, ends[:-1].tolist(), strict=True)))
        order, boxes = _in_order(splats, ids)
        pairs = int(((boxes[1] - boxes[0] + 1) * boxes[2]).sum(dtype=np.int64))
        canvas = Canvas(view.camera.height, view.camera.width, with_depth)

        def draw_band(place: tuple[int, TileGrid]) -> None:
            band = Band(*place, with_depth, bool(fronts.any()))
            self._composite(band, order, boxes)
            band.write(canvas)

        self._run(draw_band, bands(view.camera.width, view.camera.height, pairs))
        return canvas

    def _composite(self, band: Band, order: NDArray, boxes: NDArray) -> None:
        """Draw what of `order` reaches a band."""
        first, last = band.first_row, band.first_row + band.grid.rows - 1
        here = np.flatnonzero((boxes[0] <= last) & (boxes[1] >= first))
        top, bottom, columns = boxes.take(here, axis=1)
        areas = (np.minimum(bottom, last) - np.maximum(top, first) + 1) * columns
        open_tiles = None
        for run in runs(areas, MAX_PAIRS):
            if open_tiles is not None and not open_tiles.any():
                return
            pairs = find_pairs(self._splats, order.take(here[run]), first, band.grid, open_tiles)
            for tiles in tile_groups(pairs):
                composite(band, self._splats, pairs, tiles, self._work)
            open_tiles = band.open_tiles()


class PictureOptions(TypedDict, total=False):
    """Options of every picture by name; `render` says what they are."""

    outputs: Sequence[str]
    background: ArrayLike
    near_plane: float
    exposed: bool


def render(
    gaussians: Gaussians,
    camera: Camera,
    size: tuple[int, int] | None = None,
    *,
    dilation: str = "own",
    order: str = "near",
    threads: int | None = None,
    **options: Unpack[PictureOptions],
) -> Any:
    """Render Gaussians by exact EWA splatting, without 3DGS's 3σ cut, and fit to be seen from closer and between views.

    With `dilation="screen"` and `order="depth"`, and of lists that know no photos always, pictures are those that 3DGS
    defines; docs/CONVENTIONS.md, "Drawing", says exactly what is drawn.

    Every Gaussian reaches all pixels where its alpha is at least 1/255; means at a depth z ≤ `near_plane` are
    dropped; the projection's Jacobian is taken at the mean, clamped to the image widened by 15 % of its size on each
    side, so 1.3·tan(fov/2) with a centred principal point and limits per side with any other, as in gsplat.

    Args:
        gaussians: all layers are rendered together; equal depths are drawn in their order.
        camera: where from; K may be skewed and its principal point anywhere.
        size: (H, W) to render at instead of the camera's, which is scaled to cover it and cropped.
        dilation: "own" widens a splat by the photo's pixel that it stands for, so that surfaces stay closed from
            however near, and from afar hide no more than they should (of a list that knows its photos by that of the
            nearest one, from nearer than it); "screen" by 0.3 px² of the picture's.
        order: "near" draws the surfaces of near views before everything else, and of many views six at most (`near.py`
            says how much of which); "depth" all Gaussians by depth.
        threads: how many to use, None for one per available core; the picture is the same, bit for bit.
        outputs: any of "rgb", "depth", "alpha".
        background: (3,) colour behind the Gaussians.
        near_plane: scene units.
        exposed: "rgb" of a trained list is as bright and as coloured as the nearest of its photos, so that it can be
            held against a photo, and not as most of them.

    Returns:
        (H, W, 3) float32 in [0, 1] where "rgb" alone is asked for, otherwise a dictionary of arrays by name: "rgb",
        "depth" (H, W) float32, the blend-weighted mean of z (not ray length) over the Gaussians seen, 0 where none
        are, and "alpha" (H, W) float32, 1 − transmittance.

    Raises:
        InputError: an argument is not as described.
    """
    # Loading compiled code takes longer than drawing one picture without it.
    renderer = Renderer(gaussians, threads, dilation=dilation, order=order, compiled=False, keep=False)
    return renderer.render(camera, size, **options)


def _in_order(splats: Splats, ids: list[NDArray]) -> tuple[NDArray, NDArray]:
    """Splats by depth, and their boxes."""
    order = depth_order(splats.depths, np.concatenate([np.zeros(0, np.int32), *ids]))
    return order, splats.boxes.take(order, axis=1)


def _check_choice(name: str, value: object, accepted: tuple[str, ...]) -> None:
    if value not in accepted:
        raise InputError(f"{value!r}, expected one of {accepted}", where=name)


def _compiled_module(required: bool) -> ModuleType | None:
    """The module that composites by compiled code; None where numba is missing or has no place for its cache."""
    try:
        from . import compiled
    except (ImportError, RuntimeError) as error:
        if required:
            raise InputError(f"{error}; pip install 'tinysplat[fast]' brings numba", where="compiled") from None
        return None
    return compiled


def _rgb(canvas: Canvas, background: NDArray, gain: NDArray) -> NDArray:
    image = canvas.colour
    if (gain != 1).any():
        image *= gain.astype(np.float32)
    if background.any():
        image += canvas.left[..., None] * background
    return np.clip(image, 0, 1, out=image)


def _depth(canvas: Canvas) -> NDArray:
    depths, weights = canvas.depth
    return np.divide(depths, weights, out=np.zeros_like(depths), where=weights > 0)


def _whole_number(name: str, value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
        raise InputError(f"{value!r}, expected a whole number above 0", where=name)
    return int(value)


def _checked_size(size: object) -> tuple[int, int]:
    if not isinstance(size, (tuple, list)) or len(size) != 2:
        raise InputError(f"{size!r}, expected (height, width)", where="size")
    return _whole_number("size[0]", size[0]), _whole_number("size[1]", size[1])


def _checked_outputs(outputs: object) -> tuple[str, ...]:
    names = (outputs,) if isinstance(outputs, str) else outputs
    if not isinstance(names, (tuple, list)) or not names or any(name not in OUTPUTS for name in names):
        raise InputError(f"{outputs!r}, expected some of {OUTPUTS}", where="outputs")
    return tuple(names)


def _checked_background(background: object) -> NDArray:
    try:
        with np.errstate(over="ignore"):
            colour = np.asarray(background, np.float32)
    except (TypeError, ValueError):
        colour = np.zeros(0, np.float32)
    if colour.shape != (3,) or not np.isfinite(colour).all():
        raise InputError(f"{background!r}, expected three finite numbers", where="background")
    return colour
