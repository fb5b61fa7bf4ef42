"""Body `Photos`: a network and the photos that it runs on.

Layout: docs/FORMAT.md, sections NETW, GRPS and PHOT. Reading checks every number and length, as reader.py does.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, ClassVar
from zlib import crc32

from ..errors import FormatError
from ..gaussian.planes import MAX_DECODED, MAX_QP
from . import layout as L
from .body import Body, Description, Opened, Piece
from .records import StreamRef, read_streams
from .sections import Cursor, NewSection

if TYPE_CHECKING:  # most files hold no photos
    from ..scene.neighbours import Group

NETWORK = b"NETW"
PHOTOS = b"PHOT"
PHOTO_PICTURES = b"PICS"
GROUPS = b"GRPS"

NETWORK_FIXED = struct.Struct("<32s64sdd")
"""sha256 of the ONNX file, its name (ASCII, zero-padded), near, far in scene units."""

PHOTOS_FIXED = struct.Struct("<IIBBBB")
"""height, width, format, QP, parameter-set index, reserved (0); then per view a STREAM."""

GROUPS_FIXED = struct.Struct("<H")
"""groups; then per group a GROUP_FIXED, and a GROUP_VIEW per view."""

GROUP_FIXED = struct.Struct("<B")
"""views."""

GROUP_VIEW = struct.Struct("<H")
"""bits 0 to 14: the view; KEPT: its Gaussians are taken from this group."""

KEPT = 0x8000

YCC_420_10 = 0
"""Format: BT.709 YCbCr of full range, 4:2:0, 10 bits."""

PHOTO_SIDE_MULTIPLE = 16
PHOTO_PARAMETER_SET = 255
"""Index of the HEVC section that the writer gives to photos; layers count from 0."""


@dataclass(frozen=True)
class NetworkRef:
    """Which network a file needs, and the depth range that it is run with.

    Attributes:
        name: for messages, and to find the file.
        sha256: of the ONNX file, hexadecimal; the network that is run must have it.
        near, far: depths in scene units.
    """

    name: str
    sha256: str
    near: float
    far: float


@dataclass(frozen=True)
class PhotoHeader:
    """Photos of a file: their size, and where their pictures lie in `data`."""

    height: int
    width: int
    qp: int
    parameter_set: int
    streams: tuple[StreamRef, ...]
    data: memoryview

    def payload(self, view: int) -> memoryview:
        """One photo's slice; FormatError if its CRC differs."""
        return self.streams[view].checked(self.data, f"photo {view}")


@dataclass(frozen=True)
class CodedPhotos:
    """Photos ready for the file: parameter sets with start codes, and one slice NAL unit each."""

    height: int
    width: int
    qp: int
    parameter_sets: bytes
    payloads: tuple[bytes, ...]

    def header(self) -> PhotoHeader:
        """The photos as a reader finds them."""
        ends = accumulate(map(len, self.payloads), initial=0)
        streams = tuple(StreamRef(end, len(p), crc32(p)) for end, p in zip(ends, self.payloads, strict=False))
        data = memoryview(b"".join(self.payloads))
        return PhotoHeader(self.height, self.width, self.qp, PHOTO_PARAMETER_SET, streams, data)


@dataclass(frozen=True, kw_only=True)
class Photos(Body):
    """Photos, and the network that the receiver runs on them, all at once or in groups."""

    mode: ClassVar[str] = "photos"
    kinds: ClassVar[frozenset[bytes]] = frozenset(
        {L.CAMERAS, L.PARAMETER_SETS, NETWORK, GROUPS, PHOTOS, PHOTO_PICTURES}
    )
    signs: ClassVar[frozenset[bytes]] = frozenset({NETWORK, GROUPS, PHOTOS, PHOTO_PICTURES})

    network: NetworkRef
    groups: tuple[Group, ...]
    photos: PhotoHeader

    @classmethod
    def read(cls, file: Opened) -> Photos:
        """Parse and check the sections NETW, PHOT and PICS."""
        file.check_counts(has_layers=False)
        network = _read_network(Cursor(file.only(NETWORK)))
        groups = _read_groups(file)
        pictures = file.only(PHOTO_PICTURES)
        photos = _read_photos(Cursor(file.only(PHOTOS)), file.views, pictures.data)
        pixels = file.views * photos.height * photos.width
        if pixels > file.limits.max_pixels:
            found = f"{pixels} pixels of photos, the limit is {file.limits.max_pixels} (--max-pixels)"
            raise FormatError(found, where="section PHOT[0]")
        file.require_parameter_set(photos.parameter_set, "section PHOT[0]")
        return cls(cameras=file.cameras(photos.height, photos.width), network=network, groups=groups, photos=photos)

    def describe(self) -> Description:
        """Network and photos; what only the network knows is left open."""
        photos = self.photos
        size = {"height": photos.height, "width": photos.width, "qp": photos.qp}
        lengths = [stream.length for stream in photos.streams]
        return Description(
            network=asdict(self.network),
            photos={**size, "bytes": len(photos.data), "bytes_by_view": lengths},
            pieces=tuple(Piece("photos", view, length) for view, length in enumerate(lengths)),
        )


def network_section(network: NetworkRef) -> NewSection:
    """The section that names a network; a longer name is cut."""
    name = network.name.encode("ascii", "replace")[:64]
    data = NETWORK_FIXED.pack(bytes.fromhex(network.sha256), name, network.near, network.far)
    return NewSection(NETWORK, 0, data)


def group_sections(groups: Sequence[Group]) -> list[NewSection]:
    """The section of groups, where there are several."""
    if len(groups) == 1:
        return []
    rows = [
        GROUP_FIXED.pack(len(group.views))
        + b"".join(GROUP_VIEW.pack(view | KEPT * (view in group.kept)) for view in group.views)
        for group in groups
    ]
    return [NewSection(GROUPS, 0, GROUPS_FIXED.pack(len(groups)) + b"".join(rows), minor=5)]


def photo_sections(photos: CodedPhotos) -> list[NewSection]:
    """The sections of coded photos."""
    fixed = PHOTOS_FIXED.pack(photos.height, photos.width, YCC_420_10, photos.qp, PHOTO_PARAMETER_SET, 0)
    table = b"".join(L.STREAM.pack(len(payload), crc32(payload)) for payload in photos.payloads)
    return [
        NewSection(PHOTOS, 0, fixed + table),
        NewSection(L.PARAMETER_SETS, PHOTO_PARAMETER_SET, photos.parameter_sets),
        NewSection(PHOTO_PICTURES, 0, b"".join(photos.payloads)),
    ]


def _read_network(cursor: Cursor) -> NetworkRef:
    """Parse and check a NETW section."""
    digest, raw_name, near, far = cursor.unpack(NETWORK_FIXED)
    cursor.finish()
    name = raw_name.rstrip(b"\0")
    cursor.require(name.isascii() and name.decode("latin-1").isprintable(), "the network's name is not printable ASCII")
    depths = f"near {near:g} and far {far:g}, expected {1 / MAX_DECODED:g} < near < far < {MAX_DECODED:g}"
    cursor.require(1 / MAX_DECODED < near < far < MAX_DECODED, depths)
    return NetworkRef(name.decode("ascii"), digest.hex(), near, far)


def _read_groups(file: Opened) -> tuple[Group, ...]:
    """Parse and check a section GRPS, every view kept once and one by every group; all views are one without it."""
    from ..scene.neighbours import Group

    views = file.views
    if not file.has(GROUPS):
        return (Group(tuple(range(views)), tuple(range(views))),)
    cursor = Cursor(file.only(GROUPS))
    (count,) = cursor.unpack(GROUPS_FIXED)
    groups, kept_once = [], set[int]()
    for number in range(count):
        (length,) = cursor.unpack(GROUP_FIXED)
        words = [cursor.unpack(GROUP_VIEW)[0] for _ in range(length)]
        members = tuple(word & ~KEPT for word in words)
        kept = tuple(view for view, word in zip(members, words, strict=True) if word & KEPT)
        rising = all(a < b for a, b in pairwise(members)) and all(view < views for view in members)
        cursor.require(rising, f"group {number} has views {members[:8]}, expected rising ones below {views}")
        cursor.require(
            bool(kept) and kept_once.isdisjoint(kept), f"group {number} keeps no view, or one that another does"
        )
        kept_once.update(kept)
        groups.append(Group(members, kept))
    cursor.finish()
    cursor.require(len(kept_once) == views, f"{len(kept_once)} of {views} views are kept in a group")
    return tuple(groups)


def _read_photos(cursor: Cursor, views: int, data: memoryview) -> PhotoHeader:
    """Parse and check a PHOT section; `data` are the bytes of the pictures."""
    height, width, pixel_format, qp, parameter_set, _ = cursor.unpack(PHOTOS_FIXED)
    sides = f"photos of {width}x{height}, sides are 1 to {L.MAX_SIDE}"
    cursor.require(1 <= height <= L.MAX_SIDE and 1 <= width <= L.MAX_SIDE, sides)
    cursor.require(pixel_format == YCC_420_10, f"photo format {pixel_format} is unknown")
    cursor.require(qp <= MAX_QP, f"QP {qp}, accepted are 0 to {MAX_QP}")
    streams = read_streams(cursor, views, data)
    return PhotoHeader(height, width, qp, parameter_set, streams, data)
