"""Arrays of many views lie on disk: they are arrays like others, of which memory holds what is worked on."""

import shutil
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tinysplat_runtime.system import disk

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="arrays lie on disk on Linux alone")

SHAPE = (16, 1024, 512)
BYTES = 4 * 16 * 1024 * 512


def resident() -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(1024 * int(line.split()[1]) for line in lines if line.startswith("VmRSS"))


@pytest.fixture
def until() -> Callable[..., None]:
    def wait(holds: Callable[[], bool]) -> None:
        deadline = time.monotonic() + 30
        while not holds() and time.monotonic() < deadline:
            time.sleep(0.01)
        assert holds()

    return wait


def watched() -> bool:
    return any(thread.name == disk.WATCHER for thread in threading.enumerate())


def descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


@pytest.mark.parametrize("shape", [SHAPE, (2, 1024, 512), (16, 8, 8)])
def test_arrays_keep_what_is_written(shape: tuple[int, ...]) -> None:
    array, wanted = disk.zeros(shape, np.uint16), np.random.default_rng(0).integers(0, 1 << 16, shape)
    for view, numbers in zip(array, wanted, strict=True):
        view[:] = numbers
    assert array.shape == shape and (array == wanted).all()


@pytest.mark.parametrize("shape", [(2, 3, 4), SHAPE])
def test_numbers_are_chosen_view_by_view(shape: tuple[int, ...]) -> None:
    array = np.random.default_rng(0).standard_normal(shape, np.float32)
    assert (disk.chosen(array, lambda view: array[view] > 0) == array[array > 0]).all()


@on_linux
def test_memory_holds_a_share_of_what_is_worked_on_and_nothing_is_lost(until: Callable[..., None]) -> None:
    before, arrays = resident(), [disk.zeros(SHAPE) for _ in range(3 * disk.HELD_BYTES // BYTES)]
    for number, array in enumerate(arrays):
        for view in array:
            view += number
    until(lambda: resident() - before < disk.HELD_BYTES)
    assert all(float(array[::5].min()) == number == float(array.max()) for number, array in enumerate(arrays))
    until(lambda: resident() - before < disk.HELD_BYTES)


@on_linux
def test_disk_is_given_back_and_shows_no_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, until: Callable[..., None]
) -> None:
    until(lambda: not watched())
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    assert disk.room() == pytest.approx(shutil.disk_usage(tmp_path).free, rel=0.2)  # others write there, too
    opened = descriptors()
    array = disk.zeros(SHAPE)
    assert not list(tmp_path.iterdir())
    del array
    until(lambda: not watched())
    assert descriptors() == opened


@pytest.mark.parametrize("folder", ["missing", "/dev/shm"])  # the latter is memory
def test_where_there_is_no_disk_arrays_lie_in_memory(
    folder: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path / folder))
    array = disk.zeros(SHAPE)
    array[:] = 1
    assert (array == 1).all() and (folder == "missing" or disk.room() == 0)
