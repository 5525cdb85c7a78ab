"""What a check of a set-up found wrong."""

from msgspec import Struct

__all__ = ["Finding"]


class Finding(Struct, frozen=True):
    """One problem."""

    name: str
    sentence: str
    """What was found, and what would be valid."""
