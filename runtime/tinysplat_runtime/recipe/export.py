"""Gaussians on their way out: which of them go into a file, and how it is written, the same whoever asks."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..container.exact import Exact
from ..container.layout import MAX_FILE_BYTES, SUFFIX
from ..container.planes import Planes
from ..container.reader import read_container
from ..errors import InputError, TinySplatError
from ..formats import SH_BITS, SPZ_VERSION
from ..formats.table import save_gaussians, save_points
from ..formats.viewpoints import save_beside, seen_from
from ..gaussian import FUSE_SECONDS, OWN_VARIANCE
from ..gaussian.editing import crop, cut_degree, drop_transparent, merge, similarity, trim_border
from ..gaussian.footprints import widened
from ..gaussian.gaussians import Gaussians
from ..gaussian.notes import OPTIONS
from ..gaussian.quaternions import normalize_quats, quats_to_matrices
from ..system.files import StrPath, read_limited, write_atomically
from ..system.threads import Crew
from .request import Coding
from .types import check_types, shown

if TYPE_CHECKING:
    from ..prune.amount import Amount
    from ..scene.cameras import Camera
    from .stages import Tools

KEEPS_VIEWS = (SUFFIX, ".npz", ".safetensors")
"""Endings of files that know of which view each Gaussian is."""

KEEPS_CAMERAS = (*KEEPS_VIEWS, ".glb", ".gltf")
"""Endings of files that have room for cameras of photos."""

HOW = ("points", "sh_bits", "spz_version", "gltf_spz")
"""Fields of a request that say how other files than `.tsplat` are written."""

_AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}


@dataclass(frozen=True)
class ExportRequest:
    """What `convert` and `decode` do with Gaussians, in this order; of what is left out, nothing is done.

    Attributes:
        views: only the Gaussians of these views.
        dilate: own pixels² by which Gaussians are widened for other viewers; True for 0.16.
        trim_border: without so many of the outermost pixels of each view.
        fuse: for how many seconds the Gaussians of a capture are made one surface (needs numba); True for 120.
        keep_all: lists also get the Gaussians of a capture that other views show, `.tsplat` files also those
            of a list that pictures hardly need.
        min_opacity: only Gaussians of this opacity or more.
        sh_degree: SH cut to this degree.
        crop: the box that is kept, x, y and z of two corners.
        cameras: those of the photos that a list was made from, or what `load_cameras` reads.
        rotate: a turn of the scene, `x,90` for an axis and degrees, or a quaternion `w,x,y,z`.
        scale: by how much the scene is then enlarged.
        translate: by how much it is then moved, x, y and z.
        prune: leave out this share of the Gaussians (0.5), as many as a quality bears ("45dB"), or all but so many,
            those that pictures need least first (needs numba).
        notes: what the file says of itself, by name; an empty text takes back what the Gaussians said.
        points: write a plain point cloud (.ply) of means and colours.
        sh_bits: bits that .spz keeps of SH coefficients of degree 1 and above it.
        spz_version: of .spz files: 2, 3 or 4.
        gltf_spz: whether .glb and .gltf hold their Gaussians as SPZ.

    Raises:
        InputError: a value of another type or out of range.
    """

    views: Sequence[int] | None = None
    dilate: float | None = None
    trim_border: int | None = None
    fuse: float | None = None
    keep_all: bool = False
    min_opacity: float | None = None
    sh_degree: int | None = None
    crop: Sequence[float] | None = None
    cameras: Sequence[Camera] | StrPath | None = None
    rotate: str | Sequence[float] | None = None
    scale: float = 1.0
    translate: Sequence[float] = (0.0, 0.0, 0.0)
    prune: Amount | None = None
    notes: dict[str, str] = field(default_factory=dict)
    points: bool = False
    sh_bits: Sequence[int] = SH_BITS
    spz_version: int = SPZ_VERSION
    gltf_spz: bool = False

    def __post_init__(self) -> None:
        check_types(self)
        if len(self.sh_bits) != 2:
            fault = f"{','.join(map(str, self.sh_bits))}, expected two numbers of 1 to 8"
            raise InputError(fault, where="sh_bits")
        if self.crop is not None and len(self.crop) != 6:
            raise InputError(f"{shown(self.crop)}, expected 6 numbers", where="crop")
        if self.rotate is not None:
            rotation(self.rotate)

    @classmethod
    def of(cls, **options: Any) -> ExportRequest:
        """A request of options by name, the notes among them, as `convert` has them.

        Raises:
            InputError: an option that there is not, and what the class refuses.
        """
        unknown = sorted(set(options) - names())
        if unknown:
            raise InputError(f"unknown {', '.join(unknown)[:80]}, accepted are {', '.join(sorted(names()))}")
        usual = {"dilate": OWN_VARIANCE, "fuse": FUSE_SECONDS}
        given: dict[str, Any] = {
            name: usual[name] if value is True and name in usual else value for name, value in options.items()
        }
        if isinstance(given.get("prune"), str | int | float):
            from ..prune.amount import Amount

            given["prune"] = Amount.of(str(given["prune"]))
        notes = {name: text for name in OPTIONS if (text := given.pop(name, None)) is not None}
        return cls(notes=notes, **given)


def names() -> set[str]:
    """Of the options of an `ExportRequest`, the notes among them."""
    return {one.name for one in fields(ExportRequest)} - {"notes"} | set(OPTIONS)


@dataclass(frozen=True)
class ExportListener:
    """Who is told what goes on.

    Attributes:
        notice: gets a line for each thing that is done unasked, and for how fusing went.
        pruned: gets a line about what pruning left out.
        fusing: passes on the steps of fusing; the second says how things stand.
    """

    notice: Callable[[str], object] = str
    pruned: Callable[[str], object] = str
    fusing: Callable[[Iterable[int], Callable[[], str]], Iterator[int]] = lambda steps, note: iter(steps)


def exported(
    parts: Sequence[tuple[str, Gaussians]],
    path: str,
    request: ExportRequest,
    tools: Tools,
    listener: ExportListener | None = None,
) -> Gaussians:
    """What goes out.

    Args:
        parts: what errors call it, and Gaussians; several become one list.
        path: of the file that they go into; of a capture, more than `FEW` views, each surface goes out from two views
            where the format knows no views.
        request: see there.
        tools: to do it with, such as a `Runtime`.
        listener: who is told what goes on; None for nobody.

    Raises:
        InputError: an option that does not fit the Gaussians, numba is missing, or nothing is left.
    """
    listener = listener or ExportListener()
    chosen = []
    for name, part in parts:
        try:
            chosen.append(_selected(part, path, request, tools, listener))
        except TinySplatError as error:
            raise error.within(name) if name else error from None
    gaussians = chosen[0] if len(chosen) == 1 else merge(chosen)
    if request.crop is not None:
        gaussians = crop(gaussians, request.crop[:3], request.crop[3:])
    if request.cameras is not None:
        gaussians = seen_from(gaussians, request.cameras)
    if request.rotate is not None or request.scale != 1 or any(request.translate):
        turn = np.eye(3) if request.rotate is None else rotation(request.rotate)
        gaussians = similarity(gaussians, turn, request.scale, request.translate)
    if request.notes:
        gaussians = gaussians.with_notes(replace(gaussians.notes, **request.notes))
    return gaussians if request.prune is None else _pruned(gaussians, request.prune, tools, listener)


def write(
    path: StrPath, gaussians: Gaussians, request: ExportRequest, tools: Tools, source: StrPath | None = None
) -> list[str]:
    """Write what goes out, atomically.

    Args:
        path: of the file; its ending tells the format.
        gaussians: what `exported` returns.
        request: see there.
        tools: to do it with, such as a `Runtime`.
        source: the .tsplat file that they come from, whose quality a .tsplat file is written with; None for that of the
            default profile.

    Returns:
        What the format could not keep, one line each.
    """
    name = os.fspath(path).lower()
    if request.points:
        save_points(path, gaussians)
    elif name.endswith(SUFFIX):
        write_atomically(path, _coded(gaussians, request, tools, source))
    else:
        bits = (request.sh_bits[0], request.sh_bits[1])
        losses = save_gaussians(path, gaussians, bits, request.spz_version, gltf_spz=request.gltf_spz)
        if request.fuse is not None and gaussians.viewpoints and not name.endswith(KEEPS_CAMERAS):
            save_beside(Path(path), gaussians)
        return losses
    return []


def is_drawn_whole(path: str) -> bool:
    """Whether those who read a file of this name know of no views, and draw all of its Gaussians."""
    return not path.lower().endswith(KEEPS_VIEWS)


def rotation(words: str | Sequence[float]) -> NDArray:
    """`x,90` (an axis and degrees) or `w,x,y,z` (a quaternion) as a matrix (3, 3) float64."""
    parts = words.split(",") if isinstance(words, str) else list(words)
    try:
        if parts[0] in _AXES and len(parts) == 2:
            half = math.radians(float(parts[1])) / 2
            quat = np.array([math.cos(half), *(math.sin(half) * np.array(_AXES[str(parts[0])]))])
        else:
            quat = np.array([float(part) for part in parts])
        usable = quat.shape == (4,) and np.isfinite(quat).all() and quat.any()
    except (ValueError, IndexError, TypeError):
        usable = False
    if not usable:
        expected = "expected AXIS,DEGREES such as x,90 or a quaternion w,x,y,z"
        raise InputError(f"{shown(words)}, {expected}", where="rotate")
    return quats_to_matrices(normalize_quats(quat))


def _selected(
    gaussians: Gaussians, path: str, request: ExportRequest, tools: Tools, listener: ExportListener
) -> Gaussians:
    """What one file gives."""
    if request.dilate is not None:
        gaussians = widened(gaussians, request.dilate)
    if request.trim_border:
        gaussians = trim_border(gaussians, request.trim_border)
    if request.fuse is not None:
        gaussians = _fused(gaussians, request.fuse, tools, listener)
    elif is_drawn_whole(path) and not (request.keep_all or request.points or request.trim_border):
        gaussians = _thinned(gaussians, tools, listener)
    if request.min_opacity is not None:
        gaussians = drop_transparent(gaussians, request.min_opacity)
    return gaussians if request.sh_degree is None else cut_degree(gaussians, request.sh_degree)


def _thinned(gaussians: Gaussians, tools: Tools, listener: ExportListener) -> Gaussians:
    from ..render.near import FEW

    if len(gaussians.cameras) <= FEW:
        return gaussians
    from ..gaussian.thin import thinned

    thin = thinned(gaussians, Crew(tools.threads).map)
    said = f"writes {thin.count:,} of {gaussians.count:,} Gaussians, for viewers that draw all"
    listener.notice(f"{said}; --fuse makes them one, --keep-all keeps all")
    return thin


def _fused(gaussians: Gaussians, seconds: float, tools: Tools, listener: ExportListener) -> Gaussians:
    try:
        from ..refine.fuse import FuseStats, fused
    except ImportError as error:
        raise InputError(f'needs {error.name}; pip install "tinysplat[fast]" brings it', where="fuse") from None
    stats = FuseStats()

    def show(steps: Iterator[int]) -> Iterator[int]:
        return listener.fusing(steps, stats.note)

    joined = fused(gaussians, seconds=seconds, threads=tools.threads, stats=stats, show=show)
    listener.notice(stats.text)
    return joined


def _pruned(gaussians: Gaussians, amount: Amount, tools: Tools, listener: ExportListener) -> Gaussians:
    """Those that pictures need most, as one list."""
    try:
        from ..prune.reduction import leave_out
    except ImportError as error:
        raise InputError(f'needs {error.name}; pip install "tinysplat[fast]" brings it', where="prune") from None
    left = leave_out(gaussians, amount, tools.threads)
    listener.pruned(f"{left.text or 'none left out'}, in pictures as defined")
    return left.gaussians


def _coded(gaussians: Gaussians, request: ExportRequest, tools: Tools, source: StrPath | None) -> bytes:
    """A .tsplat file's bytes.

    Moved as a whole they take their source's very pictures, which hold what cameras see; else its profile and Q_g. Cut
    or joined they are no longer pixels of views, and coded as such. What was thinned once stays as it is.
    """
    from .stages import code

    keep_all = request.keep_all or request.prune is not None or bool(gaussians.notes.thinned)
    if source is None:
        return code(gaussians, Coding(keep_all=keep_all), tools)
    data = read_limited(source, MAX_FILE_BYTES)
    container = read_container(data, tools.limits)
    if isinstance(container.body, Exact):
        return code(gaussians, Coding(lossless=gaussians.is_per_pixel), tools)
    turns = request.rotate is not None and gaussians.degree > 0  # a basis of SH does not turn along
    # Where the scene grew, steps of depth did not grow along.
    keeps_pixels = request.views is None and request.scale == 1
    if not isinstance(container.body, Planes) or not gaussians.is_per_pixel or turns or not keeps_pixels:
        return code(gaussians, Coding(container.profile, container.qp, keep_all=keep_all), tools)
    return code(gaussians, Coding(like=data), tools)
