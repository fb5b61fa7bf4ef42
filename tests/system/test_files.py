"""Files are read within a limit and appear whole or not at all."""

import errno
import os
import stat
from pathlib import Path

import pytest
from scenes import refusing, tells

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system.files import atomic_path, parsing, read_limited, write_atomically


def test_written_bytes_are_read_back_and_nothing_else_remains(tmp_path: Path) -> None:
    target = tmp_path / "scene.tsplat"
    write_atomically(target, b"first")
    write_atomically(str(target), memoryview(b"second"))
    assert read_limited(target, 6) == b"second"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("failure", [KeyboardInterrupt(), ValueError("mid-way"), InputError("mid-way")])
def test_failed_block_keeps_the_old_file_and_removes_the_temporary(tmp_path: Path, failure: BaseException) -> None:
    target = tmp_path / "a.npz"
    target.write_bytes(b"old")
    with pytest.raises(type(failure)), atomic_path(target) as temporary:
        temporary.write_bytes(b"half")
        raise failure
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("umask", [0o022, 0o077, 0o002])
def test_permissions_are_those_of_any_new_file(tmp_path: Path, umask: int) -> None:
    previous = os.umask(umask)
    try:
        write_atomically(tmp_path / "ours", b"x")
        (tmp_path / "plain").write_bytes(b"x")
    finally:
        os.umask(previous)
    modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("ours", "plain")]
    assert modes[0] == modes[1] == 0o666 & ~umask


def test_symbolic_link_stays_and_its_target_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "real").write_bytes(b"old")
    (tmp_path / "link").symlink_to("real")
    write_atomically(tmp_path / "link", b"new")
    assert (tmp_path / "link").is_symlink() and (tmp_path / "real").read_bytes() == b"new"


def test_targets_that_are_no_file_are_refused_by_name(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for target in (tmp_path, tmp_path / "missing" / "out", tmp_path / "pipe", Path("/dev/null")):
        with pytest.raises(InputError) as caught:
            write_atomically(target, b"x")
        assert caught.value.where == str(target)
    assert Path("/dev/null").is_char_device()


def test_reader_refuses_missing_large_and_irregular_files(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "large").write_bytes(bytes(101))
    for name in ("missing", ".", "pipe", "large"):
        with pytest.raises(InputError) as caught:
            read_limited(tmp_path / name, 100)
        assert caught.value.where == str(tmp_path / name)
    assert "101" in str(caught.value)


def test_unreadable_file_is_an_input_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: Path, *_: object) -> None:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(self))

    (tmp_path / "file").write_bytes(b"x")
    monkeypatch.setattr(Path, "open", refuse)
    with refusing(InputError, str(tmp_path / "file")):
        read_limited(tmp_path / "file", 10)


def test_a_new_file_and_its_name_are_flushed_to_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    flushed = []
    monkeypatch.setattr(os, "fsync", lambda descriptor: flushed.append(os.path.realpath(f"/proc/self/fd/{descriptor}")))
    target, seen = tmp_path / "out", []
    with atomic_path(target) as temporary:
        seen.append(str(temporary))
        temporary.write_bytes(b"x")
    assert flushed == [*seen, str(tmp_path.resolve())]


@pytest.mark.parametrize(
    ("raised", "words"),
    [
        (KeyError("x"), "JPEG 'x'"),
        (ValueError(), "JPEG ValueError"),
        (RuntimeError("y" * 200), "JPEG"),
        (InputError("said well", where="a"), "a: said well"),
    ],
)
def test_what_a_library_raises_on_damaged_bytes_becomes_one_line(raised: Exception, words: str) -> None:
    with pytest.raises(InputError) as caught, parsing("JPEG"):
        raise raised
    assert tells(str(caught.value), words)


@pytest.mark.parametrize("raised", [ModuleNotFoundError("PIL"), PermissionError(errno.EACCES, "no")])
def test_what_no_damage_causes_stays_what_it_is(raised: Exception) -> None:
    with pytest.raises(type(raised)) as caught, parsing("JPEG"):
        raise raised
    assert caught.value is raised
