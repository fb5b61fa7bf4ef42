"""A `.tsplat` file read in parts: its metadata once, and of its views those that are wanted.

A walk through a capture of hundreds of views needs a few of them at a time. Of a file in parts by view
(docs/FORMAT.md, "Parts by view"), `SceneFile` reads the bytes of the wanted ones alone, decodes them, and keeps what
was used last within a bound; other files are read as a whole. Bytes come from anything that gives ranges of them.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from functools import partial
from types import TracebackType

import numpy as np

from ..container.limits import Limits
from ..container.reader import check_views, read_container, read_outline
from ..container.sections import metadata_range, table_end
from ..errors import FormatError, InputError, check_is
from ..gaussian.editing import select_views
from ..gaussian.gaussians import Gaussians, joined
from ..graphs.inference import GraphStore
from ..scene.cameras import Camera
from ..scene.neighbours import NEAR, nearest_views
from .byte_ranges import Ranges
from .decoder import decode_file

FIRST_BYTES = 1 << 16
"""Read at first: metadata of up to some 400 views in one request."""

MAX_AT_ONCE = 1 << 31
"""Most bytes of metadata, or of a file that is read as a whole."""

CACHE_BYTES = 1 << 30
"""Decoded views that are kept: some 40 of 256×256 pixels in two layers of SH degree 4."""


class SceneFile:
    """A file of which views are decoded as they are wanted; a context manager that closes what it opened.

    Attributes:
        cameras: one per view of the file.
        bytes_read: so far.
    """

    def __init__(
        self,
        source: Ranges,
        store: GraphStore,
        *,
        threads: int,
        limits: Limits | None = None,
        model: str | None = None,
        cache_bytes: int | None = None,
        first_bytes: int = FIRST_BYTES,
    ) -> None:
        """Read the metadata.

        Args:
            source: the file's bytes; closed where that fails.
            store, threads, model: as for `decode_file`.
            limits: what to accept.
            cache_bytes: most memory of decoded views that are kept, None for `CACHE_BYTES`; a call can take more for
                what it returns.
            first_bytes: read at first, of which the metadata may take more or less.

        Raises:
            FormatError: damaged, foreign or beyond the limits.
        """
        self._source, self._limits = source, limits
        self._cache_bytes = CACHE_BYTES if cache_bytes is None else cache_bytes
        self._decode = partial(decode_file, store=store, threads=threads, model=model)
        self.bytes_read = 0
        self._cached: OrderedDict[int, Gaussians] = OrderedDict()
        self._last: tuple[tuple[int, ...], Gaussians] | None = None
        try:
            self._begin(first_bytes)
        except BaseException:
            source.close()
            raise

    def _begin(self, first_bytes: int) -> None:
        self._data, end = self._metadata(first_bytes)
        outline = read_outline(self._data)
        self._is_divided = outline is not None
        if outline:
            self.cameras, self._depths, self._ranges = outline.cameras, outline.depth_limits, outline.ranges
        else:
            self._data = self._up_to(self._data, end + 1)  # a byte more: none may follow the last section
            whole = self._decode(read_container(self._data, self._limits))
            if not whole.is_per_pixel:
                raise InputError("a file that holds a list has no views to choose from", where="file")
            self.cameras, self._depths = whole.cameras, _depths(whole)
            self._whole = whole

    def __repr__(self) -> str:
        return f"SceneFile({len(self.cameras)} views, {self.bytes_read} bytes read)"

    def __enter__(self) -> SceneFile:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Close the file, and let go of decoded views."""
        self._source.close()
        self._cached.clear()
        self._last = None

    def views(self, indices: Sequence[int]) -> Gaussians:
        """The Gaussians of some views, in this order, with their cameras.

        Raises:
            FormatError: a view is damaged, or the file ends before it.
            InputError: they are not different views of the file.
        """
        wanted = check_views(indices, len(self.cameras))
        if self._last is not None and self._last[0] == wanted:
            return self._last[1]
        if not self._is_divided:
            found = select_views(self._whole, wanted)
        else:
            held = {view: self._cached[view] for view in wanted if view in self._cached}
            missing = [view for view in wanted if view not in held]
            held |= dict(zip(missing, self._fetched(missing), strict=True))
            found = _joined([held[view] for view in wanted])
            for view in wanted:
                self._cached[view] = held[view]
                self._cached.move_to_end(view)
            self._shrink()
        self._last = wanted, found
        return found

    def near(self, camera: Camera, count: int = NEAR) -> Gaussians:
        """The Gaussians of the views nearest to a camera, those of least number first.

        Places and directions count alike: d² = |c₁ − c₂|²/D² + |a₁ − a₂|², D the harmonic mean of the depths.

        Raises:
            InputError: a count below 1.
        """
        return self.views(self.nearest(camera, count))

    def nearest(self, camera: Camera, count: int = NEAR) -> list[int]:
        """Which views those are, rising; all where there are no more."""
        check_is(camera, Camera, "camera", "a Camera")
        if not isinstance(count, int) or count < 1:
            raise InputError(f"{str(count)[:40]}, expected a whole number of 1 or more", where="count")
        near, far = self._depths
        return nearest_views(self.cameras, camera, 2 / (1 / near + 1 / far), count)

    def _metadata(self, first_bytes: int) -> tuple[bytes, int]:
        """All bytes before the first picture, and where the file ends."""
        data = self._read([(0, first_bytes)])[0]
        data = self._up_to(data, table_end(memoryview(data)))
        metadata_end, end = metadata_range(memoryview(data))
        return self._up_to(data, metadata_end), end

    def _up_to(self, data: bytes, end: int) -> bytes:
        if end > MAX_AT_ONCE:
            raise FormatError(f"{end} bytes to read at once, at most {MAX_AT_ONCE}", where="section table")
        return data if len(data) >= end else data + self._read([(len(data), end - len(data))])[0]

    def _read(self, ranges: Sequence[tuple[int, int]]) -> list[bytes]:
        found = self._source.read(ranges)
        self.bytes_read += sum(map(len, found))
        return found

    def _fetched(self, views: Sequence[int]) -> list[Gaussians]:
        """Each view by itself, so that what is let go of frees memory."""
        parts = self._read([self._ranges[view] for view in views]) if views else []
        return [
            self._decode(read_container(self._data, self._limits, views=[view], fetched={view: part}))
            for view, part in zip(views, parts, strict=True)
        ]

    def _shrink(self) -> None:
        total = sum(gaussians.nbytes for gaussians in self._cached.values())
        while self._cached and total > self._cache_bytes:
            total -= self._cached.popitem(last=False)[1].nbytes


def _depths(gaussians: Gaussians) -> tuple[float, float]:
    """Least and largest z of layer 0 in front of its cameras."""
    depths = []
    for camera, means in zip(gaussians.cameras, gaussians.means, strict=True):
        z = (means + (gaussians.origin - camera.centre)) @ camera.rotation[2]
        depths += [z[z > 0].min(initial=np.inf), z.max()]
    low, high = min(depths), max(depths)
    return (float(low), float(high)) if 0 < low <= high < np.inf else (1.0, 1.0)


def _joined(views: Sequence[Gaussians]) -> Gaussians:
    """The views of one file as one object."""
    if len(views) == 1:
        return views[0]
    layers = []
    for parts in zip(*(view.layers for view in views), strict=True):
        cameras = tuple(camera for part in parts for camera in part.cameras)
        layers.append(Gaussians.unchecked(**joined(parts), cameras=cameras, origin=views[0].origin))
    return Gaussians.stacked(layers).with_notes(views[0].notes)
