"""The results of a campaign of faults (`make faults`), one JSON object a line: sessions, and their trials.

Each call of the campaign appends a session; the trials after it are its own. Files from before this format
have trials alone, so nobody knows what software they tested.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Final, Literal

import msgspec
from msgspec import Struct

from haptigraph.analysis.evaluation.origin import Origin
from haptigraph.errors import BadInput

__all__ = ["FORMAT", "Session", "Trial", "read_campaign"]

FORMAT: Final = "haptigraph.faults/1"


class Session(Struct, frozen=True):
    """One call of the campaign."""

    format: Literal["haptigraph.faults/1"]
    seed: int
    origin: Origin


class Trial(Struct, frozen=True):
    """One fault, and what followed."""

    kind: str
    number: int
    what: str = ""
    failure: str = ""
    """The promise that was broken; empty if none was."""
    skipped: str = ""
    """Why it did not run."""
    silence_ms: float | None = None
    """From the fault until the actuator was silent."""
    lost: int = 0
    """Steps or images that are missing, all of them reported."""


def read_campaign(path: str | Path, kinds: Iterable[str]) -> list[tuple[Session | None, Trial]]:
    """Read the results of a campaign.

    Args:
        path: The file.
        kinds: The kinds of faults that are known.

    Returns:
        Every trial with its session; None if the file does not state it.

    Raises:
        BadInput: If it cannot be read, or a line is not a session or a trial of these kinds.
    """
    known, session, trials = set(kinds), None, list[tuple[Session | None, Trial]]()
    for number, line in enumerate(Path(path).read_bytes().splitlines(), 1):
        place = f"line {number}"
        try:
            value = msgspec.json.decode(line)
            if isinstance(value, dict) and "format" in value:
                session = msgspec.convert(value, Session)
                continue
            trial = msgspec.convert(value, Trial)
        except msgspec.DecodeError as error:
            raise BadInput(f"not a result of `make faults` ({error})", path, place) from None
        if trial.kind not in known:
            valid = ", ".join(sorted(known))
            raise BadInput(f"faults of kind {trial.kind!r} are unknown; valid: {valid}", path, place)
        trials.append((session, trial))
    return trials
