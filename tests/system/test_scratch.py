"""Arrays of many views lie on disk: they are arrays like others, of which memory holds what is worked on."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from tinysplat_runtime.system import scratch

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="arrays lie on disk on Linux alone")

SHAPE = (16, 1024, 512)
BYTES = 4 * 16 * 1024 * 512


def resident() -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(1024 * int(line.split()[1]) for line in lines if line.startswith("VmRSS"))


def descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


@pytest.mark.parametrize("shape", [SHAPE, (2, 1024, 512), (16, 8, 8)])
def test_arrays_keep_what_is_written(shape: tuple[int, ...]) -> None:
    array, wanted = scratch.zeros(shape, np.uint16), np.random.default_rng(0).integers(0, 1 << 16, shape)
    for view, numbers in zip(scratch.by_view(array), wanted, strict=True):
        view[:] = numbers
    scratch.set_aside(array, array[1:, ::2])
    with scratch.passing(array):
        assert array.shape == shape and (array == wanted).all()


@on_linux
def test_what_is_set_aside_takes_no_memory() -> None:
    before = resident()
    array = scratch.zeros(SHAPE)
    array[:] = 1
    assert resident() - before > 0.9 * BYTES
    scratch.set_aside(array[3])
    assert resident() - before < 0.1 * BYTES
    assert sum(float(view.sum()) for view in scratch.by_view(array)) == array.size
    assert resident() - before < 0.2 * BYTES


@on_linux
def test_a_shelf_holds_what_was_taken_last_and_loses_nothing() -> None:
    before, array = resident(), scratch.zeros(SHAPE)
    shelf = scratch.Shelf(BYTES // 4)
    for view, part in enumerate(array):
        part[:] = view
        shelf.put(view, part)
    assert 0.1 * BYTES < resident() - before < 0.35 * BYTES
    for together in ((3, 9), tuple(range(8)), (1, 15)):  # the second are more than it keeps
        shelf.take(together)
        assert all((array[view] == view).all() for view in together)
    assert resident() - before < 0.6 * BYTES
    shelf.take((5,))
    assert resident() - before < 0.35 * BYTES


def test_a_shelf_leaves_arrays_in_memory_alone() -> None:
    shelf, array = scratch.Shelf(0), scratch.zeros((2, 64, 64), views=2)
    array[:] = 1
    shelf.put("mine", array)
    shelf.take(("yours",))
    assert (array == 1).all()


@on_linux
def test_disk_is_given_back_and_shows_no_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    assert scratch.room() == pytest.approx(shutil.disk_usage(tmp_path).free, rel=0.2)  # others write there, too
    opened = descriptors()
    array = scratch.zeros(SHAPE)
    assert not list(tmp_path.iterdir())
    del array
    assert descriptors() == opened


@pytest.mark.parametrize("folder", ["missing", "/dev/shm"])  # the latter is memory
def test_where_there_is_no_disk_arrays_lie_in_memory(
    folder: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path / folder))
    array = scratch.zeros(SHAPE)
    array[:] = 1
    scratch.set_aside(array)
    assert (array == 1).all() and (folder == "missing" or scratch.room() == 0)
