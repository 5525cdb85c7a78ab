"""What recordings have in common that become one dataset: one procedure, rate and image size."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from haptigraph.analysis.exporting.columns import RunTable
from haptigraph.analysis.exporting.lerobot.features import Feature, features_of
from haptigraph.errors import BadInput

__all__ = ["Survey", "survey_of"]


class Survey(NamedTuple):
    """What a pass over all recordings, without images, found."""

    features: tuple[Feature, ...]
    steps: int
    fps: int
    shape: tuple[int, int, int]
    """Height, width and channels of every image [px]."""
    task: str


def survey_of(paths: Sequence[Path]) -> Survey:
    """Read all recordings without their images, and check that they fit together.

    Raises:
        BadInput: If a recording cannot be read, or does not fit to the first.
    """
    first, steps = RunTable(paths[0], ""), 0
    with_value: set[str] = set()
    for path in paths:
        table = RunTable(path, "")
        _check_fit(first, table)
        for row in table.rows():
            steps += 1
            with_value.update(
                column.name
                for column in table.columns
                if column.name not in with_value and column.value(row) is not None
            )
    used = [column for column in first.columns if column.name in with_value]
    features = features_of(used, first.procedure)
    height, width = first.registration.height_px, first.registration.width_px
    return Survey(features, steps, _fps(first), (height, width, 3), first.procedure.title)


def _check_fit(first: RunTable, other: RunTable) -> None:
    def differs(what: str) -> BadInput:
        return BadInput(
            f"has another {what} than {first.reader.path}; export them as separate datasets",
            other.reader.path,
        )

    if other.reader.info.procedure_sha256 != first.reader.info.procedure_sha256:
        raise differs("procedure")
    if _fps(other) != _fps(first):
        raise differs("image rate")
    sizes = [(table.registration.width_px, table.registration.height_px) for table in (first, other)]
    if sizes[0] != sizes[1] or (first.registration.image.slices is None) != (
        other.registration.image.slices is None
    ):
        raise differs("image size")


def _fps(table: RunTable) -> int:
    return max(round(table.reader.info.rate_hz), 1)
