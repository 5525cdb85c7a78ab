"""The ground truth of a labelled clip: read, check and write truth.csv, one row per image.

docs/reference/conventions.md describes the columns.
"""

import csv
import math
from collections.abc import Sequence
from pathlib import Path

from msgspec import Struct

from haptigraph.errors import BadInput, unknown_name
from haptigraph.geometry import Vec

__all__ = ["TruthRow", "load_truth", "truth_text"]

COLUMNS = ("image", "time_s", "visible", "inside", "tip_x_px", "tip_y_px", "depth_mm", "theta_deg", "state")
"""The columns of `TruthRow`; a clip may have more."""


class TruthRow(Struct, frozen=True):
    """The ground truth of one image; numbers are None where the tip is not visible."""

    visible: bool
    inside: bool
    tip_px: Vec | None
    depth_mm: float | None
    theta_deg: float | None
    state: str


def load_truth(path: Path, states: Sequence[str] = ()) -> list[TruthRow]:
    """Read a truth.csv.

    Args:
        path: The file.
        states: The valid states; empty: any.

    Raises:
        BadInput: If it cannot be read or a row is not valid.
    """
    rows = []
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            for row in csv.DictReader(file, strict=True):
                rows.append(_truth_row(row, states))
    except OSError as error:
        raise BadInput(f"cannot be read ({error.strerror})", path) from None
    except UnicodeDecodeError:
        raise BadInput("not UTF-8 text", path) from None
    except KeyError as error:
        raise BadInput(f"column {error} is missing", path) from None
    except (ValueError, csv.Error) as error:
        raise BadInput(str(error), path, f"line {len(rows) + 2}") from None
    return rows


def truth_text(rows: Sequence[TruthRow], rate_hz: float) -> str:
    """Return the text of a truth.csv that `load_truth` reads.

    Args:
        rows: One row per image.
        rate_hz: Image rate.
    """
    lines = [",".join(COLUMNS)]
    for number, row in enumerate(rows):
        x, y = (None, None) if row.tip_px is None else row.tip_px
        numbers = ["" if value is None else f"{value:.3f}" for value in (x, y, row.depth_mm, row.theta_deg)]
        flags = [str(int(flag)) for flag in (row.visible, row.inside)]
        lines.append(",".join([str(number), f"{number / rate_hz:.4f}", *flags, *numbers, row.state]))
    return "\n".join(lines) + "\n"


def _truth_row(row: dict[str, str], states: Sequence[str]) -> TruthRow:
    """Parse one row.

    Raises:
        ValueError: If it is not valid.
        KeyError: If a column is missing.
    """
    if None in row or None in row.values():  # the csv module's marks of a wrong length
        raise ValueError(f"{'more' if None in row else 'fewer'} values than columns")
    if states and row["state"] not in states:
        raise ValueError(unknown_name("state", row["state"], states))

    def flag(name: str) -> bool:
        if row[name] not in ("0", "1"):
            raise ValueError(f"{name}: expected 0 or 1, found {row[name]!r}")
        return row[name] == "1"

    def number(name: str) -> float | None:
        try:
            value = float(row[name]) if row[name] else None
        except ValueError:
            value = math.nan
        if value is not None and not math.isfinite(value):
            raise ValueError(f"{name}: not a finite number: {row[name]!r}")
        return value

    x, y = number("tip_x_px"), number("tip_y_px")
    return TruthRow(
        visible=flag("visible"),
        inside=flag("inside"),
        tip_px=(x, y) if x is not None and y is not None else None,
        depth_mm=number("depth_mm"),
        theta_deg=number("theta_deg"),
        state=row["state"],
    )
