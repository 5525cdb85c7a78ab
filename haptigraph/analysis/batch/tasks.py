"""What a batch does with one recording, and what comes of it."""

from typing import Any, Literal, TypeAlias

from msgspec import Struct

__all__ = ["BatchTask", "Done", "Kind"]

Kind: TypeAlias = Literal["replay", "measure", "evaluate", "export"]


class BatchTask(Struct, frozen=True):
    """One recording of a batch."""

    kind: Kind
    folder: str
    name: str
    """Path relative to the folder."""
    size: int
    changed_ns: int
    procedure: str = ""
    """Text of another procedure; empty: the recorded one."""
    procedure_name: str = ""
    output: str = ""
    """The file that an export writes."""
    format: str = "csv"
    """Of that file."""


class Done(Struct, frozen=True):
    """The result of a task."""

    result: dict[str, Any] = {}
    problem: str = ""
    """Why the recording was passed over; empty: it was not."""
    cpu_s: float = 0.0
    """Processor time of the worker."""
