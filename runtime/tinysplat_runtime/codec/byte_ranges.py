"""Ranges of a file's bytes: of one on this machine, at an http address, or wherever fsspec reaches."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from http import HTTPStatus
from pathlib import Path
from typing import IO, TYPE_CHECKING, Protocol

from ..errors import InputError
from ..system.files import StrPath, check_readable

if TYPE_CHECKING:
    from http.client import HTTPResponse

TIMEOUT_S, SLOWEST = 20.0, 1 << 12
"""How long a server may say nothing, and bytes per second that it sends on average after so long."""

_AT_A_TIME, _MOST_REDIRECTS = 8, 5
_REDIRECTS = (301, 302, 303, 307, 308)


class Ranges(Protocol):
    """Where a file's bytes come from."""

    def read(self, ranges: Sequence[tuple[int, int]]) -> list[bytes]:
        """The bytes of each (first byte, length), fewer where the file ends before."""

    def close(self) -> None:
        """Let go of what is open."""


def ranges_of(source: StrPath | IO[bytes], timeout_s: float = TIMEOUT_S) -> Ranges:
    """Where to read bytes of a path, an address with `://`, or an open binary file.

    Args:
        source: where.
        timeout_s: how long a web server may say nothing.

    Raises:
        InputError: there is no such file, it cannot be read, or fsspec is missing for an address.
    """
    if isinstance(source, (str, os.PathLike)):
        place = os.fspath(source)
        if "://" in place:
            return _FromHttp(place, timeout_s) if _is_web(place) else _FromUrl(place)
        check_readable(source)
        return _FromFile(Path(source).open("rb"), is_own=True)
    if not (callable(getattr(source, "seek", None)) and callable(getattr(source, "read", None))):
        raise InputError(f"{type(source).__name__}, expected a path, an address or an open binary file", where="source")
    return _FromFile(source, is_own=False)


def _is_web(place: str) -> bool:
    """Whether a web server is asked for it."""
    return place.lower().startswith(("http://", "https://"))


class _FromFile:
    """A binary file that can seek; closed with its reader only if that opened it."""

    def __init__(self, file: IO[bytes], *, is_own: bool) -> None:
        self._file, self._is_own = file, is_own

    def read(self, ranges: Sequence[tuple[int, int]]) -> list[bytes]:
        found = []
        for start, length in ranges:
            self._file.seek(start)
            found.append(self._file.read(length))
        return found

    def close(self) -> None:
        if self._is_own:
            self._file.close()


class _FromHttp:
    """A file on a web server, none of whose answers is believed: it says which bytes it sends, and sends no more."""

    def __init__(self, url: str, timeout_s: float) -> None:
        self._url, self._timeout_s = url, timeout_s

    def read(self, ranges: Sequence[tuple[int, int]]) -> list[bytes]:
        with ThreadPoolExecutor(_AT_A_TIME) as pool:
            return list(pool.map(self._range, ranges))

    def _range(self, wanted: tuple[int, int]) -> bytes:
        from http.client import HTTPException

        start, length = wanted
        try:
            with self._opened(start, length) as answer:
                if answer.status == HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE:  # the file ends before
                    return b""
                expected = self._announced(answer, start, length)
                data = _body(answer, expected + 1, self._timeout_s)
        except TimeoutError:
            slow = f"the server says nothing for {self._timeout_s:g} s, or sends less than {SLOWEST} bytes a second"
            raise self._refused(slow) from None
        except (OSError, ValueError, HTTPException) as error:
            raise self._refused(f"cannot be read ({str(error)[:120] or type(error).__name__})") from None
        if len(data) != expected:
            found = "more" if len(data) > expected else f"{len(data)}"
            raise self._refused(f"the server sends {found} bytes where it announces {expected}")
        return data

    def _opened(self, start: int, length: int) -> HTTPResponse:
        """The answer to a request, that of where it redirects to included; no body is read yet."""
        from urllib.error import HTTPError, URLError
        from urllib.parse import urljoin
        from urllib.request import HTTPRedirectHandler, Request, build_opener

        class NoRedirects(HTTPRedirectHandler):  # urllib's own reads their bodies whole, however long they are
            def redirect_request(self, *_: object) -> None:
                return None

        opener, place = build_opener(NoRedirects), self._url
        headers = {"Range": f"bytes={start}-{start + length - 1}", "Accept-Encoding": "identity"}
        for _ in range(_MOST_REDIRECTS + 1):
            try:
                answer: HTTPResponse = opener.open(Request(place, headers=headers), timeout=self._timeout_s)
                return answer
            except HTTPError as error:
                if error.code == HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE:
                    return error  # type: ignore[return-value]  # which answers like a response
                error.close()
                place = urljoin(place, error.headers.get("Location") or "")
                if error.code not in _REDIRECTS or not _is_web(place):
                    raise self._refused(f"the server answers {error.code} {error.reason}") from None
            except URLError as error:
                raise error.reason if isinstance(error.reason, OSError) else OSError(str(error.reason)) from None
        raise self._refused(f"the server redirects more than {_MOST_REDIRECTS} times")

    def _announced(self, answer: HTTPResponse, start: int, length: int) -> int:
        """How many bytes come, by status and Content-Range."""
        if answer.status != HTTPStatus.PARTIAL_CONTENT:
            what = "the server gives no ranges of a file, which reading it in parts needs"
            raise self._refused(f"{what} (answer {answer.status}, expected 206); download it and open the copy")
        stated = str(answer.headers.get("Content-Range", ""))
        match = re.fullmatch(r"bytes (\d{1,15})-(\d{1,15})/(\d{1,15}|\*)", stated.strip())
        first, last = (int(match[1]), int(match[2])) if match else (-1, -1)
        sent = last - first + 1
        ends_there = match is not None and match[3] in ("*", str(last + 1))
        if first != start or not 0 < sent <= length or (sent < length and not ends_there):
            asked = f"bytes {start}-{start + length - 1}"
            raise self._refused(f"the server sends Content-Range '{stated[:60]}' where {asked} were asked for")
        return sent

    def _refused(self, message: str) -> InputError:
        return InputError(message, where=self._url)

    def close(self) -> None:
        """Nothing is open."""


def _body(answer: HTTPResponse, most: int, timeout_s: float) -> bytes:
    """What comes, up to so many bytes; TimeoutError where it takes too long."""
    data, end = bytearray(), time.monotonic() + timeout_s + most / SLOWEST
    while len(data) < most and (part := answer.read1(most - len(data))):
        data += part
        if time.monotonic() > end:
            raise TimeoutError
    return bytes(data)


class _FromUrl:
    """A file that fsspec reaches: s3, gs and others."""

    def __init__(self, url: str) -> None:
        try:
            import fsspec
        except ImportError:
            raise InputError("fsspec reads addresses; pip install fsspec brings it", where=url) from None
        self._url = url
        try:
            self._files, self._path = fsspec.core.url_to_fs(url)
        except (ImportError, ValueError) as error:
            raise InputError(str(error).splitlines()[0], where=url) from None

    def read(self, ranges: Sequence[tuple[int, int]]) -> list[bytes]:
        starts, ends = [start for start, _ in ranges], [start + length for start, length in ranges]
        try:
            paths = [self._path] * len(ranges)
            found = [bytes(part) for part in self._files.cat_ranges(paths, starts, ends, on_error="raise")]
        except Exception as error:  # of as many kinds as there are ways to reach a file
            raise InputError(f"{type(error).__name__}: {error}".splitlines()[0], where=self._url) from None
        for part, (_, length) in zip(found, ranges, strict=True):
            if len(part) > length:
                raise InputError(f"{len(part)} bytes come where {length} were asked for", where=self._url)
        return found

    def close(self) -> None:
        """Nothing is open."""
