"""Seconds left that a run announces, by clocks of our own: within a factor of 1.5 of what it takes, from the second
tenth of the way on, whatever the machine is like.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from tinysplat.commands.compare import STEPS as COMPARING
from tinysplat.poses.placing import ahead as ahead_of_poses
from tinysplat_runtime.recipe.encode import AGREED, CHECKS, COMPARED
from tinysplat_runtime.recipe.kinds import CODED, LISTED, TRAINED
from tinysplat_runtime.system.course import Course

FACTOR = 1.5

NETWORK = [("opening the network", 2.0), ("depth of photos", 12.0), ("agreeing on depth", 20.0)]
NETWORK += [("Gaussians of photos", 11.0)]


@dataclass(frozen=True)
class Step:
    """A stage of a run, in seconds of a machine of two cores: each of its items, what comes before and after these."""

    label: str
    items: Sequence[float] = ()
    before: float = 0.0
    after: float = 0.0
    costs: Sequence[float] | None = None


@dataclass(frozen=True)
class Run:
    """What is planned, and what comes of it."""

    plan: list[tuple[str, float]]
    steps: list[Step]


def photos(count: int, each: float) -> list[float]:
    """Seconds of photos, which differ."""
    return (each * np.exp(np.random.default_rng(count).normal(0, 0.3, count))).tolist()


def to_gaussians(count: int, each: float) -> list[Step]:
    """Of so many photos; `each` for the depth of one."""
    return [
        Step("checking photos", photos(count, each / 20)),
        Step("checking cameras", [0.1 * each * count / 2, 0, 0, 0.05 * each * count, *[0] * 5]),
        Step("opening the network", after=1.2),
        Step("depth of photos", [3 * each, *photos(count - 1, 0.9 * each)], after=count * each / 8),
        Step("agreeing on depth", [count * each * part for part in (0.35, 0.35, 0.35, 0.35, 0.2)]),
        Step("Gaussians of photos", photos(count, 0.65 * each)),
    ]


def capture(count: int, each: float) -> Run:
    """`--fast`."""
    steps = [
        *to_gaussians(count, each),
        Step("comparing neighbours", photos(count, each / 8)),
        Step("planning", after=count * each / 9),
        Step("coding planes", photos(16 * count, each / 24)),
        Step("comparing photos", photos(8, 0.55 * each), before=0.3),
    ]
    return Run([*CHECKS, *NETWORK, *AGREED, *CODED, *COMPARED], steps)


def listed(count: int, each: float) -> Run:
    """By default."""
    steps, costs = max(800, 50 * count), []
    for share, cost in ((0.1, 1.0), (0.3, 1.5), (0.6, 3.0)):
        costs += [cost] * round(share * steps)
    train = [0.06 * each * cost for cost in costs]
    compared = Step("comparing photos", photos(8, each / 6), before=0.1)
    after = [Step("training", train, after=each * 2, costs=costs), *coded_list(count * each), compared]
    plan = [*CHECKS, *NETWORK, ("training", TRAINED * steps / count), *LISTED, *COMPARED]
    return Run(plan, [*to_gaussians(count, each), *after])


def coded_list(whole: float) -> list[Step]:
    """`compress` of a list, in about so many seconds and a half."""
    return [
        Step("looking at views", photos(28, whole / 72), before=whole / 12),
        Step("pruning", [whole / 16] * 4, after=whole * 0.3),
        Step("correcting", photos(100, whole * 0.7 / 100)),
        *[Step("ranking", [whole / 60] * count) for count in (9, 6, 3)],
        Step("coding", photos(8, whole / 40), before=whole / 10),
        Step("measuring", after=whole / 20),
    ]


def view(whole: float) -> Run:
    """Of a list in another format, coded for the page."""
    return Run(LISTED, [*coded_list(whole), Step("decoding pictures", [0.1] * 10)])


def compare(count: int, each: float) -> Run:
    """Pictures of two files, of which one is a capture."""
    steps = [
        Step("decoding pictures", [0.01] * 48, before=0.5),
        Step("decoding pictures", [0.02] * 10),
        Step("drawing", photos(count, each), before=0.5),
        Step("writing sheets", photos(3, count * each / 6)),
        Step("measuring", photos(count, each / 4)),
    ]
    return Run(COMPARING, steps)


def poses(count: int, pairs: int, pixels: int, seconds: Sequence[float]) -> Run:
    """Of photos and pairs of so many pixels, and what features, a pair, placing and distortion take of one."""
    feature, pair, place, distortion = seconds
    steps = [
        Step("copying photos", [0.0] * count, after=0.3),
        Step("features of photos", photos(count, feature)),
        *([Step("choosing pairs of photos", [0.004 * k for k in range(count)], costs=range(count))] * (count > 40)),
        Step("matching pairs of photos", photos(pairs, pair)),
        Step("placing photos", [place * (0.7 + 0.6 * number / count) for number in range(count)], after=pairs / 1000),
        Step("taking distortion out", photos(count, distortion)),
    ]
    return Run(ahead_of_poses(count, pairs, pixels), steps)


def one_stage(count: int, each: float) -> Run:
    """What is not planned, such as a video's pictures, of which the first loads something."""
    return Run([], [Step("render", [4 * each, *photos(count - 1, each)])])


UNCOUNTED = {"pruning"}


def announced(run: Run, load: Callable[[float], float]) -> Iterator[tuple[float, float, float | None]]:
    """Moments of a run: seconds so far, share of its work that is done, seconds left as announced.

    Args:
        run: see there.
        load: what seconds of work take, by the share that is done.
    """
    whole = sum(sum(step.items) + step.before + step.after for step in run.steps)
    now, done = [0.0], [0.0]
    course = Course(lambda: now[0])
    course.plan(run.plan)

    def work(seconds: float) -> Iterator[tuple[float, float, float | None]]:
        for _ in range(pieces := max(round(200 * seconds / whole), 1)):
            now[0] += seconds / pieces * load(done[0] / whole)
            done[0] += seconds / pieces
            yield now[0], done[0] / whole, course.left

    for step in run.steps:
        yield from work(step.before)
        total = None if step.label in UNCOUNTED else len(step.items)
        stage = course.begin(step.label, total if step.items else None, step.costs)
        for item in step.items:
            yield from work(item)
            stage.next()
        stage.is_over = True
        yield from work(step.after)


RUNS = {
    "12 photos": capture(12, 0.3),
    "24 large photos": capture(24, 1.1),
    "48 photos": capture(48, 0.3),
    "list of 12": listed(12, 0.3),
    "list of 24": listed(24, 0.6),
    "poses of 24 small photos": poses(24, 276, 455 * 256, (0.09, 0.006, 0.044, 0.026)),
    "poses of 54 small photos": poses(54, 349, 455 * 256, (0.09, 0.006, 0.046, 0.024)),
    "poses of 10 large photos": poses(10, 45, 3840 * 2160, (0.5, 0.019, 0.1, 0.61)),
    "view of a list": view(12.0),
    "compare": compare(23, 0.25),
    "pictures": one_stage(24, 0.5),
}


@pytest.mark.parametrize("speed", [0.2, 1.0, 7.0])
@pytest.mark.parametrize("name", RUNS)
def test_what_is_announced_is_what_it_takes(name: str, speed: float) -> None:
    told = list(announced(RUNS[name], lambda done: speed))
    taken = told[-1][0]
    for now, _, left in told:
        if 0.2 * taken <= now and (left is not None or now <= 0.95 * taken):
            assert left is not None
            assert taken / FACTOR <= now + left <= FACTOR * taken, f"{now:.1f} of {taken:.1f} s, {left:.1f} left"


@pytest.mark.parametrize("change", [0.5, 2.0])
@pytest.mark.parametrize("name", RUNS)
def test_a_machine_that_becomes_busy_or_free_is_followed(name: str, change: float) -> None:
    """What nobody can foresee is seen within a tenth of the way."""
    told = list(announced(RUNS[name], lambda done: 1.0 if done < 0.5 else change))
    taken = told[-1][0]
    for now, done, left in told:
        if done >= 0.6 and (left is not None or now <= 0.95 * taken):
            assert left is not None
            assert taken / FACTOR <= now + left <= FACTOR * taken, f"{now:.1f} of {taken:.1f} s, {left:.1f} left"


def test_before_anything_is_done_nothing_is_announced() -> None:
    course = Course(lambda: 0.0)
    course.plan([("depth of photos", 3.0), ("coding planes", 1.0)])
    assert course.left is None
    course.begin("depth of photos", 12)
    assert course.left is None


def test_a_stage_that_is_hardly_anything_of_a_run_does_not_tell_how_long_it_takes() -> None:
    now = 0.0
    course = Course(lambda: now)
    course.plan([("checking photos", 1.0), ("training", 299.0)])
    stage = course.begin("checking photos", 4)
    now = 9.0  # as large photos take
    stage.next()
    assert course.left is None
