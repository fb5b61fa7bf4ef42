"""Which Gaussians of a scene float: small groups that touch nothing else.

Each Gaussian is linked to its nearest neighbours as far as both reach; what hangs together is a group (connected
components). Groups that are few Gaussians and show little are floaters; what a Gaussian shows is its opacity times the
product of its two largest standard deviations. How far it reaches is stated in its own size, so that the sparse, large
Gaussians of a background hang together as the dense ones of an object do.
"""

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, fast_for
from ..system.told import NOBODY, Told
from . import MAP
from .gaussians import Gaussians
from .sh import C0

NEIGHBOURS = 8
"""Nearest Gaussians that each may be linked to."""

REACH = 3.0
"""Standard deviations that a Gaussian reaches."""

SHARE = 0.001
"""Of all Gaussians, or of what all of them show, that a group has to be to stay."""

_VISIBLE = 1 / 255
_PAINT = np.array([1.0, 0.0, 1.0])


def cleaned(gaussians: Gaussians, how: str, *, as_list: bool, threads: int, told: Told = NOBODY) -> Gaussians:
    """Gaussians without floaters, or with `MAP` all of them, floaters in magenta.

    Args:
        gaussians: any.
        how: `REMOVE` or `MAP`, see `gaussian`.
        as_list: make them a list; else pixels stay, and those of floaters become transparent.
        threads: to work with.
        told: is told how many there are and how much they show.

    Raises:
        InputError: all of them float, or scipy is missing.
    """
    flat = gaussians.flat()
    shown = _shown(flat)
    floating = floaters(flat, threads)
    if floating.all():
        raise InputError(f"all of {flat.count} Gaussians float, expected some that touch", where="clean")
    share = float(shown[floating].sum() / max(float(shown.sum()), 1e-300))
    gone = "in magenta" if how == MAP else "removed"
    told.say("notice", f"{int(floating.sum()):,} of {flat.count:,} Gaussians float, {share:.2%} of what shows: {gone}")
    if as_list:
        return _painted(flat, floating) if how == MAP else flat.taken(~floating)
    ends = np.cumsum([layer.opacities.size for layer in gaussians.layers])[:-1]
    layers = []
    for layer, own in zip(gaussians.layers, np.split(floating, ends), strict=True):
        own = own.reshape(layer.opacities.shape)
        hidden = layer.changed(opacities=np.where(own, np.float32(0), layer.opacities))
        layers.append(_painted(layer, own) if how == MAP else hidden)
    return Gaussians.stacked(layers)


def floaters(gaussians: Gaussians, threads: int = 1) -> NDArray:
    """(N,) bool of a list, which of its visible Gaussians float; InputError where scipy is missing."""
    with fast_for("clean"):
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import connected_components
        from scipy.spatial import cKDTree
    visible = np.flatnonzero(gaussians.opacities >= _VISIBLE)
    count = len(visible)
    floating = np.zeros(gaussians.count, bool)
    if count < 2:
        return floating
    means, shown = gaussians.means[visible].astype(np.float64), _shown(gaussians)[visible]
    reach = REACH * np.sqrt(shown / gaussians.opacities[visible])
    away, near = cKDTree(means).query(means, min(NEIGHBOURS + 1, count), workers=threads)
    row, column = np.nonzero(away <= reach[:, None] + reach[near])
    graph = coo_matrix((np.ones(len(row), bool), (row, near[row, column])), (count, count))
    groups = connected_components(graph, directed=False)[1]
    is_small = (np.bincount(groups) < SHARE * count) & (np.bincount(groups, shown) < SHARE * shown.sum())
    floating[visible] = is_small[groups]
    return floating


def _shown(gaussians: Gaussians) -> NDArray:
    """(N,) float64: opacities times the products of the two largest standard deviations."""
    sizes = np.sort(gaussians.scales.astype(np.float64), axis=1)[:, 1:]
    shown: NDArray = gaussians.opacities * sizes.prod(axis=1)
    return shown


def _painted(gaussians: Gaussians, which: NDArray) -> Gaussians:
    sh = gaussians.sh.copy()
    sh[which] = 0
    sh[which, 0] = (_PAINT - 0.5) / C0
    return gaussians.changed(sh=sh)
