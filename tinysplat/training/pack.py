"""Training data as one file: what training reads of scene folders, in a .zip.

python -m tinysplat.training.pack FOLDER -o FILE.zip

Photos and labels of depth are compressed already, so they are stored as they are.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

from tinysplat_runtime.errors import InputError, TinySplatError
from tinysplat_runtime.system.files import write_atomically

MOST_BYTES = 60_000_000
"""Of a packed file, and of what is taken out of one."""

KINDS = frozenset((".jpg", ".jpeg", ".png", ".json"))
"""Files that are packed; others training does not read."""


def pack(folder: Path) -> bytes:
    """The photos, labels and cameras in a folder as the bytes of a .zip; the same bytes for the same files.

    Raises:
        InputError: there is nothing to pack, or more than `MOST_BYTES`.
    """
    paths = [p for p in sorted(folder.rglob("*")) if p.suffix.lower() in KINDS and p.is_file()]
    total = sum(path.stat().st_size for path in paths)
    if not paths or total > MOST_BYTES:
        raise InputError(
            f"{total} bytes of photos, labels and cameras, expected from 1 to {MOST_BYTES}", where=str(folder)
        )
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for path in paths:
            archive.writestr(zipfile.ZipInfo(path.relative_to(folder).as_posix()), path.read_bytes())
    return buffer.getvalue()


@contextlib.contextmanager
def unpacked(path: str) -> Iterator[Path | None]:
    """A folder, or what a .zip holds as a folder for a while; None for an empty path.

    Raises:
        InputError: the .zip is damaged, or holds more than `MOST_BYTES`.
    """
    if not path.endswith(".zip"):
        yield Path(path) if path else None
        return
    try:
        with zipfile.ZipFile(path) as archive, tempfile.TemporaryDirectory() as folder:
            total = sum(entry.file_size for entry in archive.infolist())
            if total > MOST_BYTES:
                raise InputError(f"holds {total} bytes, expected at most {MOST_BYTES}", where=path)
            archive.extractall(folder)  # which leaves out roots and ..
            yield Path(folder)
    except zipfile.BadZipFile as error:
        raise InputError(f"not a .zip ({error})", where=path) from None


def main(arguments: list[str] | None = None) -> int:
    """Pack; 0 when done, 2 when what was given cannot be used."""
    parser = argparse.ArgumentParser(prog="python -m tinysplat.training.pack", description="Pack training data.")
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="of scene folders")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE.zip")
    options = parser.parse_args(arguments)
    try:
        write_atomically(options.output, pack(options.folder))
    except (TinySplatError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
