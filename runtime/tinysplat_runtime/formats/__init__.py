"""Gaussian files of other tools, a module a format."""

SPZ_VERSIONS = (3, 4)
"""What can be written."""

SPZ_VERSION = 3
"""What is written unless asked otherwise: the newest that readers without zstd open."""

SH_BITS = (5, 4)
"""Bits of an SH coefficient of degree 1 and above it, out of the 8 that .spz stores; the SPZ library's own default."""
