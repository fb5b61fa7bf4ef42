"""Files read in parts: only what is wanted is read, and it is what the whole file has."""

from __future__ import annotations

import io
import sys
from dataclasses import replace

import numpy as np
import pytest
from scenes import assert_same, make_smooth_gaussians, refusing
from sections import Pict, sections_of

import tinysplat_runtime as ts
from tinysplat_runtime.codec.byte_ranges import ranges_of
from tinysplat_runtime.codec.parts import SceneFile
from tinysplat_runtime.container.reader import read_container
from tinysplat_runtime.errors import FormatError, InputError
from tinysplat_runtime.gaussian.gaussians import FIELDS
from tinysplat_runtime.graphs.inference import GraphStore

VIEWS = 9


@pytest.fixture(scope="module")
def gaussians():
    return make_smooth_gaussians(VIEWS, 24, 32, degree=1, layers=2).with_notes(ts.Notes(licence="CC0-1.0"))


@pytest.fixture(scope="module")
def data(gaussians):
    return ts.compress(gaussians, profile="fast", qp=-12)


def opened(source: object, **options: int) -> SceneFile:
    """A file whose metadata take several reads, as those of a thousand views."""
    return SceneFile(ranges_of(source), GraphStore(), threads=2, first_bytes=64, **options)


@pytest.mark.parametrize("views", [[0], [7, 2], [1, 8, 3, 4]])
def test_decoding_some_views_gives_what_the_whole_file_has(data, views):
    assert_same(ts.decompress(data, views=views), ts.decompress(data), views)


@pytest.mark.parametrize("options", [{"lossless": True}, {}], ids=["lossless", "few"])
def test_files_that_are_read_as_a_whole_give_views_too(gaussians, options):
    few = ts.Gaussians(**{name: getattr(gaussians, name)[:3] for name in FIELDS}, cameras=gaussians.cameras[:3])
    data = ts.compress(few, **options)
    assert_same(ts.decompress(data, views=[2, 0]), ts.decompress(data), [2, 0])
    with ts.open(io.BytesIO(data)) as file:
        assert file.bytes_read == len(data) and len(file.cameras) == 3
        assert_same(file.views([1, 2]), ts.decompress(data), [1, 2])


def test_gaussians_of_no_pixels_have_no_views(gaussians):
    data = ts.compress(gaussians.flat())
    with pytest.raises(InputError):
        ts.decompress(data, views=[0])
    with pytest.raises(InputError):
        ts.open(io.BytesIO(data))


def test_metadata_and_the_wanted_views_are_all_that_is_read(data, tmp_path):
    path = tmp_path / "f.tsplat"
    path.write_bytes(data)
    sizes = [length for _, length in Pict.of(data).parts]
    whole = ts.decompress(data)
    with opened(path) as file:
        metadata = len(data) - sum(sizes)
        assert file.bytes_read == metadata
        for camera, of_whole in zip(file.cameras, whole.cameras, strict=True):
            np.testing.assert_array_equal(camera.c2w, of_whole.c2w)
            assert (camera.width, camera.height) == (of_whole.width, of_whole.height)
        assert_same(file.views([6, 1]), whole, [6, 1])
        assert file.bytes_read == metadata + sizes[6] + sizes[1]
        assert_same(file.views([1, 3, 6]), whole, [1, 3, 6])
        assert file.bytes_read == metadata + sizes[6] + sizes[1] + sizes[3]


def test_decoded_views_are_kept_within_the_bound_the_last_used_longest(data):
    with opened(io.BytesIO(data)) as file:
        one = file.views([0]).nbytes
    sizes = [length for _, length in Pict.of(data).parts]
    with opened(io.BytesIO(data), cache_bytes=2 * one) as file:

        def read(view: int) -> bool:
            before = file.bytes_read
            file.views([view])
            assert file.bytes_read - before in (0, sizes[view])
            return file.bytes_read > before

        assert [read(view) for view in (0, 1, 0, 2, 0, 1)] == [True, True, False, True, False, True]
    with opened(io.BytesIO(data), cache_bytes=0) as file:
        assert_same(file.views([4, 5]), ts.decompress(data), [4, 5])
        file.views([1])
        before = file.bytes_read
        file.views([4])
        assert file.bytes_read == before + sizes[4]


def test_near_views_are_those_whose_places_and_directions_are_nearest(data, gaussians):
    """By the formula of the page, with the harmonic mean of the depth limits."""
    with ts.open(io.BytesIO(data)) as file:
        limits = [layer.depth_limits for layer in read_container(data).body.layers]
        low, high = min(least for least, _ in limits), max(most for _, most in limits)
        turned = np.diag([-1.0, 1, -1, 1])  # looks the other way: every direction is 2 away
        for c2w in (gaussians.cameras[5].c2w, gaussians.cameras[0].c2w @ turned):
            camera = replace(gaussians.cameras[0], c2w=c2w)
            depth = 2 / (1 / low + 1 / high)
            distances = [
                np.sum(((view.c2w[:3, 3] - c2w[:3, 3]) / depth) ** 2) + np.sum((view.c2w[:3, 2] - c2w[:3, 2]) ** 2)
                for view in gaussians.cameras
            ]
            wanted = sorted(np.argsort(distances, kind="stable")[:3].tolist())
            assert file.nearest(camera, 3) == wanted
            assert_same(file.near(camera, 3), ts.decompress(data), wanted)
        assert len(file.near(camera).cameras) == 4 and file.nearest(camera, 99) == list(range(VIEWS))
        with pytest.raises(InputError) as caught:
            file.near(camera, 0)
        assert caught.value.where == "count"


def test_addresses_are_read_by_ranges(data, monkeypatch):
    fsspec = pytest.importorskip("fsspec", reason="needs the extra 'cluster'")
    fsspec.filesystem("memory").pipe("/walk.tsplat", data)
    with opened("memory://walk.tsplat") as file:
        assert_same(file.views([8]), ts.decompress(data), [8])
        assert file.bytes_read < len(data) / 2
    with refusing(InputError, "memory://no.tsplat"):
        ts.open("memory://no.tsplat")
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(InputError, match="fsspec"):
        ts.open("memory://walk.tsplat")


@pytest.mark.parametrize("source", ["nothing.tsplat", 7, None, [b"bytes"]])
def test_what_cannot_be_read_is_refused_in_one_line(source):
    with pytest.raises(InputError) as caught:
        ts.open(source)
    assert "\n" not in str(caught.value)


def test_damage_is_seen_where_it_is_read(data):
    ends = [prefix["bytes"] for prefix in ts.inspect(data)["prefixes"]]
    damaged = bytearray(data)
    damaged[ends[2] - 3] ^= 1
    with opened(io.BytesIO(bytes(damaged))) as file:
        file.views([0, 1, 3])
        with refusing(FormatError, "view 2"):
            file.views([2])
    with opened(io.BytesIO(data[: ends[3] - 1])) as file:  # a download that stopped
        file.views([0, 2])
        with refusing(FormatError, "view 3"):
            file.views([3])
    metadata = len(data) - len(sections_of(data)[-1][3])
    for length in (0, 5, 19, 30, 200, metadata - 1):
        with pytest.raises(FormatError):
            opened(io.BytesIO(data[:length]))
    altered = bytearray(data)
    altered[60] ^= 1
    with pytest.raises(FormatError):
        opened(io.BytesIO(bytes(altered)))


def test_a_table_that_announces_more_than_memory_holds_is_refused_before_it_is_read(data):
    lies = bytearray(data)
    huge = bytes(lies[:28]) + b"\xff\xff\xff\xff" + bytes(lies[32:])
    count = len(sections_of(bytes(lies)))
    from zlib import crc32

    head = huge[:16] + crc32(huge[20 : 20 + 16 * count], crc32(huge[:16])).to_bytes(4, "little") + huge[20:]
    with pytest.raises(FormatError):
        ts.open(io.BytesIO(head))


def test_targets_are_met_over_all_views_and_files_like_others_keep_their_pictures(gaussians, data):
    """Both ways of coding that read a file back: of a file in parts by view they find the same."""
    wanted = len(data) * 3 // 4
    sized = ts.compress(gaussians, profile="fast", target_size=wanted)
    assert 0.95 * wanted <= len(sized) <= wanted and len(ts.decompress(sized).cameras) == VIEWS
    again = ts.compress(ts.decompress(data), like=data)
    assert sections_of(again)[-1] == sections_of(data)[-1]


def test_files_that_were_opened_are_closed_and_those_given_are_not(tmp_path) -> None:
    (tmp_path / "f").write_bytes(bytes(range(10)))
    own = ranges_of(tmp_path / "f")
    assert own.read([(2, 3), (8, 5)]) == [b"\2\3\4", b"\x08\x09"]
    own.close()
    with pytest.raises(ValueError):
        own.read([(0, 1)])
    with (tmp_path / "f").open("rb") as file:
        given = ranges_of(file)
        given.close()
        assert given.read([(9, 1)]) == [b"\x09"]
