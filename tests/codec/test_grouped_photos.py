"""Mode photos of more photos than a network takes: groups travel with the file."""

import numpy as np
import pytest
from scenes import refusing, write_scene
from sections import changed_section

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


FIRST, SECOND = (100, 101, 102, 103), (104, 105, 106, 107)


def with_groups(file: bytes, *groups: tuple[int, ...], tail: int = 0) -> bytes:
    """The file with groups of such numbers; those from 100 on are kept, of the view 100 less."""

    def change(text: bytearray) -> None:
        text[P.PHOTOS_FIXED.size - 2 :] = len(groups).to_bytes(2, "little")
        for group in groups:
            text += P.GROUP_FIXED.pack(len(group))
            text += b"".join(P.GROUP_VIEW.pack(v - 100 + P.KEPT if v >= 100 else v) for v in group)
        text[len(text) + tail if tail < 0 else len(text) :] = bytes(max(tail, 0))

    return changed_section(file, P.PHOTOS, change)


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
    data = with_groups(file, FIRST, SECOND)
    other = RUNTIME.decompress(data)
    assert groups_in(data) == tuple(regrouped)
    assert (other.means != decoded.means).any()


HOSTILE = {
    "a view that is not there": (FIRST, (104, 105, 106, 107, 108)),
    "views out of order": (FIRST, (105, 104, 106, 107)),
    "a view twice in a group": (FIRST, (4, 104, 105, 106, 107)),
    "a view that two groups keep": (FIRST, (103, *SECOND)),
    "a view that none keeps": (FIRST, (4, 105, 106, 107)),
    "a group that keeps none": (FIRST, (1, 2), SECOND),
    "an empty group": (FIRST, (), SECOND),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_groups_are_format_errors(file: bytes, case: str) -> None:
    with refusing(FormatError, "PHOT[0]"):
        read_container(with_groups(file, *HOSTILE[case]))


@pytest.mark.parametrize("tail", [-1, 1])
def test_groups_end_with_their_section(file: bytes, tail: int) -> None:
    with refusing(FormatError, "PHOT[0]"):
        read_container(with_groups(file, FIRST, SECOND, tail=tail))
