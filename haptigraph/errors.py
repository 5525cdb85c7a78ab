"""Every error a user can meet, each one sentence long.

Errors take facts (file, place, what was found, what would be valid) and compose the sentence; `cli` prints it
and exits with code 2.

    HaptigraphError
    ├── BadInput        a file, key or argument that cannot be used
    │   └── StoreFailed a database operation that failed and may succeed later
    ├── MissingExtra    an optional library that is not installed
    ├── NotCompiled     the C library is missing, or built for another version
    ├── SourceLost      a camera that has disconnected (the loop goes on)
    ├── DeviceError     an actuator that failed (the loop goes on)
    │   └── NotSilent   it may still vibrate after the run
    └── PerceiverBroken perception failed several times in a row (the run stops)
    EndOfSource         not an error: a file has no more images
    RenamedKey          a warning: a file uses a key's name from an earlier version
    NotDrawn            a warning: a figure was left out, because drawing it needs an extra
    Implausible         a warning: a recorded procedure has a threshold that no eye allows
"""

from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path

__all__ = [
    "BadInput",
    "DeviceError",
    "EndOfSource",
    "HaptigraphError",
    "Implausible",
    "MissingExtra",
    "NeedsRegistration",
    "NotCompiled",
    "NotDrawn",
    "NotSilent",
    "PerceiverBroken",
    "RenamedKey",
    "SourceLost",
    "StoreFailed",
    "unknown_name",
]

MAX_LENGTH = 600


class HaptigraphError(Exception):
    """Root of all errors raised by haptigraph."""


class BadInput(HaptigraphError):
    """A file, key or argument cannot be used.

    Args:
        problem: What was found and what would be valid, without the location; its middle is left out if it is
            longer than `MAX_LENGTH` characters.
        file: The file, if any.
        place: Location in the file ("line 12, [[relation]] 3"), if known.
    """

    def __init__(self, problem: str, file: str | Path | None = None, place: str = "") -> None:
        if len(problem) > MAX_LENGTH:
            problem = f"{problem[: MAX_LENGTH * 2 // 3]} ... {problem[-MAX_LENGTH // 3 :]}"
        self.problem, self.file, self.place = problem, file, place
        where = ", ".join(part for part in (str(file) if file else "", place) if part)
        super().__init__(f"{where}: {problem}" if where else problem)


class StoreFailed(BadInput):
    """A database operation failed; it may succeed when repeated."""


class NeedsRegistration(BadInput):
    """A source has no registration of its own, and none was given."""

    def __init__(self, source: str, hint: str = "") -> None:
        super().__init__(f"{source} needs a registration; give --registration FILE{hint}")


class MissingExtra(HaptigraphError):
    """A feature needs a library that the core installation does not include."""

    def __init__(self, feature: str, extra: str) -> None:
        self.feature, self.extra = feature, extra
        super().__init__(f"{feature} needs an extra; install it with: pip install 'haptigraph[{extra}]'")

    def __reduce__(self) -> tuple[type["MissingExtra"], tuple[str, str]]:
        return MissingExtra, (self.feature, self.extra)  # a worker sends it to the program


class NotCompiled(HaptigraphError):
    """The compiled part of perception cannot be used."""

    def __init__(self, file: Path, found: str) -> None:
        make_it = "make it with: pip install . (in a checkout: make setup)"
        super().__init__(f"the compiled part of perception, {file}, {found}; {make_it}")


class SourceLost(HaptigraphError):
    """A live source no longer delivers images; it may reconnect."""


class DeviceError(HaptigraphError):
    """A haptic device failed to execute a command."""


class NotSilent(DeviceError):
    """A run has ended, and its actuator may still vibrate."""

    def __init__(self, device: str) -> None:
        super().__init__(f"{device} does not confirm silence; it may still vibrate: switch it off")


class PerceiverBroken(HaptigraphError):
    """Perception failed on several images in a row."""


class EndOfSource(Exception):
    """The source has delivered its last image."""


class RenamedKey(FutureWarning):
    """A file uses a key's name from an earlier version; it was read, and the warning gives the new name."""


class Implausible(UserWarning):
    """A procedure that nobody edits any more has thresholds that a new one would be refused for."""


class NotDrawn(UserWarning):
    """A figure was left out, because drawing it needs an extra."""


def unknown_name(what: str, name: str, valid: Iterable[str]) -> str:
    """Return the sentence for an unknown name: the most similar valid name, if any, and all valid names."""
    names = sorted(valid)
    similar = get_close_matches(name, names, n=1)
    hint = f"did you mean {similar[0]!r}? " if similar else ""
    return f"unknown {what} {name!r}; {hint}valid: {', '.join(names)}"
