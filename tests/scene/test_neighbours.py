"""Groups of neighbours: every photo kept once, beside partners about as near as there are, of its own place; and which
photo a view was taken as.
"""

import numpy as np
import pytest
from scenes import camera_at

from tinysplat_runtime.scene.cameras import Camera
from tinysplat_runtime.scene.neighbours import Neighbours, grouped, view_places

NEAR, FAR = 2.0, 6.0


def found(cameras: list[Camera]) -> Neighbours:
    return Neighbours.of(cameras, NEAR, FAR)


def scattered(count: int, seed: int = 0) -> list[Camera]:
    """On a wall of 4 by 4 units, looking about."""
    rng = np.random.default_rng(seed)
    return [camera_at(*rng.uniform(-2, 2, 2), turn=rng.uniform(-0.4, 0.4)) for _ in range(count)]


def test_partners_are_the_nearest_by_brute_force() -> None:
    cameras = scattered(40)
    places = view_places(cameras, NEAR, FAR)
    for v, partners in enumerate(found(cameras).partners):
        distance = np.linalg.norm(places - places[v], axis=1)
        nearest = [int(u) for u in np.argsort(distance) if u != v]
        assert [u for u in nearest if u in partners] == list(partners)
        assert partners[0] == nearest[0]


@pytest.mark.parametrize(("count", "size"), [(7, 4), (24, 4), (25, 3), (60, 4), (24, 2)])
def test_every_photo_is_kept_once_in_a_group_that_suits_it(count: int, size: int) -> None:
    neighbours = found(scattered(count))
    groups = grouped(neighbours, size)
    assert sorted(v for group in groups for v in group.kept) == list(range(count))
    for group in groups:
        assert 2 <= len(group.views) <= size and set(group.kept) <= set(group.views)
        for v in group.kept:
            assert neighbours.cost(v, group.views) <= 2 * neighbours.cost(v, neighbours.own_group(v, size)) + 1e-12


def test_groups_depend_on_no_unit_and_no_order() -> None:
    cameras = scattered(20)
    tenfold = np.array([[1, 1, 1, 10]] * 3 + [[1, 1, 1, 1]])
    larger = [Camera(c.K, tenfold * c.c2w, c.width, c.height) for c in cameras]
    assert grouped(Neighbours.of(larger, 10 * NEAR, 10 * FAR)) == grouped(found(cameras))
    order = np.random.default_rng(1).permutation(20)
    shuffled = grouped(found([cameras[i] for i in order]))
    assert {tuple(sorted(order[list(group.views)])) for group in shuffled} == {
        group.views for group in grouped(found(cameras))
    }


def test_places_that_show_nothing_of_each_other_share_no_group() -> None:
    here = [camera_at(0.2 * i) for i in range(5)]
    there = [camera_at(0.2 * i, turn=np.pi) for i in range(3)]
    neighbours = found([*here, *there, camera_at(500.0)])
    assert neighbours.parts() == [[0, 1, 2, 3, 4], [5, 6, 7], [8]]
    for group in grouped(neighbours):
        assert set(group.views) <= {0, 1, 2, 3, 4} or set(group.views) <= {5, 6, 7}
