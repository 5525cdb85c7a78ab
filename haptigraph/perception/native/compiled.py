"""What the compiled library was made from."""

from haptigraph.perception.native.library import LIBRARY

__all__ = ["sources_crc32"]


def sources_crc32() -> int:
    """Return the CRC-32 of the C sources from which the library was compiled."""
    return LIBRARY.sources_crc32
