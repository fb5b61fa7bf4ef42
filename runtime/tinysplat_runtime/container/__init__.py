"""The `.tsplat` container: layout, writer, and the reader that is the trust boundary."""
