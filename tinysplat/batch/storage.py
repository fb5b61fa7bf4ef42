"""Files of a batch: local paths, and URLs such as s3://, gs:// or memory:// through the package fsspec."""

import contextlib
import secrets
import tempfile
from collections.abc import Iterator
from pathlib import Path, PureWindowsPath
from typing import Any

from tinysplat_runtime.errors import InputError
from tinysplat_runtime.system.files import read_limited, write_atomically

MAX_FILE_BYTES = 1 << 31

MAX_FILES, MAX_DEPTH, MAX_SCENE_BYTES = 100_000, 8, 1 << 36
"""What is fetched of a scene at most, whatever a server lists."""


def is_url(place: str) -> bool:
    """Whether `place` names a file system other than this machine's."""
    return "://" in place


def read(place: str) -> bytes | None:
    """A file's bytes; None where there is none."""
    if not is_url(place):
        return read_limited(place, MAX_FILE_BYTES) if Path(place).exists() else None
    filesystem, path = _open(place)
    if not filesystem.isfile(path):
        return None
    with filesystem.open(path, "rb") as file:
        data = bytes(file.read(MAX_FILE_BYTES + 1))
    if len(data) > MAX_FILE_BYTES:
        raise InputError(f"more than {MAX_FILE_BYTES} bytes", where=place)
    return data


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
        InputError: there is nothing at a URL, or its listing leads out of the folder or beyond what scenes have.
    """
    if not is_url(place):
        yield place
        return
    filesystem, path = _open(place)
    if not filesystem.exists(path):
        raise InputError("nothing there", where=place)
    with tempfile.TemporaryDirectory(prefix="tinysplat-") as folder:
        target = Path(folder) / "scene"
        if _is_file(filesystem, path):
            ending = PureWindowsPath(path).suffix  # by which videos and lists of cameras are known
            target = target.with_suffix(ending if ending[1:].isalnum() else "")
            _fetch(filesystem, path, target, MAX_FILE_BYTES)
        else:
            left = MAX_SCENE_BYTES
            for source, name in _listed(filesystem, path.rstrip("/"), place):
                (target / name).parent.mkdir(parents=True, exist_ok=True)
                left -= _fetch(filesystem, source, target / name, min(left, MAX_FILE_BYTES))
        yield str(target)


def _is_file(filesystem: Any, path: str) -> bool:
    """Whether a path is one file; over http, where folders are pages, if its name has an ending."""
    return bool(filesystem.isfile(path)) and ("://" not in path or PureWindowsPath(path).suffix != "")


def _listed(filesystem: Any, root: str, place: str) -> list[tuple[str, str]]:
    """The files below a folder: where each is, and its name in the folder, which no server can lead out of it.

    Raises:
        InputError: a name that leads elsewhere, or more files or deeper folders than a scene has.
    """
    found: list[tuple[str, str]] = []
    for folder, folders, files in filesystem.walk(f"{root}/", maxdepth=MAX_DEPTH + 1, detail=True):
        for source in (entry["name"] for entry in files.values()):
            name = source.removeprefix(root).removeprefix("/")
            parts = name.split("/")
            if not source.startswith(root) or not all(map(_is_one_name, parts)):
                raise InputError(f"the server lists '{source[-60:]}', which is not in the folder", where=place)
            found.append((source, name))
        if len(found) > MAX_FILES or (folders and folder.removeprefix(root).count("/") >= MAX_DEPTH):
            most = f"{MAX_FILES} files in folders {MAX_DEPTH} deep"
            raise InputError(f"the server lists more than a scene has, expected at most {most}", where=place)
    return found


def _is_one_name(part: str) -> bool:
    """Whether a part of a path is the name of something in its folder, on Windows too."""
    return part not in ("", "..") and PureWindowsPath(part).name == part and part.isprintable()


def _fetch(filesystem: Any, source: str, target: Path, most: int) -> int:
    """Copy a file, whatever size a server states; the bytes that it has."""
    done = 0
    with filesystem.open(source, "rb") as remote, target.open("wb") as local:
        while block := remote.read(1 << 20):
            done += len(block)
            if done > most:
                raise InputError(f"more than {most} bytes", where=source)
            local.write(block)
    return done


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
