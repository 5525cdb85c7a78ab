"""Reproduce the report from the tables beside this file, and compare it with the published one.

    python -m pip install -r requirements.txt
    python reproduce.py [OUTPUT]

OUTPUT, by default `reproduced`, receives the new report. Exit code 1 if a table of results differs.
"""

import csv
import math
import sys
from pathlib import Path

import click

from haptigraph.analysis.study.report import write_report

__all__ = ["compared", "reproduce"]

TOLERANCE = 1e-6
"""Relative, of every number: other versions of the libraries may round the last digits differently."""


def reproduce(bundle: Path, output: Path) -> int:
    """Write the report again and print how each file compares; return the exit code."""
    write_report(bundle / "tables", output, recordings=bundle, has_participants=False)
    published = sorted(path for path in (bundle / "report").rglob("*") if path.is_file())
    verdicts = {path: compared(path, output / path.relative_to(bundle / "report")) for path in published}
    for path, verdict in verdicts.items():
        if verdict != "identical":
            click.echo(f"{path.relative_to(bundle).as_posix()}: {verdict}")
    counts = {verdict: list(verdicts.values()).count(verdict) for verdict in verdicts.values()}
    click.echo(
        f"{len(published)} files: " + ", ".join(f"{count} {name}" for name, count in sorted(counts.items()))
    )
    wrong = [path for path, verdict in verdicts.items() if path.suffix == ".csv" and verdict == "different"]
    missing = "missing" in counts
    click.echo("the results differ" if wrong or missing else "the results are reproduced")
    return 1 if wrong or missing else 0


def compared(published: Path, new: Path) -> str:
    """Compare two files: identical, equal numbers, different, or missing."""
    if not new.is_file():
        return "missing"
    if published.read_bytes() == new.read_bytes():
        return "identical"
    if published.suffix != ".csv":
        return "different"
    rows, others = _cells(published), _cells(new)
    same_shape = [len(row) for row in rows] == [len(row) for row in others]
    pairs = [pair for row, other in zip(rows, others, strict=False) for pair in zip(row, other, strict=False)]
    return "equal" if same_shape and all(_are_equal(*pair) for pair in pairs) else "different"


def _cells(path: Path) -> list[list[str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.reader(file))


def _are_equal(first: str, second: str) -> bool:
    if first == second:
        return True
    try:
        return math.isclose(float(first), float(second), rel_tol=TOLERANCE, abs_tol=1e-12)
    except ValueError:
        return False


if __name__ == "__main__":
    folder = Path(__file__).resolve().parent
    sys.exit(reproduce(folder, Path(sys.argv[1]) if sys.argv[1:] else folder / "reproduced"))
