"""Mode photos of more photos than a network takes: groups travel with the file."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scenes import refusing, write_scene
from sections import file_of, sections_of

import tinysplat_runtime as ts
from tinysplat_runtime.container import photos as P
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.errors import FormatError
from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.scene.neighbours import Group

RUNTIME = ts.Runtime(threads=2)
MODEL = "sweep"
VIEWS = 8


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> ts.Scene:
    return ts.load_scene(write_scene(tmp_path_factory.mktemp("many") / "scene", views=VIEWS, height=32, width=48))


@pytest.fixture(scope="module")
def raw(scene: ts.Scene) -> ts.Gaussians:
    return RUNTIME.predict(scene, MODEL)


@pytest.fixture(scope="module")
def file(scene: ts.Scene) -> bytes:
    return RUNTIME.encode(scene, MODEL, mode="photos")


def groups_in(data: bytes) -> tuple[Group, ...]:
    return read_container(data).body.groups


def test_every_view_of_many_comes_from_a_group_alone(scene: ts.Scene, raw: ts.Gaussians, file: bytes) -> None:
    groups = groups_in(file)
    assert len(groups) > 1
    for group in groups:
        alone = RUNTIME.predict(scene.views(group.views), MODEL)
        for view in group.kept:
            for name in FIELDS:
                np.testing.assert_array_equal(getattr(raw, name)[view], getattr(alone, name)[group.views.index(view)])


def test_a_reader_runs_the_groups_of_the_file(raw: ts.Gaussians, file: bytes) -> None:
    decoded = RUNTIME.decompress(file)
    assert decoded.opacities.shape == raw.opacities.shape and len(decoded.cameras) == VIEWS
    regrouped = [Group(tuple(range(4)), tuple(range(4))), Group(tuple(range(4, VIEWS)), tuple(range(4, VIEWS)))]
    sections = [
        [kind, flags, index, P.group_sections(regrouped)[0].data if kind == P.GROUPS else data]
        for kind, flags, index, data in sections_of(file)
    ]
    other = RUNTIME.decompress(file_of(sections))
    assert groups_in(file_of(sections)) == tuple(regrouped)
    assert (other.means != decoded.means).any()


def test_few_photos_need_no_groups(scene: ts.Scene) -> None:
    data = RUNTIME.encode(scene.views(range(4)), MODEL, mode="photos")
    assert P.GROUPS not in {kind for kind, *_ in sections_of(data)}
    assert groups_in(data) == (Group((0, 1, 2, 3), (0, 1, 2, 3)),)


def words(*groups: tuple[int, ...]) -> Callable[[bytes], bytes]:
    """A section of groups of such numbers; those from 100 on are kept, of the view 100 less."""

    def change(_: bytes) -> bytes:
        rows = [
            P.GROUP_FIXED.pack(len(group))
            + b"".join(P.GROUP_VIEW.pack(v - 100 + P.KEPT if v >= 100 else v) for v in group)
            for group in groups
        ]
        return P.GROUPS_FIXED.pack(len(groups)) + b"".join(rows)

    return change


FIRST, SECOND = (100, 101, 102, 103), (104, 105, 106, 107)

HOSTILE = {
    "a view that is not there": words(FIRST, (104, 105, 106, 107, 108)),
    "views out of order": words(FIRST, (105, 104, 106, 107)),
    "a view twice in a group": words(FIRST, (4, 104, 105, 106, 107)),
    "a view that two groups keep": words(FIRST, (103, *SECOND)),
    "a view that none keeps": words(FIRST, (4, 105, 106, 107)),
    "a group that keeps none": words(FIRST, (1, 2), SECOND),
    "an empty group": words(FIRST, (), SECOND),
    "no groups": words(),
    "cut short": lambda section: section[:-1],
    "too long": lambda section: section + b"\0",
}


@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_groups_are_format_errors(file: bytes, case: str) -> None:
    sections = [
        [kind, flags, index, HOSTILE[case](data) if kind == P.GROUPS else data]
        for kind, flags, index, data in sections_of(file)
    ]
    with refusing(FormatError, "GRPS[0]"):
        read_container(file_of(sections))
