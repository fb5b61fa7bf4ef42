"""Gaussians on their way out: which of them go into a file, and how it is written, the same whoever asks."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..container.exact import Exact
from ..container.layout import MAX_FILE_BYTES, SUFFIX
from ..container.planes import Planes
from ..container.reader import read_container
from ..errors import InputError, TinySplatError, fast_for
from ..formats.table import save_gaussians, save_points
from ..formats.viewpoints import save_beside, seen_from
from ..gaussian.editing import crop, cut_degree, drop_transparent, merge, select_views, similarity, trim_border
from ..gaussian.footprints import widened
from ..gaussian.gaussians import Gaussians
from ..gaussian.quaternions import normalize_quats, quats_to_matrices
from ..system.files import StrPath, read_limited, write_atomically
from ..system.told import NOBODY, Told
from .request import HOW, Coding, CompressRequest, ExportRequest

if TYPE_CHECKING:
    from ..list.pruning.amount import Amount
    from .steps import Tools

KEEPS_VIEWS = (SUFFIX, ".npz", ".safetensors")
"""Endings of files that know of which view each Gaussian is."""

KEEPS_CAMERAS = (*KEEPS_VIEWS, ".glb", ".gltf")
"""Endings of files that have room for cameras of photos."""


def exported(
    parts: Sequence[tuple[str, Gaussians]], path: str, request: ExportRequest, tools: Tools, told: Told = NOBODY
) -> Gaussians:
    """What goes out.

    Args:
        parts: what errors call it, and Gaussians; several become one list.
        path: of the file that they go into.
        request: see there.
        tools: to do it with, such as a `Runtime`.
        told: who is told what goes on.

    Raises:
        InputError: an option that does not fit the Gaussians, numba is missing, or nothing is left.
    """
    request.check_output(path)
    found = None
    if request.length is not None:
        from .length import UNIT, measured

        if len(parts) > 1:
            raise InputError(f"of {len(parts)} files, expected one", where="length")
        found = measured(parts[0][1], request.length)
        told.say("notice", str(found))
    chosen = []
    for name, part in parts:
        try:
            chosen.append(_selected(part, request))
        except TinySplatError as error:
            raise error.within(name) if name else error from None
    gaussians = chosen[0] if len(chosen) == 1 else merge(chosen)
    if request.crop is not None:
        gaussians = crop(gaussians, request.crop[:3], request.crop[3:])
    if request.cameras is not None:
        gaussians = seen_from(gaussians, request.cameras)
    if request.clean is not None:
        from ..gaussian.clean import cleaned

        as_list = not gaussians.is_per_pixel or is_drawn_whole(path)
        gaussians = cleaned(gaussians, request.clean, as_list=as_list, threads=tools.threads, told=told)
    if request.level:
        from ..gaussian.level import levelled

        gaussians = levelled(gaussians, told)
    scale = request.scale if found is None else found.scale
    if request.rotate is not None or scale != 1 or any(request.translate):
        turn = np.eye(3) if request.rotate is None else quats_to_matrices(normalize_quats(np.array(request.rotate)))
        gaussians = similarity(gaussians, turn, scale, request.translate)
    if found is not None:
        gaussians = gaussians.with_notes(replace(gaussians.notes, unit=UNIT))
    if request.notes:
        gaussians = gaussians.with_notes(replace(gaussians.notes, **request.notes))
    return gaussians if request.prune is None else _pruned(gaussians, request.prune, tools, told)


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
        return save_gaussians(path, gaussians, request.sh_bits, request.spz_version)
    return []


def write_list(path: StrPath, gaussians: Gaussians, request: ExportRequest) -> list[str]:
    """Write a list, and beside it the cameras of its photos if the format has no room for them; as `write` returns."""
    losses = save_gaussians(path, gaussians, request.sh_bits, request.spz_version)
    if gaussians.viewpoints and not os.fspath(path).lower().endswith(KEEPS_CAMERAS):
        save_beside(Path(path), gaussians)
    return losses


def save(path: StrPath, gaussians: Gaussians, options: Mapping[str, object], tools: Tools) -> list[str]:
    """Write Gaussians as `write` has it, or for a `.tsplat` file by options of `compress` too.

    Returns:
        As `write`.
    """
    is_ours = os.fspath(path).lower().endswith(SUFFIX)
    moving = {name for name, option in ExportRequest.options().items() if option.group != HOW} - {"keep_all", "cameras"}
    coding = {name: value for name, value in options.items() if is_ours and name not in moving}
    request = ExportRequest.of(**{name: value for name, value in options.items() if name not in coding})
    gaussians = gaussians if request.views is None else select_views(gaussians, request.views)
    gaussians = exported([("", gaussians)], os.fspath(path), request, tools)
    if not is_ours:
        return write(path, gaussians, request, tools)
    from .compress import compress

    if request.prune is not None:
        coding.setdefault("keep_all", True)
    write_atomically(path, compress(CompressRequest.of(gaussians, **coding), tools).data)
    return []


def is_drawn_whole(path: str) -> bool:
    """Whether those who read a file of this name know of no views, and draw all of its Gaussians."""
    return not path.lower().endswith(KEEPS_VIEWS)


def _selected(gaussians: Gaussians, request: ExportRequest) -> Gaussians:
    """What one file gives."""
    if request.dilate is not None:
        gaussians = widened(gaussians, request.dilate)
    if request.trim_border:
        gaussians = trim_border(gaussians, request.trim_border)
    if request.min_opacity is not None:
        gaussians = drop_transparent(gaussians, request.min_opacity)
    return gaussians if request.sh_degree is None else cut_degree(gaussians, request.sh_degree)


def _pruned(gaussians: Gaussians, amount: Amount, tools: Tools, told: Told) -> Gaussians:
    """Those that pictures need most, as one list."""
    with fast_for("prune"):
        from ..list.pruning.reduction import leave_out
    left = leave_out(gaussians, amount, tools.threads, told)
    told.say("done", f"{left.text or 'none left out'}, in pictures as defined")
    return left.gaussians


def _coded(gaussians: Gaussians, request: ExportRequest, tools: Tools, source: StrPath | None) -> bytes:
    """A .tsplat file's bytes.

    Moved as a whole they take their source's very pictures, which hold what cameras see; else its profile and Q_g. Cut
    or joined they are no longer pixels of views, and coded as such. What was pruned once stays as it is.
    """
    from .coding import code
    from .kinds import kind_of

    keep_all = request.keep_all or request.prune is not None or bool(gaussians.notes.pruned)
    coding = _coding(gaussians, request, tools, source)
    return code(gaussians, coding, tools, kind_of(gaussians, coding, keep_all=keep_all))


def _coding(gaussians: Gaussians, request: ExportRequest, tools: Tools, source: StrPath | None) -> Coding:
    """How fine they are coded: as their source is, and moved as a whole by its very pictures."""
    if source is None:
        return Coding()
    data = read_limited(source, MAX_FILE_BYTES)
    container = read_container(data, tools.limits)
    if isinstance(container.body, Exact):
        return Coding(lossless=gaussians.is_per_pixel)
    # a basis of SH does not turn along
    turns = (request.rotate is not None or request.level) and gaussians.degree > 0
    # Where the scene grew, steps of depth did not grow along.
    keeps_pixels = request.views is None and request.scale == 1 and request.length is None
    if not isinstance(container.body, Planes) or not gaussians.is_per_pixel or turns or not keeps_pixels:
        return Coding(profile=container.profile, qp=container.qp)
    return Coding(like=data)
