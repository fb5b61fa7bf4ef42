"""Body `Photos`: a network and the photos that it runs on.

Layout: docs/FORMAT.md, section PHOT. Reading checks every number and length, as reader.py does.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, ClassVar

from ..errors import FormatError
from ..gaussian.planes import MAX_DECODED, PlaneClass
from . import layout as L
from .body import Body, Description, Opened
from .records import ChannelRecord, Picture
from .sections import Cursor, NewSection
from .table import Row

if TYPE_CHECKING:  # most files hold no photos
    from ..scene.neighbours import Group

PHOTOS = b"PHOT"

PHOTOS_FIXED = struct.Struct("<32s64sddIIBBH")
"""sha256 of the ONNX file, its name (ASCII, zero-padded), near, far in scene units; height, width, format,
parameter-set index of the photos; groups, 0 for all photos at once; then per group a GROUP_FIXED, and a GROUP_VIEW per
view."""

GROUP_FIXED = struct.Struct("<B")
"""views."""

GROUP_VIEW = struct.Struct("<H")
"""bits 0 to 14: the view; KEPT: its Gaussians are taken from this group."""

KEPT = 0x8000

YCC_420_10 = 0
"""Format: BT.709 YCbCr of full range, 4:2:0, 10 bits."""

PHOTO_SIDE_MULTIPLE = 16


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
class CodedPhotos:
    """Photos of a file, or ready for it: their size, HEVC parameter sets with start codes, and one picture each."""

    height: int
    width: int
    qp: int
    parameter_sets: bytes
    pictures: tuple[Picture, ...]

    @property
    def rows(self) -> list[Row]:
        """The row of the table of pictures."""
        return [(0, ChannelRecord(PlaneClass.PHOTO, 0, self.qp, 0.0, 0.0, self.pictures))]

    def payload(self, view: int) -> memoryview:
        """One photo's slice; FormatError where it is cut off or altered."""
        return self.pictures[view].checked(f"photo {view}")


@dataclass(frozen=True, kw_only=True)
class Photos(Body):
    """Photos, and the network that the receiver runs on them, all at once or in groups."""

    mode: ClassVar[str] = "photos"
    sign: ClassVar[bytes] = PHOTOS
    kinds: ClassVar[frozenset[bytes]] = frozenset({L.CAMERAS, L.PARAMETER_SETS, PHOTOS})

    network: NetworkRef
    groups: tuple[Group, ...]
    photos: CodedPhotos

    @classmethod
    def read(cls, file: Opened) -> Photos:
        """Parse and check the section PHOT."""
        file.check_counts(has_layers=False)
        file.check_rows([PlaneClass.PHOTO])
        cursor = Cursor(file.only(PHOTOS))
        digest, raw_name, near, far, height, width, pixel_format, parameter_set, count = cursor.unpack(PHOTOS_FIXED)
        name, where = raw_name.rstrip(b"\0"), cursor.section.label
        is_printable = name.isascii() and name.decode("latin-1").isprintable()
        cursor.require(is_printable, "the network's name is not printable ASCII")
        depths = f"near {near:g} and far {far:g}, expected {1 / MAX_DECODED:g} < near < far < {MAX_DECODED:g}"
        cursor.require(1 / MAX_DECODED < near < far < MAX_DECODED, depths)
        sides = f"photos of {width}x{height}, sides are 1 to {L.MAX_SIDE}"
        cursor.require(1 <= height <= L.MAX_SIDE and 1 <= width <= L.MAX_SIDE, sides)
        cursor.require(pixel_format == YCC_420_10, f"photo format {pixel_format} is unknown")
        groups = _read_groups(cursor, count, file.views)
        cursor.finish()
        pixels = file.views * height * width
        if pixels > file.limits.max_pixels:
            found = f"{pixels} pixels of photos, the limit is {file.limits.max_pixels} (--max-pixels)"
            raise FormatError(found, where=where)
        records = file.table.layer(0)
        if len(records) != 1 or not records[0].pictures:
            raise FormatError(f"{len(records)} rows of photos, expected one with pictures", where="section PICT[0]")
        file.require_parameter_set(parameter_set, records, where)
        file.check_sizes(height, width, where)
        photos = CodedPhotos(height, width, records[0].qp, file.parameter_sets[parameter_set], records[0].pictures)
        network = NetworkRef(name.decode("ascii"), digest.hex(), near, far)
        return cls(cameras=file.cameras, network=network, groups=groups, photos=photos)

    def describe(self) -> Description:
        """Network and photos; what only the network knows is left open."""
        photos = self.photos
        size = {"height": photos.height, "width": photos.width, "qp": photos.qp}
        lengths = [picture.length for picture in photos.pictures]
        return Description(
            network=asdict(self.network), photos={**size, "bytes": sum(lengths), "bytes_by_view": lengths}
        )


def photo_sections(network: NetworkRef, photos: CodedPhotos, groups: Sequence[Group] = ()) -> list[NewSection]:
    """The sections of coded photos and the network for them; a longer name is cut."""
    name = network.name.encode("ascii", "replace")[:64]
    several = groups if len(groups) > 1 else ()
    sizes = photos.height, photos.width, YCC_420_10, 0, len(several)
    data = PHOTOS_FIXED.pack(bytes.fromhex(network.sha256), name, network.near, network.far, *sizes)
    for group in several:
        words = [view | KEPT * (view in group.kept) for view in group.views]
        data += GROUP_FIXED.pack(len(words)) + b"".join(map(GROUP_VIEW.pack, words))
    return [NewSection(PHOTOS, 0, data), NewSection(L.PARAMETER_SETS, 0, photos.parameter_sets)]


def _read_groups(cursor: Cursor, count: int, views: int) -> tuple[Group, ...]:
    """Groups, every view kept once and one by every group; all views are one where the file has none."""
    from ..scene.neighbours import Group

    if not count:
        return (Group(tuple(range(views)), tuple(range(views))),)
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
    cursor.require(len(kept_once) == views, f"{len(kept_once)} of {views} views are kept in a group")
    return tuple(groups)
