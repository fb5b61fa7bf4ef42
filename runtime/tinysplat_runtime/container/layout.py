"""Byte layout of a `.tsplat` file. docs/FORMAT.md is normative; a test compares its tables with these constants.

All numbers are little-endian. A file is a header, a table of sections, and the sections' bytes in the table's order.
"""

from __future__ import annotations

import struct

from ..gaussian.planes import CODING_ORDER

SUFFIX = ".tsplat"

MAX_FILE_BYTES = 1 << 31
"""Largest file that is read."""

MAGIC = b"\x89TSPLAT\n"  # a byte no text has, and a line feed that text-mode copying would alter
MAJOR, MINOR = 1, 0

HEADER = struct.Struct("<8sHHHHI")
"""magic, major, minor, section count, reserved (0), CRC-32 of the bytes before it and of the table."""

TABLE_ROW = struct.Struct("<4sHHII")
"""type, flags, index, length in bytes, CRC-32 of the section."""

REQUIRED = 1
"""Flag: a reader that does not know the section's type must refuse the file."""

SCENE = b"SCEN"
CAMERAS = b"CAMS"
LAYER = b"LAYR"
PARAMETER_SETS = b"HEVC"
PLANES = {plane_class: plane_class.facts.section for plane_class in CODING_ORDER}
"""Section type of the streams of each plane class; the index is the layer, plus PART times the part's number where the
pictures of a class are spread over several sections."""

PART = 256

SCENE_FIXED = struct.Struct("<HHf3d16s")
"""views, layers, Q_g, origin, profile name (ASCII, zero-padded)."""

CAMERA = struct.Struct("<5d12d")
"""fx, fy, cx, cy, skew in pixels; c2w's upper three rows. Float64: 136 bytes a view are 0.1 to 0.4 % of a file, and a
camera that comes back exactly needs no word on what its rounding does far from the origin."""

INTRINSICS = struct.Struct("<5d")
"""fx, fy, cx, cy, skew of a layer's own grid, per view."""

LAYER_FIXED = struct.Struct("<IIBBBBHHffff")
"""height, width, SH degree, source SH degree, flags, parameter-set index, channels, k, least z, largest z,
share of colour energy left out, condition number of the weighting."""

INVERSE_DEPTH, RELATIVE_ROTATION, SCALE_MIX, BASIS, OWN_INTRINSICS = 1, 2, 4, 8, 16
"""Flags of a layer: what the fields behind its fixed part are, in this order of presence: intrinsics, reference
quaternions, scale mix, basis."""

REFERENCE_QUAT = struct.Struct("<4f")
SCALE_MIX_FIELDS = struct.Struct("<9f3f")

CHANNEL = struct.Struct("<BBBBff")
"""class, target, coding, QP, units per code, value of code 0."""

CONSTANT, INTRA = 0, 1
"""Coding of a channel: a number (the offset), or one HEVC intra picture per view."""

STREAM = struct.Struct("<II")
"""Length and CRC-32 of one picture's slice; per view, behind a channel coded INTRA."""

UNITS = b"UNIT"
VIEW = b"VIEW"
"""Sections of a file whose views are units: the order of a view's pictures, and each view."""

UNITS_FIXED = struct.Struct("<HH")
"""pictures of a view, reserved (0)."""

UNIT_PICTURE = struct.Struct("<BB")
"""layer and record of a picture, in the order in which a view's pictures stand."""

VIEW_HEAD = struct.Struct("<I")
"""CRC-32 of the head behind it: by layer INTRINSICS and REFERENCE_QUAT as its flags say, then by picture STREAM."""

MAX_SECTIONS = 8192
MAX_VIEWS = 4096
MAX_PARAMETER_SET_BYTES = 1024
"""Of an HEVC section, which says with some 80 bytes how large pictures are and how they are coded."""

MAX_SIDE = 1 << 16
MAX_CHANNELS = 256
