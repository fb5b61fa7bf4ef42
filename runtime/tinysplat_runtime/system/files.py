"""Whole files in and out: bounded reads, and writes that leave either the complete new file or what stood before.

A file is written under a temporary name in its own folder, flushed to the disk and renamed over its target, so that
neither an error, an interrupt nor a full disk leaves half a file behind. Nothing here knows any format.
"""

import contextlib
import os
import re
from collections.abc import Iterator
from pathlib import Path, PurePosixPath, PureWindowsPath

from ..errors import InputError

StrPath = str | os.PathLike[str]

_NEVER_IN_A_NAME = re.compile(r'[\x00-\x1f\x7f-\x9f<>:"/\\|?*\ud800-\udfff]')
_DEVICES = re.compile(r"(con|prn|aux|nul|conin\$|conout\$|(com|lpt)[0-9\u00b9\u00b2\u00b3])\s*(\..*)?", re.IGNORECASE)
_MAX_NAME_BYTES = 200
"""Of a plain name: what is appended to it stays below the 255 of usual file systems."""


def is_plain_name(name: str) -> bool:
    """Whether `name` is one of a file in its folder on every system: no path, drive, stream, device or hidden file."""
    if not name or name.startswith(".") or name[-1] in ". " or _NEVER_IN_A_NAME.search(name):
        return False
    return not _DEVICES.fullmatch(name) and len(name.encode()) <= _MAX_NAME_BYTES


def stays_inside(name: str) -> bool:
    """Whether a path leads to somewhere in the folder that it is relative to, on every system."""
    return not any(path.anchor or ".." in path.parts for path in (PurePosixPath(name), PureWindowsPath(name)))


def read_limited(path: StrPath, max_bytes: int) -> bytes:
    """Read a regular file whole.

    Raises:
        InputError: the file is missing, not regular, larger than `max_bytes`, or cannot be read.
    """
    path = Path(path)
    check_readable(path)
    try:
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            if size > max_bytes:
                raise InputError(f"{size} bytes, expected at most {max_bytes}", where=str(path))
            return file.read(size)
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror})", where=str(path)) from None


def check_readable(path: StrPath) -> None:
    """Refuse with InputError what is not an existing regular file: opening a pipe, say, would block."""
    path = Path(path)
    if not path.is_file():
        raise InputError("a folder or device, expected a file" if path.exists() else "no such file", where=str(path))


def write_atomically(path: StrPath, data: bytes | memoryview) -> None:
    """Write `data` to `path`, replacing a file of that name only once all of it is on the disk.

    Raises:
        InputError: the folder does not exist, or `path` is a folder or a device.
        OSError: the system refuses (permissions, full disk); names `path`.
    """
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


@contextlib.contextmanager
def atomic_path(path: StrPath) -> Iterator[Path]:
    """Give a temporary path to write to; it becomes `path` when the block ends, or is removed when the block fails.

    The temporary file is empty, lies in the same folder and has the same suffix, for writers that look at it. Its
    permissions are those of any new file. A symbolic link at `path` stays one, and what it points to is replaced.

    Raises:
        InputError: the folder does not exist, or `path` is a folder or a device.
        OSError: the system refuses (permissions, full disk); names `path`.
    """
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise InputError("is a folder, expected the name of a file", where=str(path))
    if target.exists() and not target.is_file():  # renaming over /dev/null would replace it for everyone
        raise InputError("is a device or pipe, expected the name of a file", where=str(path))
    if not target.parent.is_dir():
        raise InputError(f"folder {target.parent} does not exist; create it first", where=str(path))
    temporary = target.with_name(f".tinysplat-{os.urandom(6).hex()}{target.suffix}")
    try:
        os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
        yield temporary
        with temporary.open("r+b") as file:
            os.fsync(file.fileno())
        temporary.replace(target)
        _flush_folder(target.parent)
    except OSError as error:
        # Only what concerns the file being written gets its name: the block may also read other files.
        if error.errno is not None and error.filename in (None, str(temporary), temporary):
            raise OSError(error.errno, os.strerror(error.errno), str(path)) from None
        raise
    finally:
        temporary.unlink(missing_ok=True)


def _flush_folder(folder: Path) -> None:
    """Make the new name itself durable; folders cannot be flushed everywhere (Windows, some network mounts)."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


@contextlib.contextmanager
def parsing(what: str) -> Iterator[None]:
    """Turn what a library raises on damaged bytes, of which there are a dozen types, into an InputError."""
    try:
        yield
    except (InputError, ImportError, PermissionError):
        raise
    except OSError:  # a seek to where nothing is
        raise InputError(f"damaged or foreign {what} (cut short, or it refers to what is not in it)") from None
    except Exception as error:
        raise InputError(f"damaged or foreign {what} ({str(error)[:120] or type(error).__name__})") from None
