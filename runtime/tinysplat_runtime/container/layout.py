"""Byte layout of a `.tsplat` file. docs/FORMAT.md is normative; a test compares its tables with these constants.

All numbers are little-endian. A file is a header, a table of sections, and the sections' bytes in the table's order;
the last section holds all pictures, in the order of the table of pictures.
"""

import struct

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
STEPS = b"STEP"
"""From cameras as they were given to where they stand in the scene."""

LAYER = b"LAYR"
PARAMETER_SETS = b"HEVC"
PICTURES = b"PICT"
"""The table of pictures."""

DATA = b"DATA"
"""The bytes of all pictures: the last section."""

BY_LAYER = frozenset({LAYER, b"EXAC", b"TIER"})
"""Sections whose index is a layer's or a tier's; those of others is 0, but that of parameter sets."""

MAX_SETS = 256

SCENE_FIXED = struct.Struct("<HHf3d16s")
"""cameras, layers or tiers, Q_g, origin, profile name (ASCII, zero-padded)."""

PICTURES_FIXED = struct.Struct("<HHH")
"""rows, views of a row's pictures, 0; then CHANNEL per row, and STREAMs."""

CHANNEL = struct.Struct("<BBBBff")
"""layer or tier, class, target, QP or CONSTANT, units per code, value of code 0."""

CONSTANT = 255
"""In place of a QP: the channel has no pictures, and is its offset."""

STREAM = struct.Struct("<II")
"""Length and CRC-32 of one picture."""

COLUMN = struct.Struct("<B")
"""How a column of numbers is stored: PER_VIEW or once for all, NARROW (float32) or float64; the numbers follow."""

PER_VIEW, NARROW = 1, 2

LAYER_FIXED = struct.Struct("<IIBBBBHffff")
"""height, width, SH degree, source SH degree, flags, parameter-set index, k, least z, largest z, share of colour energy
left out, condition number of the weighting."""

INVERSE_DEPTH, OWN_INTRINSICS, RELATIVE_ROTATION, SCALE_MIX, BASIS = 1, 2, 4, 8, 16
"""Flags of a layer: what the fields behind its fixed part are, in this order: intrinsics (columns), reference
quaternions (columns), scale mix, basis."""

SCALE_MIX_FIELDS = struct.Struct("<9f3f")

MAX_SECTIONS = 256
MAX_VIEWS = 4096
MAX_PARAMETER_SET_BYTES = 1024
"""Of an HEVC section, which says with some 80 bytes how large pictures are and how they are coded."""

MAX_SIDE = 1 << 16
