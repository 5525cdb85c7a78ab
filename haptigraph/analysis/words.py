"""Numbers and nouns as sentences have them."""

__all__ = ["counted"]


def counted(number: int, noun: str) -> str:
    """Return a number with its noun in singular or plural."""
    return f"{number} {noun}{'s' * (number != 1)}"
