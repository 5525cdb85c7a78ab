"""Every error a user can meet, each one sentence long.

Errors take facts (file, place, what was found, what would be valid) and write the sentence themselves.
They know nothing of how it is shown; `cli` prints it and exits with code 2.

    HaptigraphError
    ├── BadInput        a file, key or argument that cannot be used
    │   └── StoreFailed a database that does not do what it is asked (it may later)
    ├── MissingExtra    an optional library that is not installed
    ├── NotCompiled     the part in C is missing, or not what this version needs
    ├── SourceLost      a camera that went away (the loop goes on)
    ├── DeviceError     an actuator that does not obey (the loop goes on)
    └── PerceiverBroken perception failed several times in a row (the run stops)
    EndOfSource         not an error: a file has no more images
    RenamedKey          a warning: a file uses a key by the name it had in an earlier version
"""

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path

__all__ = [
    "BadInput",
    "DeviceError",
    "EndOfSource",
    "HaptigraphError",
    "MissingExtra",
    "NeedsRegistration",
    "NotCompiled",
    "PerceiverBroken",
    "RenamedKey",
    "SourceLost",
    "StoreFailed",
    "unknown_name",
]


class HaptigraphError(Exception):
    """Root of all errors raised by haptigraph."""


class BadInput(HaptigraphError):
    """Something the user gave cannot be used.

    Args:
        problem: What was found and what would be valid, without the place.
        file: The file it was found in, if any.
        place: Where in the file ("line 12, [[relation]] 3"), if known.
    """

    def __init__(self, problem: str, file: str | Path | None = None, place: str = "") -> None:
        self.problem, self.file, self.place = problem, file, place
        where = ", ".join(part for part in (str(file) if file else "", place) if part)
        super().__init__(f"{where}: {problem}" if where else problem)


class StoreFailed(BadInput):
    """A database does not do what it is asked; it may when it is asked again."""


class NeedsRegistration(BadInput):
    """A source brings no registration along, and none was given."""

    def __init__(self, source: str, hint: str = "") -> None:
        super().__init__(f"{source} needs a registration; give --registration FILE{hint}")


class MissingExtra(HaptigraphError):
    """A feature needs a library that the core install leaves out."""

    def __init__(self, feature: str, extra: str) -> None:
        super().__init__(f"{feature} needs an extra; install it with: pip install 'haptigraph[{extra}]'")


class NotCompiled(HaptigraphError):
    """The compiled part of perception cannot be used."""

    def __init__(self, file: Path, found: str) -> None:
        make_it = "make it with: pip install . (in a checkout: make setup)"
        super().__init__(f"the compiled part of perception, {file}, {found}; {make_it}")


class SourceLost(HaptigraphError):
    """A live source delivers no images any more; it may come back."""


class DeviceError(HaptigraphError):
    """A haptic device did not do what it was told."""


class PerceiverBroken(HaptigraphError):
    """Perception failed on several images in a row."""


class EndOfSource(Exception):
    """The source has delivered its last image."""


class RenamedKey(FutureWarning):
    """A file uses a key by the name it had in an earlier version; it was read, and the new name is given."""


def unknown_name(what: str, name: str, valid: Iterable[str]) -> str:
    """Say that a name is not known, and which names are (the nearest one first, if one is near)."""
    names = sorted(valid)
    near = get_close_matches(name, names, n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    return f"unknown {what} {name!r}; {hint}valid: {', '.join(names)}"
