"""Files of a batch: local paths, and URLs such as s3://, gs:// or memory:// through the package fsspec."""

from __future__ import annotations

import contextlib
import secrets
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system.files import read_limited, write_atomically

MAX_FILE_BYTES = 1 << 31


def is_url(place: str) -> bool:
    """Whether `place` names a file system other than this machine's."""
    return "://" in place


def read(place: str) -> bytes | None:
    """A file's bytes; None where there is none."""
    if not is_url(place):
        return read_limited(place, MAX_FILE_BYTES) if Path(place).is_file() else None
    filesystem, path = _open(place)
    return bytes(filesystem.cat_file(path)) if filesystem.isfile(path) else None


def write(place: str, data: bytes) -> None:
    """Write a file that is complete or not there: by renaming, or as object stores do by themselves."""
    if not is_url(place):
        Path(place).parent.mkdir(parents=True, exist_ok=True)
        write_atomically(place, data)
        return
    filesystem, path = _open(place)
    filesystem.makedirs(path.rpartition("/")[0], exist_ok=True)
    temporary = f"{path}.{secrets.token_hex(4)}"
    filesystem.pipe_file(temporary, data)
    filesystem.mv(temporary, path)


@contextlib.contextmanager
def local_folder(place: str) -> Iterator[str]:
    """A scene's folder or file on this machine, fetched for the time of the block where it is elsewhere.

    Raises:
        InputError: there is nothing at a URL.
    """
    if not is_url(place):
        yield place
        return
    filesystem, path = _open(place)
    if not filesystem.exists(path):
        raise InputError("nothing there", where=place)
    with tempfile.TemporaryDirectory(prefix="tinysplat-") as folder:
        target = Path(folder) / "scene"
        filesystem.get(path.rstrip("/") + "/", str(target) + "/", recursive=True)
        yield str(target)


def join(folder: str, name: str) -> str:
    """`name` in `folder`."""
    return f"{folder.rstrip('/')}/{name}"


def _open(place: str) -> tuple[Any, str]:
    try:
        import fsspec
    except ImportError:
        raise InputError('URLs need fsspec; pip install "tinysplat[cluster]" brings it', where=place) from None
    try:
        filesystem, path = fsspec.core.url_to_fs(place)
    except (ValueError, ImportError) as error:  # an unknown protocol, or one whose package is missing
        raise InputError(" ".join(str(error).split()), where=place) from None
    return filesystem, str(path)
