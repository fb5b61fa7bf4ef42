"""Corners that photos have in common: what they say of cameras, of single photos and of the depth range."""

import numpy as np

from ...scene.matches import inliers, matched
from .readings import readings, single
from .seen import CHANCE, ENOUGH, Seen

MORE = 1.25
"""A reading is better that so many times as many corners fit, and more than by chance: of right cameras of ten scenes
the best has 0.92 times, of focal lengths 1.3 times too long at least 1.3. Of cameras in a row, pictures swapped, turned
upside down and with inverted poses are as good as each other."""

NAMED = 3
"""Readings that are named, and photos that fit worst, of which each alone is read in other ways."""

UNITS = (1000.0, 100.0, 10.0, 0.1, 0.01, 0.001)


def misread(seen: Seen) -> list[str]:
    """A reading of cameras, or of one photo, that far more of the photos' common corners fit."""
    cameras, places, shares = seen.closer, seen.places, seen.shares
    given = sum(shares.values())

    def share(v: int) -> float:
        own = [pair for pair in places if v in pair]
        return sum(shares[pair] for pair in own) / max(1, sum(len(places[pair]) for pair in own))

    odd = sorted(cameras, key=share)[:NAMED] if len(cameras) > 2 else [-1]
    beside = [pair for pair in places if odd[0] not in pair]
    rest = sum(shares[pair] for pair in beside)
    scores: dict[str, float] = {}
    for text, read in readings(seen, cameras):
        kept = sum(inliers(places[v, u], read(v), read(u)) for v, u in beside)
        if kept < rest:  # it goes with one photo, at the others' cost
            continue
        around = [pair for pair in places if odd[0] in pair]
        score = kept + sum(inliers(places[v, u], read(v), read(u)) for v, u in around)
        if score >= max(MORE * given, given + CHANCE):
            scores[text] = score
    for view in odd if len(cameras) > 2 else ():
        scores |= _scores_of_one(seen, view)
    most = max(scores.values(), default=0.0)
    best: dict[str, str] = {}  # of each cause the reading that fits best
    for text in sorted(scores, key=lambda text: -scores[text]):
        if MORE * scores[text] > most:
            best.setdefault(text.split(": ")[0], text)
    return [f"{'; or '.join([*best.values()][:NAMED])}, photos agree far better"] if best else []


def _scores_of_one(seen: Seen, view: int) -> dict[str, float]:
    """How many corners of all photos fit readings of one, of those that far more of its own fit."""
    cameras, places = seen.closer, seen.places
    around = [pair for pair in places if view in pair]
    own = sum(seen.shares[pair] for pair in around)
    rest = sum(seen.shares.values()) - own
    scores = {}
    for text, corners, camera in single(seen, view):
        known, read_as = {**seen.corners, view: corners}, {**cameras, view: camera}
        both = places if corners is seen.corners[view] else {(v, u): matched(known[v], known[u]) for v, u in around}
        fits = sum(inliers(both[v, u], read_as[v], read_as[u]) for v, u in around)
        if fits >= max(MORE * own, own + CHANCE):
            scores[text] = rest + fits
    return scores


def alone(seen: Seen) -> list[str]:
    """Of three photos and more, the one that has nothing in common with any, where all others have much."""
    views = list(seen.closer)
    if not len(views) >= 3:
        return []

    def most(v: int, without: int = -1) -> float:
        return max((share for pair, share in seen.shares.items() if v in pair and without not in pair), default=0.0)

    v = min(views, key=most)
    if most(v) >= 1 or min(most(u, without=v) for u in views if u != v) < ENOUGH:
        return []
    cause = "of another scene or moment, turned away, or its pose is wrong"
    fault = "has nothing in common with the others, which match each other"
    return [f"{seen.names[v]} {fault}: {cause}; --views leaves it out"]


def range_of_corners(seen: Seen) -> list[str]:
    """A range that most corners lie outside of."""
    if seen.is_estimated or len(seen.corner_depths) < ENOUGH:
        return []
    near, far = seen.depths[0], seen.depths[-1]

    def inside(unit: float) -> float:
        return float(((near <= unit * seen.corner_depths) & (unit * seen.corner_depths <= far)).mean())

    if inside(1.0) >= 0.5:
        return []
    if len(better := [unit for unit in UNITS if inside(unit) >= 0.5]) == 1:
        return [f"translations are in other units than near and far: times {better[0]:g}, photos agree far better"]
    low, high = np.percentile(seen.corner_depths, (2, 98))
    range_ = f"near {near:g} and far {far:g} are not where the cameras say that things are"
    return [f"{range_}: photos agree about depths from {low:.3g} to {high:.3g}; --near and --far say so"]
