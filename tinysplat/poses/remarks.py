"""What is said of places that were found: what is no scene, and which photos were left out or are uncertain."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby, pairwise

from tinysplat_runtime.errors import InputError

from .judging import Placement

ENOUGH = 2 / 3
"""Share of a video's frames, or of photos, that have to be placed."""

MOST_NAMED = 6
"""Pairs of photos that are named where more are too far apart."""

ASIDE = "walk sideways or around what you film, by a tenth of its distance and more, with the camera towards it"


def check_placement(placement: Placement) -> None:
    """InputError where what was found is no scene."""
    if len(placement.right) < 2:
        said = "the places that were found contradict the photos' own matches"
        raise InputError(f"{said}: take photos that overlap more, from places farther apart")
    within = f"most points are seen from directions within {placement.parallax:.1f}°"
    loose = _of(len(placement.uncertain), len(placement.right), "place", "uncertain")
    if placement.only_turns:
        raise InputError(
            f"as far as photos tell, the camera only turned or zoomed at one place: that shows no depth; {ASIDE}"
        )
    if not placement.shows_depth:
        raise InputError(f"the camera hardly moved, or only turned ({within}, {loose}): that shows no depth; {ASIDE}")


def check_enough(names: Mapping[str, str], placement: Placement) -> None:
    """InputError where under two thirds of photos were placed, naming neighbours that are likely too far apart."""
    order = sorted(names, key=names.__getitem__)
    right = placement.right
    if len(right) >= ENOUGH * len(order):
        return
    gaps = [f"{names[a]} and {names[b]}" for a, b in pairwise(order) if not {a, b} <= right]
    more = f" and {len(gaps) - MOST_NAMED} more pairs" if len(gaps) > MOST_NAMED else ""
    said = f"only {len(right)} of {len(order)} photos could be placed"
    apart = f"too far apart, or too little alike, are {', '.join(gaps[:MOST_NAMED])}{more}"
    raise InputError(f"{said}; {apart}: take photos 3° to 10° apart between them; {ASIDE}")


def unplaced(frames: Sequence[tuple[float, bool]]) -> str:
    """What to film where few frames could be placed.

    Args:
        frames: when each is shown, seconds, and whether it was placed.
    """
    runs = [(is_placed, [time for time, _ in run]) for is_placed, run in groupby(frames, key=lambda frame: frame[1])]
    longest = max((times for is_placed, times in runs if not is_placed), key=lambda times: times[-1] - times[0])
    count = sum(is_placed for _, is_placed in frames)
    span = f"none from {longest[0]:.1f} s to {longest[-1]:.1f} s" if longest[0] < longest[-1] else "one here and there"
    said = f"only {count} of {len(frames)} frames could be placed, {span}"
    return f"{said}: film slowly, in good light, what has texture; {ASIDE}"


def remarks(names: Mapping[str, str], placement: Placement, what: str) -> Iterator[str]:
    """What is to be said of photos, whose own names are given, that were left out or lie uncertain."""
    missing = [own for name, own in names.items() if name not in placement.right | placement.wrong]
    wrong = [own for name, own in names.items() if name in placement.wrong]
    if missing or wrong:
        why = []
        if missing:
            groups = ", ".join(map(str, placement.others[:4])) + (", …" if len(placement.others) > 4 else "")
            count = f"{len(placement.others)} groups" if len(placement.others) > 1 else "one group"
            joined = f" ({count} of them, of {groups}, fit each other alone)" if groups else ""
            why.append(f"{', '.join(missing)} could not be placed{joined}")
        if wrong:
            why.append(f"{', '.join(wrong)} lie elsewhere than their matches say")
        yield f"{_of(len(missing) + len(wrong), len(names), what, 'left out')}: {'; '.join(why)}"
    if placement.uncertain:
        said = _of(len(placement.uncertain), len(placement.right), "place", "uncertain")
        most = names[placement.uncertain[0]]
        yield f"{said}, {most} the most: step aside where you only turned, and take more photos"


def _of(count: int, all_of: int, what: str, how: str) -> str:
    """How many of so many things are how."""
    return f"{count} of {all_of} {what}{'s' if all_of > 1 else ''} {'is' if count == 1 else 'are'} {how}"
