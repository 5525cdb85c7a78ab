"""The job that finds recordings in the archive of the folder, by the fields of the page's form."""

from datetime import datetime
from pathlib import Path
from typing import Any

import msgspec

from haptigraph.analysis.archive.finding import Filter, find
from haptigraph.analysis.archive.query import staleness
from haptigraph.dashboard.server.stream import send_message
from haptigraph.errors import BadInput

__all__ = ["find_recordings"]


def find_recordings(fields: str) -> None:
    """Send the recordings that a form selects.

    Args:
        fields: A `Filter` as JSON.
    """
    try:
        given = msgspec.json.decode(fields, type=Filter)
    except msgspec.MsgspecError as error:
        raise BadInput(str(error), "filter") from None
    folder = Path.cwd()
    answer = find(folder, given)
    rows = [dict(zip(answer.columns, map(_json, row), strict=True)) for row in answer.rows]
    send_message(
        {"type": "found", "rows": rows, "is_complete": answer.is_complete, "note": staleness(folder)}
    )


def _json(value: Any) -> Any:
    return f"{value.isoformat()}Z" if isinstance(value, datetime) else value
